"""Measure the ray queries of trimesh, answered by raytrace, by embreex and by trimesh's own code (rtree)."""

import numpy as np
import trimesh
from harness import begin, finish, interleave, parser, show, table, times_faster
from trimesh.ray.ray_pyembree import RayMeshIntersector as WithEmbree
from trimesh.ray.ray_triangle import RayMeshIntersector as Pure

from raytrace.adapters.trimesh import RayMeshIntersector

FEW = 300  # rays or points for trimesh's own code


def main() -> None:
    options = parser(__doc__, 5)
    options.add_argument("--subdivisions", type=int, default=5, help="of the sphere: 20 * 4^n triangles (%(default)s)")
    options.add_argument("--rays", type=int, default=20000, help="rays or points per query (%(default)s)")
    args = options.parse_args()
    found = begin()
    mesh = trimesh.creation.icosphere(subdivisions=args.subdivisions)
    rng = np.random.default_rng(1)
    o = rng.normal(size=(args.rays, 3))
    o *= 2 / np.linalg.norm(o, axis=1)[:, None]
    d = rng.uniform(-0.8, 0.8, (args.rays, 3)) - o
    p = rng.uniform(-1, 1, (args.rays, 3))
    others = {"embreex": WithEmbree(mesh), "trimesh": Pure(mesh)}
    rows = []
    for query, inputs in {
        "intersects_id": (o, d),
        "intersects_location": (o, d),
        "intersects_first": (o, d),
        "intersects_any": (o, d),
        "contains_points": (p,),
    }.items():
        each = {"one thread": RayMeshIntersector(mesh, threads=1), "raytrace": RayMeshIntersector(mesh)} | others
        sizes = {name: FEW if name == "trimesh" else args.rays for name in each}
        calls = {name: bound(getattr(ray, query), inputs, sizes[name]) for name, ray in each.items()}
        seconds = {name: times / sizes[name] for name, times in interleave(calls, args.rounds).items()}
        nanoseconds = [float(np.median(times)) * 1e9 for times in seconds.values()]
        ratios = [times_faster(seconds["one thread"], seconds["embreex"])]
        ratios += [times_faster(seconds["raytrace"], seconds[other]) for other in others]
        rows.append([query, *nanoseconds, *ratios])
    show(
        f"Nanoseconds per ray or point; a sphere of {len(mesh.faces)} triangles. embreex and trimesh use one thread:\n"
    )
    header = [
        *("query", "raytrace, 1 thread", "raytrace, all", "embreex", "trimesh"),
        *("1 thread: faster than embreex", "all: faster than embreex", "all: faster than trimesh"),
    ]
    table(header, rows)
    finish(args, found, [dict(zip(header, row, strict=True)) for row in rows])


def bound(query, inputs, n):
    inputs = [array[:n] for array in inputs]
    return lambda: query(*inputs)


if __name__ == "__main__":
    main()
