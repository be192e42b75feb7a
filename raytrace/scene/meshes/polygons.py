"""Polygons to triangles: a fan where it covers the polygon, ear clipping where it does not."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]

BLOCK = 2**17  # corners of polygons that are processed together
EXCESS = (
    1e-6  # of a polygon's area: part of a fan triangle that may lie outside it. Files round coordinates about as much
)
SMALL = 16  # up to so many corners, fans about all corners are tried, for many polygons at a time
MAX_CORNERS = 2**14  # of a polygon that is clipped, which takes up to the square of its corners: about 1 s
MAX_CLIPPING = 2**32  # sum of the squares of the corners of all polygons that are clipped


class PolygonError(ValueError):
    """A polygon, by its number from 0, that cannot be triangulated."""

    def __init__(self, polygon: int, text: str) -> None:
        self.polygon = polygon
        super().__init__(text)


def fan(sizes: Integers) -> Integers:
    """Return the corners (m, 3) of the triangles of polygons: a fan about the first corner of each."""
    triangles = sizes - 2
    first = np.repeat(np.cumsum(sizes) - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + step + 1, first + step + 2], axis=1)


def triangulate(vertices: Floats, corners: Integers, sizes: Integers) -> Integers:
    """Return the corners (m, 3) of the triangles of polygons.

    Parameters
    ----------
    vertices : (v, 3) float64
    corners : (n,) int64
        Rows of vertices, the corners of all polygons one after the other. If one does not exist, all become fans; a
        polygon with a vertex that is not finite becomes one.
    sizes : (p,) int64
        Number of corners of each polygon, at least 3.

    Returns
    -------
    (m, 3) int64
        Indices into ``corners``, in the order of the polygons: ``size - 2`` triangles of each, or fewer where edges
        cross or touch each other. A fan about the first corner where that covers the polygon, as it does for every
        convex one; otherwise a fan about another corner of a small polygon, or ear clipping.

    Raises
    ------
    PolygonError
        A concave polygon has too many corners.

    Notes
    -----
    A polygon that is not planar is seen along its Newell normal. Where edges cross each other no triangulation is
    right; the one whose area is nearer to that of the polygon is taken.

    Examples
    --------
    >>> arrow_head = np.array([[0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]], float)
    >>> triangulate(arrow_head, np.arange(4), np.array([4])).tolist()
    [[1, 2, 3], [1, 3, 0]]
    """
    triangles = fan(sizes)
    if not len(sizes) or sizes.max() == 3 or corners.min() < 0 or corners.max() >= len(vertices):
        return triangles
    polygons = _Polygons(vertices, corners, sizes, np.cumsum(sizes) - sizes)
    firsts = np.cumsum(sizes - 2) - (sizes - 2)
    wrong = np.concatenate([polygons.left_by_fans(block) for block in _blocks(np.flatnonzero(sizes > 3), sizes)])
    for shift in range(1, SMALL):
        tried = wrong[(sizes[wrong] > shift) & (sizes[wrong] <= SMALL)]
        excess = polygons.excess(tried, shift)
        right = tried[excess <= np.where(sizes[tried] == 4, polygons.excess(tried), EXCESS)]  # the better of two fans
        rows = _ranges(firsts[right], sizes[right] - 2)
        begin, size = (np.repeat(of, sizes[right] - 2)[:, None] for of in (polygons.begins[right], sizes[right]))
        triangles[rows] = begin + (triangles[rows] - begin + shift) % size
        wrong = np.setdiff1d(wrong, np.append(right, tried[sizes[tried] == 4]))
    _check_work(wrong, sizes)
    for k in wrong.tolist():
        begin, own = polygons.begins[k], triangles[firsts[k] : firsts[k] + sizes[k] - 2]
        clipped = begin + _clip(vertices[corners[begin : begin + sizes[k]]], own - begin)
        own[:] = -1
        own[: len(clipped)] = clipped
    return triangles[triangles[:, 0] >= 0] if len(wrong) else triangles


def _ranges(begins: Integers, lengths: Integers) -> Integers:
    """Return consecutive integers from each of many starts, so many of each."""
    return np.arange(lengths.sum()) + np.repeat(begins - (np.cumsum(lengths) - lengths), lengths)


def _blocks(polygons: Integers, sizes: Integers) -> list[Integers]:
    """Split polygons into blocks of about as many corners each."""
    ends = np.cumsum(sizes[polygons]) // BLOCK
    return np.split(polygons, np.flatnonzero(np.diff(ends)) + 1)


def _check_work(clipped: Integers, sizes: Integers) -> None:
    """Refuse polygons that would take minutes to clip."""
    sizes = sizes[clipped]
    for k in np.flatnonzero(sizes > MAX_CORNERS)[:1]:
        text = f"a concave polygon of {sizes[k]:,} corners; at most {MAX_CORNERS:,}: export triangles"
        raise PolygonError(int(clipped[k]), text)
    for k in np.flatnonzero(np.cumsum(sizes.astype(np.float64) ** 2) > MAX_CLIPPING)[:1]:
        text = f"up to here, concave polygons have {sizes[: k + 1].sum():,} corners: too many; export triangles"
        raise PolygonError(int(clipped[k]), text)


class _Polygons(NamedTuple):
    """Polygons, and by how much fans about their corners leave them."""

    vertices: Floats
    corners: Integers
    sizes: Integers
    begins: Integers  # of their corners

    def left_by_fans(self, block: Integers) -> Integers:
        """Return those of some polygons that the fan about their first corner leaves."""
        quads = block[self.sizes[block] == 4]
        doubtful = np.union1d(quads[self._doubtful(quads)], block[self.sizes[block] > 4])
        return doubtful[self.excess(doubtful) > EXCESS]

    def _doubtful(self, quads: Integers) -> NDArray[np.bool_]:
        """Return whether the two triangles of quadrilaterals face different half-spaces: a quick test, mostly false."""
        with np.errstate(all="ignore"):
            rows = self.corners[self.begins[quads] + np.arange(4)[:, None]]
            x, y, z = (np.take(self.vertices[:, axis], rows[1:]) - self.vertices[rows[0], axis] for axis in range(3))
            i, j, k = (a[:-1] * b[1:] - b[:-1] * a[1:] for a, b in ((y, z), (z, x), (x, y)))
            return np.asarray(~(i[0] * i[1] + j[0] * j[1] + k[0] * k[1] > 0))  # also NaN, and underflow

    def excess(self, polygons: Integers, shift: int = 0) -> Floats:
        """Return the largest part of a fan triangle outside its polygon, relative to the area of the polygon.

        Such a triangle is turned against the Newell normal, the sum of the cross products of the fan about whichever
        corner. Polygons without area, or with a vertex that is not finite, have none.
        """
        sizes = self.sizes[polygons]
        if not len(sizes):
            return np.empty(0)
        begins, count = np.repeat(self.begins[polygons], sizes), np.repeat(sizes, sizes)
        rows = self.corners[begins + (_ranges(np.zeros_like(sizes), sizes) + shift) % count][fan(sizes)]
        first = np.cumsum(sizes - 2) - (sizes - 2)
        with np.errstate(all="ignore"):
            origin, a, b = (self.vertices[rows[:, k]].T for k in range(3))
            a, b = a - origin, b - origin
            scale = np.maximum.reduceat(np.maximum(abs(a).max(axis=0), abs(b).max(axis=0)), first)
            scale = np.repeat(1 / np.where(scale > 0, scale, 1), sizes - 2)
            a, b = a * scale, b * scale
            areas = np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
            normals = np.add.reduceat(areas, first, axis=1)
            along = (areas * np.repeat(normals, sizes - 2, axis=1)).sum(axis=0)
            excess = -np.minimum.reduceat(along, first) / (normals**2).sum(axis=0)
        return np.where(np.isfinite(excess), excess, 0.0)


def _clip(points: Floats, fanned: Integers) -> Integers:
    """Triangulate one polygon by ear clipping, or keep its fan where that is no better."""
    from mapbox_earcut import triangulate_float64

    plane = _project(points)
    if plane is None:
        return fanned
    ears = triangulate_float64(np.ascontiguousarray(plane), np.array([len(plane)], np.uint32)).astype(np.int64)
    clipped = _complete(ears.reshape(-1, 3), plane)
    area = _doubled(plane, fanned).sum()
    misfit = [abs(abs(_doubled(plane, triangles)).sum() - area) for triangles in (clipped, fanned)]
    return clipped if misfit[0] < misfit[1] and len(clipped) <= len(fanned) else fanned


def _project(points: Floats) -> Floats | None:
    """Return the corners of a polygon projected along its Newell normal, counter-clockwise; None: it has no area."""
    points = points - points[0]
    points = points / (abs(points).max() or 1.0)
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(abs(normal)))
    if not normal[axis]:
        return None
    # along the normal into the plane of two axes: coordinates in that plane are unchanged where the polygon is flat
    x, y, z = normal  # sums are written out: the last bit of a matrix product would depend on the machine
    heights = (points[:, 0] * x + points[:, 1] * y + points[:, 2] * z) / (x * x + y * y + z * z)
    flat = points - heights[:, None] * normal
    kept = [(axis + 1) % 3, (axis + 2) % 3]
    return flat[:, kept if normal[axis] > 0 else kept[::-1]]


def _doubled(plane: Floats, triangles: Integers) -> Floats:
    """Return twice the signed area of triangles of a plane."""
    a, b, c = (plane[triangles[:, k]] for k in range(3))
    return np.asarray((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))


def _complete(triangles: Integers, plane: Floats) -> Integers:
    """Orient triangles counter-clockwise, and add the corners that were left out because they lie on an edge.

    Without them there would be a crack along the edge, whose neighbour has these corners.
    """
    turned = _doubled(plane, triangles) < 0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    count, used = len(plane), np.flatnonzero(np.bincount(triangles.ravel(), minlength=len(plane))).tolist()
    gaps = [(a, b) for a, b in zip(used, used[1:] + used[:1], strict=True) if (b - a) % count > 1]
    if not gaps:
        return triangles
    whole = triangles.tolist()
    across = {edge: k for k, triangle in enumerate(whole) for edge in _edges(triangle)}
    for begin, end in gaps:
        if (begin, end) in across:
            k = across[begin, end]
            tip = next(corner for corner in whole[k] if corner not in (begin, end))
            chain = [(begin + step) % count for step in range((end - begin) % count + 1)]
            pieces = [[a, b, tip] for a, b in pairwise(chain)]
            places = [k, *range(len(whole), len(whole) + len(pieces) - 1)]
            whole[k : k + 1] = pieces[:1]
            whole += pieces[1:]
            across |= {edge: at for at, piece in zip(places, pieces, strict=True) for edge in _edges(piece)}
    return np.array(whole, np.int64)


def _edges(triangle: list[int]) -> list[tuple[int, int]]:
    a, b, c = triangle
    return [(a, b), (b, c), (c, a)]
