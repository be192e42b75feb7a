"""Check the errors that path-traced images state, against references: scenes, samplers and numbers of samples.

Coverage is the share of pixels whose 95 % interval contains the true value, over all pixels whose samples are not all
equal. The last scene has caustics. Its pixels are then also split by the value of the reference, and by what the
interval misses: a value above it is light that no path has met yet.
"""

from typing import Any, NamedTuple

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

import raytrace as rt
from raytrace.image.metrics import screen
from raytrace.passes.estimate import LUMINANCE
from raytrace.records import Scene

SCENES = "cornell-box-area", "sky", "veach-lights", "cornell-box", "room"  # without caustics
CAUSTIC = "caustic"
SAMPLERS = "sobol", "independent"
COUNTS = 16, 64, 256  # samples per pixel
T3 = 3.182  # Student's t, 97.5 %, 3 degrees of freedom
TRUTH_SEED = 10**6
ROUNDING = 1e-6  # of float32


class Coverage(NamedTuple):
    """What the stated errors of one scene, sampler and number of samples are worth."""

    held: float  # share of intervals that contain the true value
    above: float  # share of those whose true value lies above
    below: float
    ratio: float  # stated over actual RMSE of the image, in sRGB
    linear: float  # the same of luminance


def measured(scene: Scene, truth: np.ndarray, sampler: str, spp: int, seeds: int) -> Coverage:
    """Compare the intervals of images of several seeds with a reference."""
    held, above, below, squares = [], [], [], []
    for seed in range(seeds):
        image = rt.render(
            scene, spp=spp, size=truth.shape[1::-1], seed=seed, sampler=sampler, integrator="path", progress=False
        )
        noisy = image.stderr > 0  # the samples of the others are all equal
        off = ((truth - image.rgb) @ LUMINANCE)[noisy]
        half = T3 * image.stderr[noisy] + ROUNDING
        held.append(np.mean(np.abs(off) <= half))
        above.append(np.mean(off > half))
        below.append(np.mean(off < -half))
        stated = image.stats["estimated_error"] ** 2, image.stats["estimated_error_linear"] ** 2
        actual = np.mean((screen(image.rgb) - screen(truth)) ** 2), np.mean(((image.rgb - truth) @ LUMINANCE) ** 2)
        squares.append((*stated, *actual))
    stated, linear, actual, actual_linear = np.mean(squares, axis=0)
    ratios = np.sqrt([stated / actual, linear / actual_linear])
    return Coverage(*(float(np.mean(x)) for x in (held, above, below)), *map(float, ratios))


def reference(scene: Scene, size: tuple[int, int], spp: int) -> np.ndarray:
    """Render the true values, with four seeds."""
    images = [
        rt.render(scene, spp=spp // 4, size=size, seed=TRUTH_SEED + k, integrator="path", progress=False).rgb
        for k in range(4)
    ]
    return np.mean(np.array(images, np.float64), axis=0)


def main() -> None:
    options = parser(__doc__, rounds=8)
    options.add_argument("--size", type=int, default=48, help="pixels: side of the film (%(default)s)")
    options.add_argument("--truth", type=int, default=32768, help="samples per pixel of a reference (%(default)s)")
    options.add_argument("--scenes", nargs="+", default=[*SCENES, CAUSTIC], help="(%(default)s)")
    options.add_argument("--samplers", nargs="+", default=SAMPLERS, help="(%(default)s)")
    args = options.parse_args()
    found, rows = begin(), {}
    for name in args.scenes:
        scene = rt.load(ROOT / f"scenes/{name}.json")
        truth = reference(scene, (args.size, args.size), args.truth)
        for sampler in args.samplers:
            for spp in COUNTS:
                rows[name, sampler, spp] = row = measured(scene, truth, sampler, spp, args.rounds)
                show(f"{name} {sampler} {spp}: {row}")
    show(f"Coverage; true value above, below the interval; stated / actual error, sRGB, linear; {args.rounds} seeds:\n")
    plain = [name for name in args.scenes if name != CAUSTIC]
    cells: dict[Any, str] = {
        key: f"{r.held:.1%} ({r.above:.1%}, {r.below:.1%}), {r.ratio:.2f}, {r.linear:.2f}" for key, r in rows.items()
    }
    lines = []
    for sampler in args.samplers:
        for spp in COUNTS:
            mean = np.mean([rows[name, sampler, spp].held for name in plain])
            lines.append([f"{sampler} {spp}", f"{mean:.1%}", *(cells[name, sampler, spp] for name in args.scenes)])
    table(["sampler, spp", "mean", *args.scenes], lines)
    finish(args, found, {"coverage": [[*key, *row] for key, row in rows.items()]})


if __name__ == "__main__":
    main()
