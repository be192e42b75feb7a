"""Finds triangles that coincide: by hashing their positions and planes, then testing the candidates."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]
Keys = NDArray[np.uint64]

BOUND_ROUNDINGS = 4  # as in docs/numerics.md, "Where a ray leaves a surface": 3, and one of the vertices themselves
BOUND_EXTENTS = 4  # the same
FIRST_PAIRS = 1 << 13  # pairs that are tested first
AT_ONCE = 1 << 17  # pairs that are tested at once
MOST_PARTNERS = 64  # of a triangle in one cell; if there are more, these suffice for a warning


class Facets(NamedTuple):
    """Triangles by columns; all coordinates are scaled by a power of two so that the largest is about 1."""

    corners: Reals  # (3 corners, 3 axes, m)
    low: Reals  # (3, m): bounds
    high: Reals  # (3, m)
    normal: Reals  # (3, m): unit
    bound: Reals  # (m,): distance within which a ray that leaves or reaches the triangle may miss another
    height: Reals  # (m,): the smallest

    def take(self, rows: Rows | Mask) -> "Facets":
        """Return some of the rows."""
        return Facets(*(column[..., rows] for column in self))


def make_facets(corners: Reals, unit: float) -> Facets:
    """Return the data of triangles that the search needs; triangles without area are left out.

    Parameters
    ----------
    corners : (3 corners, 3 axes, m) float64
    unit : float
        The unit roundoff of the precision in which rays are traced.
    """
    first, second, third = corners[1] - corners[0], corners[2] - corners[0], corners[2] - corners[1]
    cross = np.cross(first, second, axis=0)
    area = np.sqrt((cross**2).sum(axis=0))
    longest = np.sqrt(np.maximum.reduce([(side**2).sum(axis=0) for side in (first, second, third)]))
    good = area > 0
    normal = np.divide(cross, area, out=np.zeros_like(cross), where=good)
    height = np.divide(area, longest, out=np.zeros_like(area), where=good)
    low, high = corners.min(axis=0), corners.max(axis=0)
    gamma = BOUND_ROUNDINGS * unit / (1 - BOUND_ROUNDINGS * unit)
    reach = np.maximum(-low, high) + BOUND_EXTENTS * (high - low)
    bound = gamma * (np.abs(normal) * reach).sum(axis=0)
    return Facets(corners, low, high, normal, bound, height).take(good)


def coincident_pairs(a: Facets, b: Facets, margin: float) -> Iterator[tuple[Rows, Rows]]:
    """Yield pairs of triangles of a and b that coincide: they lie in one plane within their bounds, and overlap in it.

    Parameters
    ----------
    a, b : Facets
    margin : float
        By how much two triangles must overlap, in every direction of their plane.

    Yields
    ------
    i, j : (k,) int64
        Rows of a and of b, in parts; a pair may come again. A sample of all pairs comes before the others.
    """
    for i, j in _candidates(a, b):
        yield overlapping(a, b, i, j, margin)


def _candidates(a: Facets, b: Facets) -> Iterator[tuple[Rows, Rows]]:
    """Yield pairs near each other and near one plane: for each size of triangles, with all smaller ones."""
    if len(a.bound) * len(b.bound) <= FIRST_PAIRS:
        i, j = np.divmod(np.arange(len(a.bound) * len(b.bound)), max(len(b.bound), 1))
        yield i, j
        return
    pad = max(a.bound.max(), b.bound.max())
    level_a, level_b = (np.floor(np.log2((f.high - f.low).max(axis=0) + 2 * pad)).astype(np.int64) for f in (a, b))
    lowest = min(level_a.min(), level_b.min())
    for level in lowest + np.flatnonzero(np.bincount(np.concatenate([level_a, level_b]) - lowest)):
        cell = 4 * 2.0 ** float(level)
        yield from _near(a, level_a == level, b, level_b <= level, cell, pad)
        yield from _near(a, level_a < level, b, level_b == level, cell, pad)


def _near(a: Facets, some_a: Mask, b: Facets, some_b: Mask, cell: float, pad: float) -> Iterator[tuple[Rows, Rows]]:
    """Yield pairs of some rows of a and b that share a grid cell and the distance of their plane from its centre."""
    rows = [np.flatnonzero(some_a), np.flatnonzero(some_b)]
    for k, (mine, other) in enumerate(((a, b), (b, a))):  # the rest of one bounds the other
        if not (len(rows[0]) and len(rows[1])):
            return
        low, high = (other.low[:, rows[1 - k]].min(axis=1) - pad, other.high[:, rows[1 - k]].max(axis=1) + pad)
        near = (mine.high[:, rows[k]] >= low[:, None]) & (mine.low[:, rows[k]] <= high[:, None])
        rows[k] = rows[k][near.all(axis=0)]
    row_a, key_a = _entries(a.take(rows[0]), cell, pad)
    row_b, key_b = _entries(b.take(rows[1]), cell, pad)
    order = np.argsort(key_b)
    key_b, row_b = key_b[order], row_b[order]
    start, end = np.searchsorted(key_b, key_a), np.searchsorted(key_b, key_a, "right")
    shared = np.flatnonzero(end > start)
    row_a, start, count = row_a[shared], start[shared], np.minimum(end - start, MOST_PARTNERS)[shared]
    for part in _shares(count):
        within = np.arange(count[part].sum()) - np.repeat(np.cumsum(count[part]) - count[part], count[part])
        yield (
            rows[0][np.repeat(row_a[part], count[part])],
            rows[1][row_b[np.repeat(start[part], count[part]) + within]],
        )


def _shares(count: Rows) -> Iterator[slice]:
    """Yield slices of entries with so many pairs each: first a sample of them, then all, a few at a time."""
    total = int(count.sum())
    if total > FIRST_PAIRS:
        yield slice(None, None, -(-total // FIRST_PAIRS))
    ends = np.searchsorted(np.cumsum(count), np.arange(AT_ONCE, total + AT_ONCE, AT_ONCE), "right").tolist()
    for begin, end in zip([0, *ends], [*ends, len(count)], strict=False):
        if begin < end:
            yield slice(begin, end)


def _entries(facets: Facets, cell: float, pad: float) -> tuple[Rows, Keys]:
    """Return keys of the triangles: the grid cells that they meet, and the distance of their plane from the centre."""
    width = 2.0 ** np.ceil(np.log2(80 * pad + 1e-12 * cell))
    # planes that differ by pad at a triangle differ by this at the centre of the cell; limited for thin triangles
    tolerance = np.minimum(2 * pad * (1 + 2 * cell / facets.height) + 1e-13, width / 2)
    first, last = np.floor((facets.low - pad) / cell), np.floor((facets.high + pad) / cell)
    rows, keys = [], []
    for step in np.ndindex(2, 2, 2):
        row = np.flatnonzero((last - first >= np.array(step)[:, None]).all(axis=0))
        place = first[:, row] + np.array(step, np.float64)[:, None]
        away = facets.corners[0][:, row] - (place + 0.5) * cell
        distance = np.abs((facets.normal[:, row] * away).sum(axis=0))
        within = distance - pad <= cell * 0.8661  # half the diagonal of the cell: its plane passes through it
        row, place, distance = row[within], place[:, within], distance[within]
        key = _mix(_mix(_mix(np.zeros(len(row), np.uint64), place[0]), place[1]), place[2])
        near = np.floor((distance - tolerance[row]) / width)
        far = np.floor((distance + tolerance[row]) / width)
        twice = np.flatnonzero(far != near)
        rows += [row, row[twice]]
        keys += [_mix(key, near), _mix(key[twice], far[twice])]
    return np.concatenate(rows), np.concatenate(keys)


def _mix(key: NDArray[np.uint64], number: Reals) -> NDArray[np.uint64]:
    """Hash one more number into keys; the tests reject pairs that collide."""
    key = (key ^ number.astype(np.int64).view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
    return key ^ (key >> np.uint64(29))


def overlapping(a: Facets, b: Facets, i: Rows, j: Rows, margin: float) -> tuple[Rows, Rows]:
    """Return the pairs of rows that coincide over an area."""
    bound = a.bound[i] + b.bound[j]
    keep = np.ones(len(i), np.bool_)
    for axis in range(3):
        keep &= a.low[axis, i] <= b.high[axis, j] + bound
        keep &= b.low[axis, j] <= a.high[axis, i] + bound
    i, j, bound = i[keep], j[keep], bound[keep]
    keep = np.minimum(_distance(a, b, i, j), _distance(b, a, j, i)) <= bound
    i, j = i[keep], j[keep]
    keep = _overlap(a, b, i, j) > margin
    return i[keep], j[keep]


def _distance(a: Facets, b: Facets, i: Rows, j: Rows) -> Reals:
    """Return the largest distance of the corners of triangles i of a from the planes of triangles j of b."""
    normal, origin = b.normal[:, j], b.corners[0][:, j]
    away = [np.abs((normal * (a.corners[k][:, i] - origin)).sum(axis=0)) for k in range(3)]
    return np.asarray(np.maximum.reduce(away))


def _overlap(a: Facets, b: Facets, i: Rows, j: Rows) -> Reals:
    """Return how deep triangles of one plane overlap, across the side where it is least; below 0: not at all."""
    normal = a.normal[:, i]
    one, two = a.corners[:, :, i], b.corners[:, :, j]
    depth = np.full(len(i), np.inf)
    for corners in (one, two):
        for k in range(3):
            across = np.cross(normal, corners[(k + 1) % 3] - corners[k], axis=0)
            across /= np.sqrt((across**2).sum(axis=0))
            first, second = ((across * (side - corners[k])).sum(axis=1) for side in (one, two))
            high = np.minimum(first.max(axis=0), second.max(axis=0))
            depth = np.minimum(depth, high - np.maximum(first.min(axis=0), second.min(axis=0)))
    return depth
