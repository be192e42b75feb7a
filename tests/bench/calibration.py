"""Check the errors that renders state, against references: seeds, scenes, samplers and numbers of samples.

Coverage is the share of pixels whose 95 % interval contains the true value. It is printed for all pixels, and for those
with an edge: a pixel that is black in the reference is covered trivially.
"""

from typing import Any

import numpy as np
from harness import ROOT, begin, finish, parser, show, table

import raytrace as rt
from raytrace.image.metrics import screen
from raytrace.passes.edges import weigh
from raytrace.passes.estimate import LUMINANCE, MODELS
from raytrace.passes.film import make_film
from raytrace.records import Scene, Window
from raytrace.rendering.adaptive import AdaptiveSampler
from raytrace.rendering.work_items import curve

SCENES = "cornell-box", "room", "glass-sphere"
SAMPLERS = "sobol", "stratified", "independent"
COUNTS = 4, 8, 16, 64, 256  # samples per pixel
TARGETS = {"cornell-box": (1e-3, 4e-4, 1.4e-4), "room": (4e-3, 2e-3, 1e-3), "glass-sphere": (2e-3, 1e-3, 4e-4)}
T = {1: 12.706, 2: 4.303, 3: 3.182}  # Student's t, 97.5 %, by degrees of freedom
TRUTH, TRUTH_SEED = 4096, 10**6
BEND = 0.02  # second difference of sRGB luminance to two opposite neighbours (five 8-bit steps) that counts as an edge


def rmse(image: Any, truth: np.ndarray) -> float:
    """Root of the mean squared error on a screen."""
    return float(np.sqrt(np.mean((screen(image.rgb) - screen(truth)) ** 2)))


def with_edges(truth: np.ndarray) -> np.ndarray:
    """Mask (h, w) of the pixels with an edge in the reference, chosen without looking at any estimate."""
    padded = np.pad(screen(truth) @ LUMINANCE, 1, "edge")
    height, width = truth.shape[:2]
    at = {(y, x): padded[1 + y : 1 + y + height, 1 + x : 1 + x + width] for y in (-1, 0, 1) for x in (-1, 0, 1)}
    second = [np.abs(at[y, x] + at[-y, -x] - 2 * at[0, 0]) for y, x in ((0, 1), (1, 0), (1, 1), (1, -1))]
    return np.max(second, axis=0) > BEND


def stated(scene: Scene, truth: np.ndarray, sampler: str, spp: int, seeds: int) -> dict[str, Any]:
    """Coverage of 95 % intervals, in all pixels and in those with an edge; stated over actual error of the image."""
    t = T[1 if sampler == "sobol" and spp < 8 else 3]  # mirrored pairs: four samples make one contrast
    held, at_edges, claimed, actual = [], [], [], []
    edge = with_edges(truth)
    for seed in range(seeds):
        image = rt.render(scene, spp=spp, size=truth.shape[1::-1], seed=seed, sampler=sampler)
        off = np.abs((image.rgb - truth) @ LUMINANCE)
        covered = off <= t * image.stderr + 1e-6  # rounding to float32
        held.append(np.mean(covered))
        at_edges.append(np.mean(covered[edge]))
        claimed.append(image.stats["estimated_error"] ** 2)
        actual.append(rmse(image, truth) ** 2)
    ratio = float(np.sqrt(np.mean(claimed) / np.mean(actual)))
    coverage = {"held": float(np.mean(held)), "held at edges": float(np.mean(at_edges))}
    return {"sampler": sampler, "spp": spp, **coverage, "stated / actual": ratio, "edges": float(edge.mean())}


def aimed(scene: Scene, truth: np.ndarray, target: float, seeds: int) -> dict[str, Any]:
    """Return what a target error gives, and how many samples uniform sampling would need for the same error."""
    ask = {"size": truth.shape[1::-1]}
    images = [rt.render(scene, target_error=target, seed=seed, **ask) for seed in range(seeds)]
    errors = [rmse(image, truth) for image in images]
    spp = float(np.mean([image.stats["samples"] / image.stderr.size for image in images]))
    alike = {
        n: np.mean([rmse(rt.render(scene, spp=n, seed=s, **ask), truth) for s in range(3)]) for n in (4, 16, 64, 256)
    }
    slope, start = np.polyfit(np.log(list(alike.values())), np.log(list(alike)), 1)
    actual = float(np.sqrt(np.mean(np.square(errors))))
    needed = float(np.exp(start) * actual**slope)
    most = max(int(image.aov["samples"].max()) for image in images)
    return {"target": target, "actual": actual, "worst": max(errors), "spp": spp, "most": most, "alike": needed}


def predicted(scene: Scene, truth: np.ndarray, seeds: int) -> dict[int, float]:
    """Return, by samples per pixel, error times samples^order over the neighbours' prediction for edges (``EDGE``)."""
    height, width = truth.shape[:2]
    window = Window(0, 0, width, height)
    at, model = curve(window), MODELS["sobol"]
    search = AdaptiveSampler(make_film(len(at)), at, window, model, target=1.0, cap=1)
    search.show(np.s_[:], screen(truth).reshape(-1, 3)[at].T)
    search._mark()
    known = np.zeros_like(search._known)
    known[1] = 1.0  # only the term for an edge between neighbours
    weigh(search._edges.reshape(-1), search._columns, known.reshape(-1), width, search._error)
    between = search._error[: len(at)].mean()
    found = {}
    for spp in COUNTS:
        images = [rt.render(scene, spp=spp, size=(width, height), seed=seed) for seed in range(seeds)]
        mse = np.mean([rmse(image, truth) ** 2 for image in images])
        found[spp] = float(mse * spp**model.order / between)
    return found


def main() -> None:
    options = parser(__doc__, rounds=8)
    options.add_argument("--size", type=int, default=96, help="pixels: side of the film (%(default)s)")
    args = options.parse_args()
    found, intervals, targets, edges = begin(), [], [], []
    for name in SCENES:
        scene = rt.load(ROOT / f"scenes/{name}.json")
        truth = rt.render(scene, spp=TRUTH, size=(args.size, args.size), seed=TRUTH_SEED).rgb.astype(np.float64)
        for sampler in SAMPLERS:
            rows = [stated(scene, truth, sampler, spp, args.rounds) for spp in COUNTS]
            intervals += [{"scene": name} | row for row in rows]
        targets += [{"scene": name} | aimed(scene, truth, target, args.rounds) for target in TARGETS[name]]
        edges.append([name, *predicted(scene, truth, args.rounds).values()])
    show(f"Coverage of 95 % intervals in all pixels, at edges; stated / actual error; {args.rounds} seeds:\n")
    shares = {row["scene"]: row["edges"] for row in intervals}
    cells = {
        (row["scene"], row["sampler"], row["spp"]): (
            f"{row['held']:.1%}, {row['held at edges']:.1%}, {row['stated / actual']:.2f}"
        )
        for row in intervals
    }
    table(
        ["sampler, spp", *SCENES],
        ([f"{s} {n}", *(cells[name, s, n] for name in SCENES)] for s in SAMPLERS for n in COUNTS),
    )
    share = ", ".join(f"{name} {100 * part:.0f} %" for name, part in shares.items())
    show(f"Pixels with an edge: {share}\n")
    show("Target errors; samples per pixel, mean and most, and what uniform sampling needs for the actual error:\n")
    table(list(targets[0]), (list(row.values()) for row in targets))
    show("Error of pixels times samples^order, over what the differences between neighbours predict for edges:\n")
    table(["spp", *map(str, COUNTS)], edges)
    finish(args, found, {"intervals": intervals, "targets": targets, "edges": edges})


if __name__ == "__main__":
    main()
