"""Whether a mesh is closed: edges are matched by the exact positions of their ends, not by numbers of vertices."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MIX = 0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9  # odd numbers that mix the bits of coordinates


class OpenEdges(NamedTuple):
    """Edges that are a side of an odd number of triangles."""

    count: int
    first: tuple[NDArray[np.floating], NDArray[np.floating]] | None  # its ends; None: the mesh is closed
    triangle: int  # a row of the faces that has it as a side; -1: the mesh is closed


def open_edges(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> OpenEdges:
    """Find the edges whose two ends differ and that are a side of an odd number of triangles, with multiplicity."""
    corners = point_numbers(vertices)[faces]
    a, b = corners.T.reshape(-1), np.roll(corners, -1, axis=1).T.reshape(-1)
    keys = np.minimum(a, b) * np.int64(max(len(vertices), 1)) + np.maximum(a, b)
    ordered = np.sort(keys[a != b])
    begins = np.flatnonzero(np.diff(ordered, prepend=-1))
    odd = np.diff(begins, append=len(ordered)) % 2 == 1
    if not odd.any():
        return OpenEdges(0, None, -1)
    sides = np.isin(keys, ordered[begins[odd]]).reshape(3, -1)
    triangle = int(sides.any(axis=0).argmax())
    side = int(sides[:, triangle].argmax())
    ends = vertices[faces[triangle, side]], vertices[faces[triangle, (side + 1) % 3]]
    return OpenEdges(int(odd.sum()), ends, triangle)


def point_numbers(vertices: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return a number per vertex; vertices at the same position, and no others, have the same one. 0 equals -0."""
    points = np.ascontiguousarray(vertices) + vertices.dtype.type(0)  # no -0
    bits = points.view(f"u{points.itemsize}").astype(np.uint64)
    keys = np.zeros(len(points), np.uint64)
    for axis in range(3):
        keys = (keys ^ bits[:, axis]) * np.uint64(MIX[axis])
        keys ^= keys >> np.uint64(29)
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    if (points[first[number]] != points).any():  # two positions share a key
        _, number = np.unique(points, axis=0, return_inverse=True)
    return number.reshape(-1).astype(np.int64)
