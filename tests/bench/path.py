"""Path tracing beside Mitsuba 3 (``path``): paths per second, and the time to an equal error; interleaved."""

import json
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, begin, finish, interleave, parser, show, table
from peer_pictures import peer_picture
from peers import available, mitsuba

import raytrace as rt
from raytrace.image.files import srgb_encode

TOLERANCE = 6.5e-5  # of the ball: about 100,000 triangles
MITSUBA = "independent", "stratified", "multijitter", "ldsampler"


def displayed(image: Any) -> np.ndarray:
    """SRGB in 0..1."""
    return srgb_encode(np.clip(np.asarray(image, np.float64), 0, 1))


def rmse(image: Any, reference: np.ndarray) -> float:
    """Root mean square error as displayed."""
    return float(np.sqrt(np.mean((displayed(image) - reference) ** 2)))


def seconds_to(error: float, errors: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    """Seconds (rounds,) to an error: log-log interpolation between the sample counts, extrapolated at the ends."""
    logs = np.log(errors)
    k = int(np.clip(np.searchsorted(-logs, -np.log(error)), 1, len(logs) - 1))
    share = (np.log(error) - logs[k - 1]) / (logs[k] - logs[k - 1])
    return np.exp(np.log(seconds[:, k - 1]) * (1 - share) + np.log(seconds[:, k]) * share)


def interval(ratios: np.ndarray) -> str:
    """Median of ratios, and the 95 % interval of the median from their order statistics."""
    ordered, n = np.sort(ratios), len(ratios)
    low = max(int(np.floor(n / 2 - 0.98 * np.sqrt(n))), 0)
    return f"{np.median(ratios):.2f} [{ordered[low]:.2f}, {ordered[n - 1 - low]:.2f}]"


def with_ball(path: Path) -> dict[str, Any]:
    """A scene whose blocks are replaced by a ball."""
    data = json.loads(Path(path).read_text("utf-8"))
    data["objects"] = [each for each in data["objects"] if not each["mesh"].endswith(("short.obj", "tall.obj"))]
    for each in data["objects"]:
        each["mesh"] = str(Path(path).parent / each["mesh"])
    ball = {"center": [0, 0.7, 0], "radius": 0.6, "tolerance": TOLERANCE}
    data["objects"].append({"sphere": ball, "material": "grey"})
    return data


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--scene", default=ROOT / "scenes/cornell-box-area.json", help="diffuse meshes and lamps")
    options.add_argument("--size", type=int, default=256, help="pixels: side of the film (%(default)s)")
    options.add_argument("--spp", type=int, nargs="+", default=[64, 256, 1024], help="samples per pixel (%(default)s)")
    options.add_argument("--errors", type=float, nargs="+", default=[1e-2, 5e-3], help="RMSE in sRGB (%(default)s)")
    options.add_argument("--reference", type=int, default=16384, help="samples of the reference (%(default)s)")
    options.add_argument("--ball", action="store_true", help="a ball of 100,000 triangles in place of the blocks")
    args = options.parse_args()
    found, size = begin(), (args.size, args.size)
    scene = rt.load(with_ball(args.scene) if args.ball else args.scene, root=ROOT)
    show(f"{len(scene.mesh.faces):,} triangles\n")
    draws: dict[str, Callable[[int, int], Any]] = {
        f"raytrace, {name}": lambda spp, seed, name=name: (
            rt.render(scene, spp=spp, size=size, seed=seed, sampler=name, threads=2).rgb
        )
        for name in ("sobol", "independent")
    }
    if "Mitsuba" in [peer.name for peer in available()[0]]:
        import drjit

        drjit.set_thread_count(2) if mitsuba() else None
        draws |= {f"Mitsuba, {name}": peer_picture(scene, size, name) for name in MITSUBA}
    halves = [rt.render(scene, spp=args.reference // 2, size=size, seed=1000 + k).rgb for k in range(2)]
    reference = displayed((halves[0] + halves[1]) / 2)
    show(f"error of the reference itself: {rmse(halves[0], displayed(halves[1])) / 2:.2g}\n")
    seeds, calls = count(), {}
    for name, draw in draws.items():
        for spp in args.spp:
            calls[name, spp] = lambda draw=draw, spp=spp: draw(spp, next(seeds))
    taken = interleave(calls, args.rounds)
    seconds = {name: np.column_stack([taken[name, spp] for spp in args.spp]) for name in draws}
    errors = {
        name: np.array([np.mean([rmse(draw(spp, 5000 + k), reference) for k in range(2)]) for spp in args.spp])
        for name, draw in draws.items()
    }
    report(args, draws, seconds, errors)
    finish(args, found, {name: {"seconds": s.tolist(), "rmse": errors[name].tolist()} for name, s in seconds.items()})


def report(args: Any, draws: Any, seconds: dict[str, np.ndarray], errors: dict[str, np.ndarray]) -> None:
    """Print paths per second, and times to equal errors; ratios are over those of our default sampler."""
    ours, last = next(iter(draws)), len(args.spp) - 1
    rates = {name: args.size**2 * args.spp[last] / 1e6 / s[:, last] for name, s in seconds.items()}
    table(
        ["renderer, sampler", "million paths/s", "our rate / this", *(f"RMSE, {spp} spp" for spp in args.spp)],
        (
            [name, float(np.median(rates[name])), interval(rates[ours] / rates[name]), *map(float, errors[name])]
            for name in draws
        ),
    )
    for error in args.errors:
        times = {name: seconds_to(error, errors[name], seconds[name]) for name in draws}
        table(
            [f"to RMSE {error:g}", "seconds", "seconds / ours"],
            ([name, float(np.median(times[name])), interval(times[name] / times[ours])] for name in draws),
        )


if __name__ == "__main__":
    main()
