"""Compare trees with and without divided triangles, and Mitsuba, on buildings: one thread, the same rays, in turn."""

from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table, times_faster
from peers import Mitsuba, Ours, Whole, available
from workloads import building, ray_sets


def measure(triangles: int, rounds: int, peers: list[type]) -> list[dict[str, Any]]:
    mesh = building(triangles)
    tracers = [Ours(mesh), Whole(mesh), *(peer(mesh) for peer in peers)]
    for tracer in tracers[:2]:
        show(f"{tracer.name}: {tracer.bvh.stats}")
    results = []
    for rays in ray_sets(mesh):
        made = [tracer.calls(rays, 1) for tracer in tracers]
        calls = {"divided": made[0][Ours.name], "whole": made[1][Whole.name]}
        for others in made[2:]:
            calls |= others
        answers = [np.atleast_2d(calls[name]()) for name in ("divided", "whole")]
        seconds = interleave(calls, rounds)
        results.append({
            "triangles": len(mesh.faces),
            "rays": rays.name,
            "same bits": str(np.array_equal(*answers)),
            "counts": [tracer.counts(rays) for tracer in tracers[:2]],
            "ns": {name: 1e9 * float(np.median(times)) / len(rays.o) for name, times in seconds.items()},
            "ratio": {name: times_faster(seconds["divided"], times) for name, times in seconds.items()},
        })  # fmt: skip
    return results


def main() -> None:
    options = parser(__doc__, rounds=5)
    options.add_argument("--triangles", type=int, nargs="+", default=[100_000, 350_000, 1_000_000])
    args = options.parse_args()
    found = begin()
    peers, missing = available()
    if Mitsuba.name in missing:
        show(f"missing: Mitsuba: {missing[Mitsuba.name]}")
    results = [
        row for n in args.triangles for row in measure(n, args.rounds, [peer for peer in peers if peer is Mitsuba])
    ]
    show("ns per ray, speed relative to whole triangles and to Mitsuba's better setting, and work per ray:\n")
    table(["triangles", "rays", "divided, ns", "whole, ns", "x whole", "x Mitsuba", "nodes", "tests", "nodes, whole",
           "tests, whole", "same bits"],
          ([f"{row['triangles']:,}", row["rays"], row["ns"]["divided"], row["ns"]["whole"], row["ratio"]["whole"],
            min((ratio for name, ratio in row["ratio"].items() if name.startswith("Mitsuba")), default=None),
            *row["counts"][0], *row["counts"][1], row["same bits"]] for row in results))  # fmt: skip
    finish(args, found, results)


if __name__ == "__main__":
    main()
