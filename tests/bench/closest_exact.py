"""Check ``closest_point`` in exact arithmetic: points aimed at vertices, edges and faces of hard meshes.

    python tests/bench/closest_exact.py [--points N] [--json FILE]

Each mesh has at most 120 triangles. For each point, the exact distances of all triangles that float64 cannot exclude
are computed as ratios of integers. Exits with 1 if an answer breaks a promise of ``closest_point``.
"""

import sys
import zlib
from pathlib import Path
from typing import Any

import harness
import numpy as np

import raytrace as rt

sys.path.insert(0, str(Path(__file__).parents[1]))
import exact_points

SCALES = 1.0, 1e-12, 1e12
HEADER = "precision", "mesh", "points", "p, eps R", "distance, eps R", "not rounded", "not the lowest"


def check(precision: str, name: str, n: int) -> list[Any]:
    """Return one row: the largest errors and the numbers of answers that differ, over all scales."""
    verdicts = []
    for k, scale in enumerate(SCALES):
        corners = exact_points.usable(name, scale, precision)
        bvh = rt.BVH(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), precision)
        points = exact_points.aimed(corners, n, zlib.crc32(name.encode()) + k, precision)
        verdicts.append(exact_points.judge(corners, points, bvh.closest_point(points), precision))
    points, p, distance, not_rounded, not_lowest = zip(*verdicts, strict=True)
    return [precision, name, sum(points), float(max(p)), float(max(distance)), int(sum(not_rounded)), sum(not_lowest)]


def main() -> int:
    parser = harness.parser(__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=1000, help="per mesh, scale and precision (%(default)s)")
    options = parser.parse_args()
    about = harness.begin()
    names = [(precision, name) for precision in ("float32", "float64") for name in exact_points.MESHES]
    rows = [check(precision, name, options.points) for precision, name in names]
    harness.table(HEADER, rows)
    harness.show(f"{sum(row[2] for row in rows):,} points")
    harness.finish(options, about, rows)
    return int(any(row[3] > 4 or row[4] > 4 or row[5] or row[6] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
