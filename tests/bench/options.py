"""Measure the cost of the options of ``rt.BVH``: precision, triangle test, split, threads; interleaved in one run."""

from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Ours
from workloads import MESHES, Mesh, RaySet, ray_sets

SETS = "camera, blocks", "shadow, blocks", "bounce, random"
VARIANTS: dict[str, dict[str, str]] = {
    "plain": {},
    "float64": {"precision": "float64"},
    "moller-trumbore": {"triangle": "moller-trumbore"},
    "median": {"split": "median"},
}
# heading -> speed of the first over that of the second
RATIOS = {
    "float64 / float32": ("float64", "plain"),
    "watertight / moller-trumbore": ("plain", "moller-trumbore"),
    "sah / median": ("plain", "median"),
    "2 threads / 1": ("plain", "one thread"),
}


def measure(tracers: dict[str, Ours], mesh: Mesh, rays: RaySet, rounds: int) -> dict[str, Any]:
    calls = {name: tracer.calls(rays, 2)["raytrace"] for name, tracer in tracers.items()}
    calls["one thread"] = tracers["plain"].calls(rays, 1)["raytrace"]
    seconds = interleave(calls, rounds)
    return {
        "mesh": mesh.name,
        "rays": rays.name,
        "mrays": {name: len(rays.o) / 1e6 / float(np.median(times)) for name, times in seconds.items()},
        "ratio": {name: times_faster(seconds[a], seconds[b]) for name, (a, b) in RATIOS.items()},
    }


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--meshes", nargs="+", choices=MESHES, default=list(MESHES))
    args = options.parse_args()
    found = begin()
    results = []
    for name in args.meshes:
        mesh = MESHES[name]()
        tracers = {variant: Ours(mesh, **chosen) for variant, chosen in VARIANTS.items()}
        results += [measure(tracers, mesh, rays, args.rounds) for rays in ray_sets(mesh) if rays.name in SETS]
    show("Speed of the first over that of the second, column-major rays:\n")
    table(["mesh", "rays", *RATIOS], ([row["mesh"], row["rays"], *row["ratio"].values()] for row in results))
    finish(args, found, results)


if __name__ == "__main__":
    main()
