"""Check the errors that path-traced images state, against references: scenes, samplers and numbers of samples.

Coverage is the share of pixels whose 95 % interval contains the true value, over all pixels whose samples are not all
equal. A true value above the interval is light that no path has met yet. The last three scenes have rare bright paths:
from lamps by mirrors and glass (caustics), and from a wall that a point light is close to. They are not in the mean.

With ``--batches``, coverage by the number of batch means instead, from images of one sample per pixel.
"""

from typing import Any, NamedTuple

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

import raytrace as rt
from raytrace.image.metrics import screen
from raytrace.passes.estimate import LUMINANCE
from raytrace.records import Scene

SCENES = "cornell-box-area", "sky", "veach-lights", "cornell-box", "bumpy"  # without caustics
HARD = "room", "mirrors", "caustic"
SAMPLERS = "sobol", "independent"
COUNTS = 16, 64, 256  # samples per pixel
T3 = 3.182  # Student's t, 97.5 %, 3 degrees of freedom
T = {4: T3, 8: 2.365, 16: 2.131}  # by batch means: one degree of freedom less
SINGLE = 2048  # images of one sample per pixel
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


def by_batches(scene: Scene, size: tuple[int, int], truth_spp: int, seeds: int) -> dict[int, list[float]]:
    """Coverage by samples per pixel, for each number of batch means of independent samples."""
    truth = reference(scene, size, truth_spp) @ LUMINANCE
    ask: dict[str, Any] = {"spp": 1, "size": size, "sampler": "independent", "integrator": "path", "progress": False}
    samples = np.array([rt.render(scene, seed=seed, **ask).rgb @ LUMINANCE for seed in range(SINGLE)])
    found: dict[int, list[float]] = {}
    for spp in COUNTS:
        found[spp] = []
        for batches, t in T.items():
            held = []
            for k in range(min(seeds, SINGLE // spp)):
                taken = samples[k * spp : (k + 1) * spp]
                means = taken.reshape(batches, -1, *truth.shape).mean(axis=1)
                off = np.abs(means.mean(axis=0) - truth)[np.ptp(taken, axis=0) > 0]
                half = t * means.std(axis=0, ddof=1)[np.ptp(taken, axis=0) > 0] / np.sqrt(batches)
                held.append(np.mean(off <= half + ROUNDING))
            found[spp].append(float(np.mean(held)))
    return found


def show_batches(args: Any) -> dict[str, dict[int, list[float]]]:
    """Print coverage by the number of batch means."""
    size = args.size // 2, args.size // 2
    loaded = {name: rt.load(ROOT / f"scenes/{name}.json") for name in args.scenes if name not in HARD}
    found = {name: by_batches(scene, size, 4 * args.truth, args.rounds) for name, scene in loaded.items()}
    show("Coverage of intervals from so many batch means, independent samples:\n")
    rows = [(spp, k, batches) for spp in COUNTS for k, batches in enumerate(T)]
    shares = [[found[name][spp][k] for name in found] for spp, k, _ in rows]
    lines = zip(rows, shares, strict=True)
    text = ([f"{s} spp, {b}", f"{np.mean(x):.1%}", *(f"{y:.1%}" for y in x)] for (s, _, b), x in lines)
    table(["samples, batches", "mean", *found], text)
    return found


def main() -> None:
    options = parser(__doc__, rounds=8)
    options.add_argument("--size", type=int, default=48, help="pixels: side of the film (%(default)s)")
    options.add_argument("--truth", type=int, default=8192, help="samples per pixel of a reference (%(default)s)")
    options.add_argument("--batches", action="store_true", help="compare numbers of batch means")
    options.add_argument("--scenes", nargs="+", default=[*SCENES, *HARD], help="(%(default)s)")
    options.add_argument("--samplers", nargs="+", default=SAMPLERS, help="(%(default)s)")
    args = options.parse_args()
    found, rows = begin(), {}
    if args.batches:
        finish(args, found, show_batches(args))
        return
    for name in args.scenes:
        scene = rt.load(ROOT / f"scenes/{name}.json")
        truth = reference(scene, (args.size, args.size), args.truth)
        for sampler in args.samplers:
            for spp in COUNTS:
                rows[name, sampler, spp] = row = measured(scene, truth, sampler, spp, args.rounds)
                show(f"{name} {sampler} {spp}: {row}")
    show(f"Coverage; true value above, below the interval; stated / actual error, sRGB, linear; {args.rounds} seeds:\n")
    plain = [name for name in args.scenes if name not in HARD] or args.scenes
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
