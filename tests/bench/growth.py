"""Time per camera ray, and to build, as one shape is cut into ever more triangles."""

from pathlib import Path
from typing import Any

import numpy as np
from harness import begin, finish, interleave, parser, show, table
from workloads import Mesh, ray_sets

import raytrace as rt


def bumpy(triangles: int) -> Mesh:
    """A displaced sphere on a grid of latitude and longitude."""
    n = round(np.sqrt(triangles / 4))
    theta, phi = np.pi * np.arange(n + 1)[:, None] / n, np.pi * np.arange(2 * n) / n
    x, y, z = np.sin(theta) * np.cos(phi), np.cos(theta) + 0 * phi, np.sin(theta) * np.sin(phi)
    p = np.stack([x, y, z], -1) * (0.9 + 0.07 * np.sin(9 * x) * np.sin(7 * y) * np.sin(8 * z))[..., None]
    row, column = (a.ravel() for a in np.mgrid[0:n, 0 : 2 * n])
    right = (column + 1) % (2 * n)
    a, b, c, d = row * 2 * n + column, row * 2 * n + right, (row + 1) * 2 * n + column, (row + 1) * 2 * n + right
    faces = np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
    return Mesh("bumpy", p.reshape(-1, 3).astype("f4"), faces.astype("i4"), (0, 0, 3), 0.36, (-2, 3, 4))


def measure(triangles: int, rounds: int) -> dict[str, Any]:
    mesh = bumpy(triangles)
    build = float(np.median(interleave({"build": lambda: rt.BVH(mesh.vertices, mesh.faces)}, 1)["build"]))
    bvh = rt.BVH(mesh.vertices, mesh.faces)
    rays = next(rays for rays in ray_sets(mesh) if rays.name == "camera, blocks")
    o, d = np.asfortranarray(rays.o), np.asfortranarray(rays.d)
    seconds = np.median(interleave({"trace": lambda: bvh.closest_hit(o, d)}, rounds)["trace"])
    return {"triangles": len(mesh.faces), "build_seconds": build, "ns_per_ray": 1e9 * float(seconds) / len(o)}


def plot(results: list[dict[str, Any]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure((6, 3.6), layout="constrained")
    axes = figure.add_subplot()
    count, ns = (np.array([row[key] for row in results]) for key in ("triangles", "ns_per_ray"))
    axes.plot(count, ns, "o-", label="camera rays")
    axes.plot(count, ns[0] * np.log2(count) / np.log2(count[0]), "k:", label="log n, through the first")
    axes.set(xscale="log", ylim=0, xlabel="triangles", ylabel="ns per ray, all cores")
    axes.legend()
    figure.savefig(path)
    show(f"wrote {path}")


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--most", type=float, default=1e7, metavar="N", help="triangles of the finest (%(default)g)")
    options.add_argument("--plot", type=Path, metavar="FILE", help="draw the curve (needs matplotlib)")
    args = options.parse_args()
    found = begin()
    steps = np.arange(4, np.log10(args.most) + 0.01, 0.5)
    results = [measure(int(10**step), args.rounds) for step in steps]
    first = results[0]
    table(["triangles", "build, s", "ns per ray", "times the first", "log n would be"],
          ([f"{row['triangles']:,}", row["build_seconds"], row["ns_per_ray"], row["ns_per_ray"] / first["ns_per_ray"],
            float(np.log(row["triangles"]) / np.log(first["triangles"]))] for row in results))  # fmt: skip
    if args.plot:
        plot(results, args.plot)
    finish(args, found, results)


if __name__ == "__main__":
    main()
