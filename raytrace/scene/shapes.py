"""Shapes that a scene names instead of a mesh, made into triangles: sphere, rectangle and box.

They are made of sums, products, quotients and square roots only, so that their bits are the same on every machine.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh

Rows = NDArray[np.int64]

FLATNESS = 0.87  # of the sphere of frequency n: its triangles leave the sphere by at most FLATNESS / n^2 of the radius
MAKING = 64  # bytes per triangle that making a sphere takes at most, the sphere included


MAKING_UV = 120  # more bytes per triangle with uv


class ShapeSize(NamedTuple):
    """Numbers of a shape that are known before it is made."""

    triangles: int
    vertices: int

    def making(self, uv: bool = False) -> float:
        """Bytes that making the shape takes at most."""
        return float((MAKING + MAKING_UV * uv) * self.triangles)


def shape_of(entry: Any) -> str:
    """Return which shape an object has: mesh, sphere, rectangle or box.

    Parameters
    ----------
    entry : types.SimpleNamespace
        An entry of ``objects``, as ``read_format`` returns it.
    """
    return next(key for key in ("mesh", "sphere", "rectangle", "box") if getattr(entry, key) is not None)


def sphere_frequency(tolerance: float) -> int:
    """Return the number of parts of each octahedron edge for which the sphere is accurate enough.

    Parameters
    ----------
    tolerance : float
        The most that a triangle may leave the sphere, relative to the radius.

    Examples
    --------
    >>> sphere_frequency(1e-3), sphere_frequency(1)
    (30, 1)
    """
    return max(1, math.ceil(math.sqrt(FLATNESS / tolerance)))


def shape_size(entry: Any) -> ShapeSize:
    """Return the size of a sphere, rectangle or box before it is made."""
    if entry.sphere is not None:
        n = sphere_frequency(entry.sphere.tolerance)
        return ShapeSize(8 * n * n, 4 * n * n + 2)
    return ShapeSize(2, 4) if entry.rectangle is not None else ShapeSize(12, 8)


def make_shape(entry: Any, uv: bool = False) -> RawMesh:
    """Return the triangles of a shape in its own space, with uv on request; a sphere is the unit sphere."""
    if entry.sphere is not None:
        mesh = unit_sphere(sphere_frequency(entry.sphere.tolerance))
    else:
        mesh = rectangle() if entry.rectangle is not None else box()
    if not uv:
        return mesh
    from raytrace.scene import shape_uv

    make = {"sphere": shape_uv.sphere_uv, "rectangle": shape_uv.rectangle_uv, "box": shape_uv.box_uv}[shape_of(entry)]
    return mesh._replace(uv=make(mesh))


def rectangle() -> RawMesh:
    """Return the square with x and y from -1 to 1 and z = 0, facing +z.

    Examples
    --------
    >>> rectangle().vertices.tolist()
    [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
    """
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    return RawMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), None, None)


def box() -> RawMesh:
    """Return the cube with x, y and z from -1 to 1, facing outwards.

    Examples
    --------
    >>> len(box().vertices), len(box().faces)
    (8, 12)
    """
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    # counter-clockwise from outside: -z, +z, -y, +y, -x, +x
    sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [face for a, b, c, d in sides for face in ([a, b, c], [a, c, d])]
    return RawMesh(corners, np.array(faces), None, None)


def unit_sphere(n: int) -> RawMesh:
    """Return a sphere of radius 1 about the origin, with its exact normals at the vertices.

    Parameters
    ----------
    n : int
        Parts of each edge of the octahedron that is divided; there are 8 n^2 triangles.

    Returns
    -------
    RawMesh
        Every vertex lies on the sphere, to rounding. The triangles lie inside, at most ``FLATNESS`` / n^2 deep.

    Notes
    -----
    The point with barycentric coordinates (a, b, c) of a face of the octahedron goes to the direction
    (w(a), w(b), w(c)), w(t) = t (3 - t^2) / 2. Without w, triangles at the middle of a face would be five times as
    large as those at its corners; with it, twice as large. The coordinate planes meet the sphere along edges.

    Examples
    --------
    >>> len(unit_sphere(3).vertices), len(unit_sphere(3).faces)
    (38, 72)
    """
    t = np.arange(n + 1) / n
    upper = _upper_vertices(t * (3 - t * t) / 2)
    equator = len(upper) - 4 * n
    vertices = np.concatenate([upper, upper[:equator] * (1.0, -1.0, 1.0)])
    faces = np.empty((8 * n * n, 3), np.int64)
    above, below = faces[: 4 * n * n], faces[4 * n * n :]
    _upper_faces(n, above)
    below[:] = above[:, [0, 2, 1]]
    below[below < equator] += len(upper)
    return RawMesh(vertices, faces, vertices, faces)


def _ring(k: int) -> int:
    """Row of the first vertex of ring k; ring 0 is the pole, and ring k has 4 k vertices."""
    return 1 + 2 * k * (k - 1) if k else 0


def _upper_vertices(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertices with y >= 0, ring by ring, from +z towards +x."""
    n = len(w) - 1
    vertices = np.empty((_ring(n) + 4 * n, 3))
    vertices[0] = (0, 1, 0)
    for k in range(1, n + 1):
        a, b, y = w[k:0:-1], w[:k], w[n - k]
        length = np.sqrt(y * y + (a * a + b * b))
        a, b = a / length, b / length
        ring = vertices[_ring(k) : _ring(k + 1)]
        ring[:, 0] = np.concatenate([b, a, 0 - b, 0 - a])  # 0 - b is never -0
        ring[:, 1] = np.tile(y / length, 4)
        ring[:, 2] = np.concatenate([a, 0 - b, 0 - a, b])
    return vertices


def _upper_faces(n: int, out: Rows) -> None:
    """Write the triangles between the rings, counter-clockwise seen from outside."""
    for k in range(1, n + 1):
        here, above = _ring(k), _ring(k - 1)
        i = np.arange(4 * k)
        quadrant, j = np.divmod(i, k)
        top = quadrant * (k - 1) + j  # the vertex of the ring above that stands over edge i
        around = max(4 * (k - 1), 1)
        first = 4 * (k - 1) ** 2
        rows = out[first : first + 4 * k]
        rows[:, 0], rows[:, 1], rows[:, 2] = above + top % around, here + i, here + (i + 1) % (4 * k)
        inner = j < k - 1
        top, i = top[inner], i[inner]
        rows = out[first + 4 * k : 4 * k * k]
        rows[:, 0], rows[:, 1], rows[:, 2] = above + top, here + i + 1, above + (top + 1) % around
