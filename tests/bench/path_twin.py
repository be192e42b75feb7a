"""Path tracing against its brute-force twin (tests/naive_paths.py), channel by channel, at full size."""

import sys

from harness import ROOT, begin, finish, parser, show, table

sys.path.append(str(ROOT / "tests"))
from light_techniques import sidak
from twin_scenes import SCENES, differences

SIZE = (12, 12)


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--seeds", type=int, default=32, help="independent images (%(default)s)")
    arguments.add_argument("--spp", type=int, default=100, help="samples per pixel of the twin (%(default)s)")
    args = arguments.parse_args()
    found, rows, level = begin(), [], sidak(1e-3, 3 * len(SCENES))
    for name, make in SCENES.items():
        verdicts = differences(make(), SIZE, args.seeds, (args.spp, 10 * args.spp), level)
        for channel, (verdict, mean) in zip(("red", "green", "blue"), verdicts, strict=True):
            row = {"scene": name, "channel": channel, "mean": mean, "difference": verdict.difference / mean}
            rows.append(row | {"p": verdict.p, "found": verdict.found / mean, "holds": bool(verdict.p > level)})
    show(f"Each test at level {level:.2g}, {1e-3} in total")
    table(
        ["scene", "channel", "mean", "difference", "p", "smallest bias found", ""],
        (
            [row["scene"], row["channel"], row["mean"], f"{row['difference']:+.2%}", row["p"], f"{row['found']:.2%}"]
            + ["" if row["holds"] else "FAILS"]
            for row in rows
        ),
    )
    finish(args, found, rows)
    return 0 if all(row["holds"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
