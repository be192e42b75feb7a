"""Measure the time per camera ray and per build for one shape with a growing number of triangles.

``docs/pictures/plots.py`` makes the table and the plot of docs/benchmarks.md from what ``--json`` writes.
"""

import time
from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table
from peers import Ours, available
from workloads import Mesh, ray_sets

from raytrace.parallel import thread_count

NAMES = "raytrace", "Open3D", "Mitsuba", "Mitsuba, coherent"


def bumpy(triangles: int) -> Mesh:
    """Return a displaced sphere on a grid of latitude and longitude."""
    n = round(np.sqrt(triangles / 4))
    theta, phi = np.pi * np.arange(n + 1)[:, None] / n, np.pi * np.arange(2 * n) / n
    x, y, z = np.sin(theta) * np.cos(phi), np.cos(theta) + 0 * phi, np.sin(theta) * np.sin(phi)
    p = np.stack([x, y, z], -1) * (0.9 + 0.07 * np.sin(9 * x) * np.sin(7 * y) * np.sin(8 * z))[..., None]
    row, column = (a.ravel() for a in np.mgrid[0:n, 0 : 2 * n])
    right = (column + 1) % (2 * n)
    a, b, c, d = row * 2 * n + column, row * 2 * n + right, (row + 1) * 2 * n + column, (row + 1) * 2 * n + right
    faces = np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
    return Mesh("bumpy", p.reshape(-1, 3).astype("f4"), faces.astype("i4"), (0, 0, 3), 0.36, (-2, 3, 4))


def measure(triangles: int, rounds: int, peers: list[type]) -> dict[str, Any]:
    mesh = bumpy(triangles)
    rays = next(rays for rays in ray_sets(mesh) if rays.name == "camera, blocks")
    began = time.perf_counter()
    tracers = [Ours(mesh)]
    build = time.perf_counter() - began
    tracers += [peer(mesh) for peer in peers]
    calls = {name: call for tracer in tracers for name, call in tracer.calls(rays, thread_count(None)).items()}
    seconds = interleave({name: calls[name] for name in NAMES if name in calls}, rounds)
    ns = {name: 1e9 * float(np.median(times)) / len(rays.o) for name, times in seconds.items()}
    return {"triangles": len(mesh.faces), "build_seconds": build, "ns_per_ray": ns}


def main() -> None:
    options = parser(__doc__)
    options.add_argument(
        "--most", type=float, default=1e7, metavar="N", help="triangles of the finest mesh (%(default)g)"
    )
    args = options.parse_args()
    found = begin()
    peers, missing = available()
    peers = [peer for peer in peers if peer.name in NAMES]
    for name in set(missing) & set(NAMES):
        show(f"missing: {name}: {missing[name]}")
    steps = np.arange(4, np.log10(args.most) + 0.01, 0.5)
    results = [measure(int(10**step), args.rounds, peers) for step in steps]
    first = results[0]
    names = list(first["ns_per_ray"])
    show("Nanoseconds per camera ray, in blocks of 4 x 4 pixels:\n")
    table(["triangles", "our build, s", *names, "raytrace / its first", "log n / its first"],
          ([f"{row['triangles']:,}", row["build_seconds"], *row["ns_per_ray"].values(),
            row["ns_per_ray"]["raytrace"] / first["ns_per_ray"]["raytrace"],
            float(np.log(row["triangles"]) / np.log(first["triangles"]))] for row in results))  # fmt: skip
    finish(args, found, results)


if __name__ == "__main__":
    main()
