"""Measure millions of rays per second of ``rt.BVH`` and of other ray tracers, on the same rays, interleaved.

Camera and shadow rays come in rows of pixels, as NumPy programs make them, and in blocks of 4 x 4 pixels, which are
more coherent. Bounces come in random order. Mitsuba has its default, non-robust intersection, which is the faster one.
"""

from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Ours, available
from workloads import MESHES, RaySet, ray_sets

# embreex holds the global interpreter lock, so it is compared in one thread only: it has no column with two
COLUMNS = "raytrace", "raytrace, row-major", "Open3D", "Mitsuba", "Mitsuba, coherent", "embreex"
PAUSE = 0.003  # seconds before each call, in which the threads of the last tracer end their waiting loops
DIFFERENT = 1e-3  # share of hits that may differ (edges, grazing rays of spheres) before it is reported


def measure(tracers: list[Any], rays: RaySet, threads: int, rounds: int) -> dict[str, Any]:
    """Return rates in millions of rays per second, and the ratio of ours to each."""
    calls, hits = {}, {}
    for tracer in tracers:
        made = tracer.calls(rays, threads)
        calls |= made
        hits |= {name: tracer.hits(call()) for name, call in made.items()}
    seconds = interleave(calls, rounds, PAUSE)
    return {
        "rays": rays.name,
        "threads": threads,
        "count": len(rays.o),
        "hits": hits,
        "mrays": {name: len(rays.o) / 1e6 / float(np.median(times)) for name, times in seconds.items()},
        "ratio": {name: times_faster(seconds["raytrace"], times) for name, times in seconds.items()},
    }


def better_mitsuba(ratio: dict[str, float]) -> float | None:
    """Return the ratio to the faster of Mitsuba's two settings."""
    found = [value for name, value in ratio.items() if name.startswith("Mitsuba")]
    return min(found) if found else None


def print_results(results: list[dict[str, Any]]) -> None:
    show("Millions of rays per second, and speed relative to the other (Mitsuba: its better setting):\n")
    show("embreex runs in one thread, on all rays, and is compared with one thread of ours.\n")
    header = ["mesh", "rays", "threads", *COLUMNS, "x Open3D", "x Mitsuba", "x embreex"]
    table(header, ([row["mesh"], row["rays"], row["threads"], *(row["mrays"].get(name) for name in COLUMNS),
                    row["ratio"].get("Open3D"), better_mitsuba(row["ratio"]), row["ratio"].get("embreex")]
                   for row in results))  # fmt: skip
    show("Work per ray (that of a packet counts once for all its rays), and the share of hits:\n")
    once = [row for row in results if row["threads"] == results[0]["threads"]]
    table(["mesh", "rays", "nodes per ray", "triangles per ray", "hit"],
          ([row["mesh"], row["rays"], *row["counts"], row["hits"]["raytrace"]] for row in once))  # fmt: skip
    for row in once:
        for name, share in row["hits"].items():
            if abs(share - row["hits"]["raytrace"]) > DIFFERENT:
                show(f"{row['mesh']}, {row['rays']}: {name} hits {share:.4f}, raytrace {row['hits']['raytrace']:.4f}")


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--threads", type=int, nargs="+", default=[2, 1])
    options.add_argument("--meshes", nargs="+", choices=MESHES, default=list(MESHES))
    args = options.parse_args()
    found = begin()
    peers, missing = available()
    for name, reason in missing.items():
        show(f"missing: {name}: {reason}")
    results = []
    for name in args.meshes:
        mesh = MESHES[name]()
        tracers = [tracer(mesh) for tracer in (Ours, *peers)]
        for rays in ray_sets(mesh):
            counts = tracers[0].counts(rays)
            for threads in args.threads:
                row = {"mesh": name, "counts": counts, **measure(tracers, rays, threads, args.rounds)}
                results.append(row)
                rates = ", ".join(f"{who} {rate:.3g}" for who, rate in row["mrays"].items())
                show(f"{name}, {rays.name}, {threads} threads: {rates}")
    show()
    print_results(results)
    finish(args, found, results)


if __name__ == "__main__":
    main()
