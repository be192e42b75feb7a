"""Feature lines of a mesh: boundary edges, creases and the outline in a view direction."""

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Mesh

CREASE = np.cos(np.radians(30))  # cosine of the angle between neighbours from which an edge is a crease
MAX_LINES = 20_000  # only the longest are drawn


def feature_lines(mesh: Mesh, direction: NDArray[np.floating]) -> NDArray[np.float64]:
    """Feature lines of a mesh seen along a direction: (k, 2, 3), world units.

    These are edges of a single triangle, edges whose triangles differ by more than 30 degrees, and edges between a
    triangle that faces the viewer and one that does not.
    """
    points, number = np.unique(mesh.vertices, axis=0, return_inverse=True)  # objects that touch share vertices
    faces = number.reshape(-1)[mesh.faces]
    normal = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(length > 0, length, 1)
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, owner = pairs[order], order // 3
    first = np.r_[True, (pairs[1:] != pairs[:-1]).any(axis=1)]
    start = np.flatnonzero(first)
    count = np.diff(np.r_[start, len(pairs)])
    one, other = normal[owner[start]], normal[owner[np.minimum(start + 1, len(pairs) - 1)]]
    sharp = np.abs((one * other).sum(axis=1)) < CREASE
    outline = (one @ direction) * (other @ direction) * np.sign((one * other).sum(axis=1)) < 0
    lines = points[pairs[start[(count != 2) | sharp | outline]]]
    longest = np.argsort(-np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1), kind="stable")
    return lines[longest[:MAX_LINES]]
