"""Light sampling alone, surface sampling alone and both by multiple importance: their expectations and variances.

Six scenes without point-like lights. The expectations are compared by t-tests at a total significance of 1e-3; each
test would find a bias of 0.5 % of the mean with probability 0.99. Then the variance of one sample, averaged over the
pixels, and that on scenes/veach-lights.json, over the pixels that show no lamp.
"""

import math
import sys
from typing import Any

from harness import ROOT, begin, finish, parser, show, table

sys.path.append(str(ROOT / "tests"))
import raytrace as rt
from light_scenes import SCENES
from light_techniques import TECHNIQUES, Images, compare, images, lamps_in_view, sidak

SIGNIFICANCE, FOUND = 1e-3, 5e-3  # total; relative bias that each test must find
SIZE = (24, 24)
PILOT = 8  # samples per pixel
MOST = 8192


def enough(scene: Any, name: str, seeds: int, level: float) -> Images:
    """Images of which a t-test finds a bias of ``FOUND``: their number of samples comes from a pilot."""
    pilot = images(scene, name, PILOT, range(10**4, 10**4 + seeds), SIZE)
    spread = pilot.means.std(ddof=1) / math.sqrt(seeds) / pilot.mean
    wanted = FOUND / (math.sqrt(2) * 2 * math.sqrt(-math.log(level)))  # of one of two techniques; a little too small
    spp = PILOT * max(1.0, 2.2 * (spread / wanted) ** 2)
    first = 10**5 * (1 + TECHNIQUES.index(name))
    return images(scene, name, min(math.ceil(spp), MOST), range(first, first + seeds), SIZE)


def expectations(seeds: int) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    level = sidak(SIGNIFICANCE, 2 * len(SCENES))
    tests, variances = [], []
    for name, make in SCENES.items():
        scene = rt.load(make())
        of = {each: enough(scene, each, seeds, level) for each in TECHNIQUES}
        mean = of["both"].mean
        for each in ("light", "surface"):
            verdict = compare(of[each], of["both"], level)
            row = {"scene": name, "technique": each, "difference": verdict.difference / mean, "p": verdict.p}
            row |= {"found": verdict.found / mean, "holds": bool(verdict.p > level and verdict.found <= FOUND * mean)}
            tests.append(row)
        variance = {each: float(of[each].variance.mean()) for each in TECHNIQUES}
        better = min(variance["light"], variance["surface"])
        variances.append({"scene": name, "mean": mean} | variance | {"most": 1.5 * better + mean * mean / 2})
    return tests, variances


def of_veach(seeds: int) -> dict[str, Any]:
    scene = rt.load(ROOT / "scenes" / "veach-lights.json")
    size = (48, 30)
    dark = ~lamps_in_view(scene, size)
    of = {each: images(scene, each, 16, range(seeds), size) for each in TECHNIQUES}
    variance = {each: float(of[each].variance[dark].mean()) for each in TECHNIQUES}
    most = max(variance["light"], variance["surface"]) / 10
    return {"scene": "veach-lights", "mean": float(of["both"].luminance[:, dark].mean())} | variance | {"most": most}


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--seeds", type=int, default=32, help="independent images per technique (%(default)s)")
    args = arguments.parse_args()
    found = begin()
    tests, variances = expectations(args.seeds)
    variances.append(of_veach(4 * args.seeds))
    show(f"Expectations: each test at level {sidak(SIGNIFICANCE, len(tests)):.2g}")
    table(
        ["scene", "technique", "difference from both", "p", "smallest bias found", ""],
        (
            [row["scene"], row["technique"], f"{row['difference']:+.2%}", row["p"], f"{row['found']:.2%}"]
            + ["" if row["holds"] else "FAILS"]
            for row in tests
        ),
    )
    show("Variance of one sample")
    table(
        ["scene", "mean", *TECHNIQUES, "most allowed", ""],
        (
            [row["scene"], row["mean"], *(row[each] for each in TECHNIQUES), row["most"]]
            + ["" if row["both"] <= row["most"] else "FAILS"]
            for row in variances
        ),
    )
    finish(args, found, {"expectations": tests, "variances": variances})
    return 0 if all(row["holds"] for row in tests) and all(row["both"] <= row["most"] for row in variances) else 1


if __name__ == "__main__":
    sys.exit(main())
