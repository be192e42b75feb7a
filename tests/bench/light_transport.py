"""Path tracing against closed forms, at full size: all cases of tests/light_cases.py, and spheres of 300,000 triangles.

Each answer must be met within four standard errors. A standard error comes from independent seeds, as samples of one
Sobol set are not independent. A pilot chooses the number of samples; its own samples are not used.
"""

import math
import sys
import time
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

sys.path.append(str(ROOT / "tests"))
import raytrace as rt
from light_cases import Case, cases, large

SIDE = 16  # pixels
MOST = 10**7  # samples per case
ERROR, CHANCE_ERROR = 3e-4, 1.5e-3  # wanted standard error, relative
SIGMAS = 4
PILOT = 4  # samples per pixel
MARGIN = 2.0  # more samples than the pilot asks for, as its estimate has an error too


def means(scene: Any, spp: int, seeds: range, precision: str) -> np.ndarray:
    """Mean of an image for each seed."""
    pictures = (rt.render(scene, spp=spp, size=(SIDE, SIDE), seed=seed, precision=precision) for seed in seeds)
    return np.array([picture.rgb.mean(dtype=np.float64) for picture in pictures])


def standard_error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / math.sqrt(len(values)))


def judge(case: Case, first: int, seeds: int, precision: str) -> dict[str, Any]:
    """Render a case with the seeds from ``first`` on, and compare its mean with the answer."""
    began = time.perf_counter()
    scene = rt.load(case.scene)
    limit = CHANCE_ERROR if case.chance else ERROR
    pilot = standard_error(means(scene, PILOT, range(first + seeds, first + 2 * seeds), precision)) / case.expected
    wanted = PILOT * MARGIN * (pilot / limit) ** 2
    most = MOST // (seeds * SIDE * SIDE)
    spp = int(min(max(2 ** math.ceil(math.log2(max(wanted, PILOT))), PILOT), most))
    values = means(scene, spp, range(first, first + seeds), precision)
    error, spread = float(values.mean() - case.expected), standard_error(values)
    allowed = SIGMAS * spread + case.tolerance * case.expected
    return {
        "case": case.name,
        "answer": case.expected,
        "error": error / case.expected,
        "standard error": spread / case.expected,
        "sigmas": (abs(error) - case.tolerance * case.expected) / max(spread, 1e-300),
        "samples": seeds * SIDE * SIDE * spp,
        "seconds": time.perf_counter() - began,
        "holds": bool(abs(error) <= allowed and spread <= limit * case.expected),
    }


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--seeds", type=int, default=32, help="independent images per case (%(default)s)")
    arguments.add_argument("--precision", default="float32", choices=["float32", "float64"])
    arguments.add_argument("--only", default="", help="cases whose name contains this text")
    args = arguments.parse_args()
    found, rows = begin(), []
    for number, case in enumerate([*cases(), *large()]):  # each with seeds of its own, so that errors are independent
        if args.only in case.name:
            rows.append(judge(case, 10**4 * (number + 1), args.seeds, args.precision))
    table(
        ["case", "answer", "error", "standard error", "samples", "seconds", ""],
        (
            [
                row["case"],
                row["answer"],
                f"{row['error']:+.1e}",
                f"{row['standard error']:.1e}",
                f"{row['samples']:.1e}",
            ]
            + [row["seconds"], "" if row["holds"] else "FAILS"]
            for row in rows
        ),
    )
    broken = sum(not row["holds"] for row in rows)
    show(f"{len(rows)} cases, {broken} fail; {sum(row['seconds'] for row in rows):.0f} s")
    finish(args, found, rows)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
