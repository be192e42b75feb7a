"""Judge all hits, crossings and points inside by exact arithmetic, on aimed rays and points; no fault is allowed.

``python tests/bench/query_oracle.py`` prints a table; exit code 1 if any answer is wrong.
"""

import sys
from pathlib import Path

import numpy as np
from harness import begin, finish, parser, show, table

import raytrace as rt
from raytrace.hardcases.closed_meshes import CLOSED_MESHES, aimed_points, aimed_rays
from raytrace.hardcases.meshes import Mesh
from raytrace.hardcases.query_oracle import INSIDE, SURFACE, HitJudge, inside_exactly

SCALES = (-12, -6, 0, 6, 12)  # powers of ten that meshes are multiplied by
HEADER = (
    "mesh",
    "precision",
    "scale",
    "rays",
    "parity",
    "lost",
    "false",
    "order",
    "t error",
    "hit faults",
    "points",
    "wrong",
)


def trimesh_meshes(folder: Path | None) -> dict[str, Mesh]:
    """Closed meshes of trimesh: its primitives, and the closed models of at most 500 triangles in a folder."""
    import trimesh

    made = {
        "trimesh icosphere": trimesh.creation.icosphere(2),
        "trimesh box": trimesh.creation.box(),
        "trimesh cylinder": trimesh.creation.cylinder(0.5, 2.0, sections=20),
        "trimesh torus": trimesh.creation.torus(1.0, 0.3, 16, 12),
        "trimesh capsule": trimesh.creation.capsule(1.0, 0.4, count=(12, 12)),
        "trimesh annulus": trimesh.creation.annulus(0.3, 0.6, 1.0, sections=16),
    }
    for path in sorted(folder.iterdir()) if folder else ():
        try:
            loaded = trimesh.load(path, force="mesh", process=False)
        except Exception:  # noqa: BLE001  (other files lie there too)
            continue
        if 0 < len(getattr(loaded, "faces", ())) <= 500:
            made[path.name] = loaded
    meshes = {}
    for name, mesh in made.items():
        rng = np.random.default_rng(len(meshes))  # duplicate all vertices, and shuffle them
        order = rng.permutation(3 * len(mesh.faces))
        corners, faces = np.empty((len(order), 3)), order.reshape(-1, 3)
        corners[order] = np.asarray(mesh.vertices)[np.asarray(mesh.faces).ravel()]
        meshes[name] = (corners, faces)
    return meshes


def judge(mesh: Mesh, precision: str, seed: int, n: int) -> tuple:
    """One row of the table; None where the mesh is not closed in that precision."""
    bvh = rt.BVH(*mesh, precision)
    points = aimed_points(mesh, precision, seed, n)
    try:
        found = bvh.contains(points)
    except ValueError:
        return ()
    corners = bvh.vertices[bvh.faces]
    o, d = aimed_rays(mesh, precision, seed + 100, n)
    judge = HitJudge(corners, o, d)
    crossings = judge.of_crossings(bvh.all_hits(o, d, crossings=True))
    assert np.array_equal(bvh.count_hits(o, d, crossings=True), np.diff(bvh.all_hits(o, d, crossings=True).start))
    hits = judge.of_hits(bvh.all_hits(o, d))
    exact = inside_exactly(corners, points)
    wrong = int((found != ((exact == INSIDE) | (exact == SURFACE))).sum())
    return len(o), *crossings, sum(hits[1:4]), len(points), wrong


def main() -> int:
    made = parser(__doc__)
    made.add_argument("-n", type=int, default=1500, help="rays and points per mesh, precision and scale (%(default)s)")
    made.add_argument("--models", type=Path, help="folder of trimesh's models")
    args = made.parse_args()
    found, rows, total = begin(), [], np.zeros(3, int)
    meshes = {name: make() for name, make in CLOSED_MESHES.items()} | trimesh_meshes(args.models)
    for seed, (name, (vertices, faces)) in enumerate(meshes.items()):
        for precision in ("float32", "float64"):
            for scale in SCALES:
                row = judge((vertices * 10.0**scale, faces), precision, 1000 * seed + scale + 12, args.n)
                if not row:
                    show(f"{name}, {precision}, 1e{scale}: not closed")
                    continue
                rows.append((name, precision, f"1e{scale}", *row))
                total += [row[0], row[7], sum(row[1:5]) + row[6] + row[8]]
    table(HEADER, rows)
    show(f"{total[0]:,} rays and {total[1]:,} points, {total[2]} faults")
    finish(args, found, rows)
    return int(total[2] > 0)


if __name__ == "__main__":
    sys.exit(main())
