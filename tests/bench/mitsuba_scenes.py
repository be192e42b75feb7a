"""Thirteen path-traced scenes against Mitsuba 3: a t-test of the mean of the image, and one per pixel.

Both render independent batches with independent samples. Set DRJIT_LIBLLVM_PATH to a libLLVM.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table
from mitsuba_light import peer
from scipy import stats

sys.path.append(str(ROOT / "tests"))
import raytrace as rt
from light_cases import GLASS, diffuse, environment, scene
from light_scenes import COPPER, FLOOR, LAMP, VIEW, glass_and_metal, many_lamps, open_sky, sided
from light_techniques import sidak
from small_scenes import ball, box, quad

SIZE = (32, 32)
SIGNIFICANCE = 1e-2  # of all tests of a kind together
BLOCK = (box((-0.6, -1, -0.6), (0.1, -0.2, 0.1)), diffuse(0.5))
WALL = quad((-3, -1, -1.5), (3, -1, -1.5), (3, 3, -1.5), (-3, 3, -1.5))
SHELF = quad((-0.2, 0.2, 0.2), (1.2, 0.3, 0.2), (1.2, 0.3, -0.8), (-0.2, 0.2, -0.8))  # seen from below
HALL = [(FLOOR, diffuse(0.6)), (WALL, diffuse(0.5)), BLOCK, (SHELF, diffuse(0.5))]
BALL = 0.5 * ball(12)[0] + [0.5, -0.45, 0.4]


def lit(*lights: dict[str, Any], depth: int = 4, parts: Any = HALL) -> dict[str, Any]:
    return scene(parts, VIEW, depth, lights=list(lights))


def smooth(given: dict[str, Any]) -> dict[str, Any]:
    for each in given["objects"]:
        each["normals"] = "smooth"
    return given


def cornell_box() -> Any:
    return ROOT / "scenes" / "cornell-box-area.json"


def glass_balls() -> dict[str, Any]:
    """Caustics of glass of two indices, one in the other, under a large lamp; and glass thinner than air."""
    inner, thin = {"type": "dielectric", "ior": 1.2}, {"type": "dielectric", "ior": 0.8}
    small = (BALL - [0.5, -0.45, 0.4]) * 0.5
    parts = [*HALL[:3], (BALL, GLASS), (small + [0.5, -0.45, 0.4], inner), (small + [-0.4, 0.1, 0.6], thin)]
    return lit(depth=10, parts=[*parts, (1.5 * LAMP + [0, 1.5, 0.4], diffuse(0, 1.0))])


def two_sided_lamps() -> dict[str, Any]:
    """Lamps that reflect, on both sides or one, and whose backs are seen."""
    lamp = LAMP + [0.2, 1.0, 0.3]
    up = (0.5 * LAMP)[:, ::-1] + [-0.6, 0.0, 0.4]
    return lit(parts=[*HALL[:3], (lamp, sided(diffuse(0.5, 1.0))), (up, diffuse(0.4, 2.0))], depth=5)


POINT = {"type": "point", "position": [0.7, 1.5, 1.5], "flux": [60, 50, 40]}
SPOT = {"type": "spot", "position": [1, 2, 2], "look_at": [0, -0.6, 0], "intensity": [9, 8, 7], "cutoff": 25}
HARD = {**SPOT, "position": [-1, 1.5, 2], "cutoff": 20, "beam": 20}
SUN = {"type": "directional", "direction": [-1, -2, -1], "irradiance": [2, 1.9, 1.7]}
HANGING = LAMP + [0.2, 1.4, 0.4], diffuse(0, 2.0)
LIT_BALL = [(BALL, {"type": "conductor", "metal": "gold"}), (0.3 * ball(12)[0] + [-0.4, 0.4, 0.5], COPPER)]
SMOOTH = [(FLOOR, sided(diffuse(0.6))), (0.5 * ball(24)[0] + [0.5, -0.45, 0.4], GLASS)]

SCENES = {
    "Cornell box, area light": cornell_box,
    "mirrors": lambda: ROOT / "scenes" / "mirrors.json",
    "glass and caustics": glass_balls,
    "metals": lambda: lit(parts=[*HALL, *LIT_BALL, HANGING]),
    "spot lights": lambda: lit(SPOT, HARD),
    "directional light": lambda: lit(SUN),
    "constant environment": open_sky,
    "point light": lambda: lit(POINT),
    "many lamps": many_lamps,
    "smooth normals": lambda: smooth(lit(*environment(0.5), depth=8, parts=SMOOTH)),
    "a small depth": lambda: glass_and_metal() | {"render": {"integrator": "path", "max_depth": 2}},
    "two-sided lamps": two_sided_lamps,
    "all lights at once": lambda: lit(
        POINT, SPOT, SUN, *environment(0.2), parts=[*HALL, (BALL, GLASS), (LAMP + [0, 1.2, 0], diffuse(0, 2.0))]
    ),
}


def verdict(ours: np.ndarray, theirs: np.ndarray) -> dict[str, Any]:
    """Welch's t-tests of batches (n, h, w, 3): of the mean of the image, and of each pixel and channel."""
    a, b = (batch.mean(axis=(1, 2, 3)) for batch in (ours, theirs))
    mean = stats.ttest_ind(a, b, equal_var=False)
    same = (ours.var(axis=0) == 0) & (theirs.var(axis=0) == 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        p = np.where(same, 1.0, stats.ttest_ind(ours, theirs, axis=0, equal_var=False).pvalue)
    close = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) <= 1e-5 * (
        1e-3 + theirs.mean(axis=0)
    )  # no noise but float32
    p = np.where(close, np.maximum(p, 0.5), p)
    noisy = p[~close]
    return {
        "difference": float(a.mean() / b.mean() - 1),
        "error": float(np.hypot(stats.sem(a), stats.sem(b)) / b.mean()),
        "p": float(mean.pvalue),
        "least p of a pixel": float(-np.expm1(np.log1p(-p.min()) * p.size)),
        "pixels at 1 %": float(np.mean(noisy < 0.01)) if noisy.size else 0.0,
    }


def main() -> int:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--batches", type=int, default=32, help="independent images of each (%(default)s)")
    arguments.add_argument("--spp", type=int, default=256, help="samples per pixel of a batch (%(default)s)")
    arguments.add_argument("--only", default="", help="scenes whose name contains this text")
    args = arguments.parse_args()
    return compare_scenes(args, {name: lambda make=make: rt.load(make()) for name, make in SCENES.items()}, SIZE)


def compare_scenes(args: Any, scenes: dict[str, Callable[[], rt.Scene]], size: tuple[int, int]) -> int:
    """Compare scenes with Mitsuba, and print a table; 1 if one differs."""
    found, rows, level = begin(), [], sidak(SIGNIFICANCE, len(scenes))
    for name, make in scenes.items():
        if args.only not in name:
            continue
        scene, seeds = make(), range(args.batches)
        render = peer(scene, size)
        theirs = np.array([render(args.spp, 1000 + seed) for seed in seeds])
        ours = [rt.render(scene, spp=args.spp, size=size, seed=s, sampler="independent").rgb for s in seeds]
        row = verdict(np.array(ours, np.float64), theirs)
        rows.append({"scene": name, **row, "holds": bool(min(row["p"], row["least p of a pixel"]) > level)})
    show(f"Each test at level {level:.2g}; least p of a pixel after Sidak, over all pixels and channels")
    table(
        ["scene", "difference", "its error", "p", "least p of a pixel", "pixels with p < 1 %", ""],
        (
            [row["scene"], f"{row['difference']:+.3%}", f"{row['error']:.3%}", row["p"], row["least p of a pixel"]]
            + [f"{row['pixels at 1 %']:.1%}", "" if row["holds"] else "DIFFERS"]
            for row in rows
        ),
    )
    finish(args, found, rows)
    return 0 if all(row["holds"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
