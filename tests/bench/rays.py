"""Millions of rays per second of ``rt.BVH`` and of its peers, on the same rays, interleaved in one run."""

from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Ours, available
from workloads import MESHES, RaySet, ray_sets

# embreex holds the interpreter's lock, and is compared in one thread only
COLUMNS = "raytrace", "raytrace, row-major", "Open3D", "Mitsuba", "Mitsuba, coherent", "embreex"
DIFFERENT = 1e-3  # share of rays whose answers may differ (edges, and spheres' grazing rays) before it is said


def measure(tracers: list[Any], rays: RaySet, threads: int, rounds: int) -> dict[str, Any]:
    """Rates in millions of rays a second, and how many times ours is each of them."""
    calls, hits = {}, {}
    for tracer in tracers:
        made = tracer.calls(rays, threads)
        calls |= made
        hits |= {name: tracer.hits(call()) for name, call in made.items()}
    seconds = interleave(calls, rounds)
    return {
        "rays": rays.name,
        "threads": threads,
        "count": len(rays.o),
        "hits": hits,
        "mrays": {name: len(rays.o) / 1e6 / float(np.median(times)) for name, times in seconds.items()},
        "ratio": {name: times_faster(seconds["raytrace"], times) for name, times in seconds.items()},
    }


def better_mitsuba(ratio: dict[str, float]) -> float | None:
    found = [value for name, value in ratio.items() if name.startswith("Mitsuba")]
    return min(found) if found else None


def print_results(results: list[dict[str, Any]]) -> None:
    show("Millions of rays per second, and ours times the peer (Mitsuba: its better setting):\n")
    header = ["mesh", "rays", "threads", *COLUMNS, "x Open3D", "x Mitsuba", "x embreex"]
    table(header, ([row["mesh"], row["rays"], row["threads"], *(row["mrays"].get(name) for name in COLUMNS),
                    row["ratio"].get("Open3D"), better_mitsuba(row["ratio"]), row["ratio"].get("embreex")]
                   for row in results))  # fmt: skip
    show("Work of a ray (a packet's counts once for all its rays), and the share that hit:\n")
    once = [row for row in results if row["threads"] == results[0]["threads"]]
    table(["mesh", "rays", "nodes", "triangles", "hit"],
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
