"""Time ``closest_point`` beside Open3D and libigl, which build their trees beforehand too.

    python tests/bench/closest_point.py [--points N] [--triangles N ...] [--threads N] [--rounds N] [--json FILE]

Tori with bumps, points in random order: in the bounding box, at a hundredth of the size from the surface, and ten times
the size away. Open3D is float32, libigl float64. All use the same number of threads.
"""

import os
from argparse import Namespace
from collections.abc import Callable

import harness
import numpy as np

import raytrace as rt
from raytrace.hardcases.meshes import torus


def bumpy(triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a torus with about so many triangles; bumps make distances differ."""
    sides = round(np.sqrt(triangles) / 2)
    vertices, faces = torus(2 * sides, sides)
    x, y, z = vertices.T
    return vertices * (1 + 0.03 * np.sin(17 * x + 3) * np.sin(13 * y) * np.cos(19 * z + 1))[:, None], faces


def point_sets(vertices: np.ndarray, faces: np.ndarray, n: int) -> dict[str, np.ndarray]:
    """Return points in random order, (n, 3) float32."""
    rng = np.random.default_rng(1)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = vertices[faces[rng.integers(len(faces), size=n)]]
    on = (rng.dirichlet((1, 1, 1), n)[..., None] * corners).sum(axis=1)
    away = rng.normal(size=(n, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    size = np.linalg.norm(high - low)
    sets = {
        "in the box": rng.uniform(low, high, (n, 3)),
        "near the surface": on + rng.normal(0, 0.01 * size, (n, 1)) * away,
        "far away": 10 * size * away,
    }
    return {name: points.astype(np.float32) for name, points in sets.items()}


def calls_of(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, threads: int
) -> dict[str, Callable[[], np.ndarray]]:
    """Return the calls to time, by name; those of raytrace and libigl return distances, or their squares."""
    import igl
    import open3d as o3d

    single, double = rt.BVH(vertices, faces), rt.BVH(vertices.astype(np.float32), faces, "float64")
    scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
    scene.add_triangles(o3d.core.Tensor(vertices.astype("f4")), o3d.core.Tensor(faces.astype("u4")))
    tree, corners, wide = igl.AABB(), vertices.astype(np.float32).astype(np.float64), points.astype(np.float64)
    tree.init(corners, faces)
    tensor = o3d.core.Tensor(points)
    return {
        "raytrace float32": lambda: single.closest_point(points, threads=threads).distance,
        "Open3D": lambda: scene.compute_closest_points(tensor, nthreads=threads)["points"].numpy(),
        "raytrace float64": lambda: double.closest_point(wide, threads=threads).distance,
        "libigl": lambda: tree.squared_distance(corners, faces, wide)[0],
    }


def measure(options: Namespace) -> list[dict[str, object]]:
    """Time all, and return rows of microseconds per point and ratios."""
    rows = []
    for triangles in options.triangles:
        vertices, faces = bumpy(triangles)
        for name, points in point_sets(vertices, faces, options.points).items():
            calls = calls_of(vertices, faces, points, options.threads)
            exact = calls["raytrace float64"]()
            assert np.abs(np.sqrt(calls["libigl"]()) - exact).max() <= 1e-12 * exact.max()
            assert np.abs(calls["raytrace float32"]() - exact).max() <= 1e-6 * exact.max()
            times = harness.interleave(calls, options.rounds)
            pace = {of: float(np.median(seconds)) / len(points) * 1e6 for of, seconds in times.items()}
            rows.append(
                {
                    "triangles": len(faces),
                    "points": name,
                    **{f"{of}, us": value for of, value in pace.items()},
                    "times Open3D": harness.times_faster(times["raytrace float32"], times["Open3D"]),
                    "float32 times libigl": harness.times_faster(times["raytrace float32"], times["libigl"]),
                    "float64 times libigl": harness.times_faster(times["raytrace float64"], times["libigl"]),
                }
            )
    return rows


def main() -> None:
    parser = harness.parser(__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=200_000, help="points per set (%(default)s)")
    parser.add_argument("--triangles", type=int, nargs="+", default=[10_000, 1_000_000], help="of each mesh")
    parser.add_argument("--threads", type=int, default=2, help="of each library (%(default)s)")
    options = parser.parse_args()
    os.environ["IGL_NUM_THREADS"] = str(options.threads)  # libigl reads it once
    about = harness.begin()
    rows = measure(options)
    harness.table(list(rows[0]), [list(row.values()) for row in rows])
    harness.finish(options, about, rows)


if __name__ == "__main__":
    main()
