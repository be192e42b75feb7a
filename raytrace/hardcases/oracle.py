"""Exact oracle: the triangles that the line of a ray crosses, computed in integer arithmetic on the given floats.

A float is an integer times a power of two, and so are sums and products of floats. Python's integers compute them
without rounding; a quotient of two integers is rounded once. Most pairs of ray and triangle are far apart. A float64
test with a bound on its own error discards them, and only the others need integer arithmetic.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Doubles = NDArray[np.float64]
Index = NDArray[np.intp]
Whole = NDArray[np.object_]  # Python's integers
Triple = tuple[Any, Any, Any]

PAIRS = 1 << 21  # pairs (rays x triangles) tested together
# Rounding error in float64, relative to the sum of the magnitudes of all terms. A side (d x a) . (b - a) and the
# distance of a point from a line are products of factors rounded once: the error is below gamma(10) [Higham2002, 3.1].
ROUNDING = 4e-15
INTERIOR, EDGE, VERTEX = range(3)


class Crossings(NamedTuple):
    """Lines that cross triangles, one row per pair, sorted by ray: decided exactly, numbers rounded once."""

    ray: Index  # (k,)
    prim: Index  # (k,): the first of identical triangles
    kind: NDArray[np.int8]  # (k,): INTERIOR, EDGE or VERTEX
    t: Doubles  # (k,) units of the direction; negative: behind the origin
    u: Doubles  # (k,) weight of v1
    v: Doubles  # (k,) weight of v2
    edge: Doubles  # (k, 3) world units: distance of the line from the edges opposite v0, v1, v2
    cosine: Doubles  # (k,): cosine of the angle between line and normal, > 0
    height: Doubles  # (k,) world units: least height of the triangle as seen along the ray


def dot(a: Triple, b: Triple) -> Any:
    """Scalar product of two (x, y, z) of arrays."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
    """Cross product of two (x, y, z) of arrays."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def sub(a: Triple, b: Triple) -> Triple:
    """Difference of two (x, y, z) of arrays."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def norm(a: Triple) -> Doubles:
    """Length of an (x, y, z) of float arrays."""
    return np.asarray(np.hypot(np.hypot(a[0], a[1]), a[2]))


def columns(a: NDArray[Any]) -> Triple:
    """The x, y and z of rows (..., 3)."""
    return a[..., 0], a[..., 1], a[..., 2]


def split_floats(a: Doubles) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split floats into 53-bit integers and exponents of two."""
    mantissa, exponent = np.frexp(a)
    return (mantissa * 2.0**53).astype(np.int64), exponent.astype(np.int64) - 53


def raised(whole: NDArray[np.int64], exponent: NDArray[np.int64], low: NDArray[np.int64] | int) -> Whole:
    """Integers times 2^(exponent - low), exact."""
    shift = np.where(whole != 0, exponent - low, 0)
    return np.asarray(whole.astype(object) << shift.astype(object), object)


def ratio(numerator: Whole, denominator: Whole | int) -> Doubles:
    """Quotients of integers, rounded once."""
    return np.asarray(numerator / denominator, np.float64)


def magnitude(a: Doubles) -> int:
    """Least e with |a| < 2^e; 0 where all is zero."""
    return int(np.frexp(np.abs(a).max(initial=0.0))[1])


class Oracle:
    """Compute exactly which triangles of a mesh the rays cross.

    Parameters
    ----------
    corners : (m, 3, 3) array_like of float
        Vertices of each triangle, finite.
    origins, directions : (n, 3) array_like of float
        Rays; a ray that is not finite, or has direction 0, crosses nothing.

    Examples
    --------
    >>> oracle = Oracle([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], [[1, 1, 3]], [[0, 0, -4]])
    >>> oracle.crossings.t, oracle.crossings.u
    (array([0.75]), array([0.25]))
    """

    def __init__(self, corners: ArrayLike, origins: ArrayLike, directions: ArrayLike) -> None:
        triangles = np.asarray(corners, np.float64).reshape(-1, 9) + 0.0  # no -0
        o, d = (np.asarray(a, np.float64).reshape(-1, 3) for a in (origins, directions))
        good = np.isfinite(o).all(axis=1) & np.isfinite(d).all(axis=1) & (d != 0).any(axis=1)
        o, d = np.where(good[:, None], o, 0.0), np.where(good[:, None], d, 0.0)
        rows, self.first, self.group = np.unique(triangles, axis=0, return_index=True, return_inverse=True)
        self.group = self.group.reshape(-1)
        self._scale = max(magnitude(rows), magnitude(o))
        self.size = 2.0**self._scale  # world units of the scaled numbers in corners and o
        self.corners, self.o = np.ldexp(rows, -self._scale).reshape(-1, 3, 3), np.ldexp(o, -self._scale)
        self._d_scale = np.frexp(np.abs(d).max(axis=1, initial=0.0))[1].astype(np.int64)
        self.d = np.ldexp(d, -self._d_scale[:, None])
        self._make_integers(rows.reshape(-1, 3, 3), o, d)
        self.crossings = self._crossings(np.flatnonzero(good))

    def _make_integers(self, rows: Doubles, o: Doubles, d: Doubles) -> None:
        """Convert positions to integers in units of 2^low, and each direction in its own unit."""
        (v, v_exponent), (p, p_exponent), (w, w_exponent) = split_floats(rows), split_floats(o), split_floats(d)
        exponents = np.concatenate([v_exponent[v != 0], p_exponent[p != 0]])
        self._low = int(exponents.min(initial=self._scale))
        self._v, self._p = raised(v, v_exponent, self._low), raised(p, p_exponent, self._low)
        self._d_low = np.where(w != 0, w_exponent, 2**30).min(axis=1, initial=2**30)
        self._w = raised(w, w_exponent, self._d_low[:, None])
        a, b, c = (columns(self._v[:, k]) for k in range(3))
        self._normal = np.stack(cross(sub(b, a), sub(c, a)), axis=-1).reshape(-1, 3)
        self._unit = 1 << (self._scale - self._low)  # integers of positions / this = scaled positions
        self.normal = ratio(self._normal, self._unit**2) if len(rows) else np.zeros((0, 3))

    def _candidates(self, rays: Index) -> tuple[Index, Index]:
        """Candidate pairs: the line may cross the triangle's bounding ball, and its signs do not exclude a crossing."""
        centre = self.corners.mean(axis=1)
        radius = np.sqrt(((self.corners - centre[:, None]) ** 2).sum(axis=2).max(axis=1, initial=0.0))
        unit = self.d / np.sqrt((self.d**2).sum(axis=1, keepdims=True).clip(min=0.25))
        found: list[tuple[Index, Index]] = [(rays[:0], rays[:0])]
        step = max(1, PAIRS // max(len(centre), 1))
        for start in range(0, len(rays), step):
            part = rays[start : start + step]
            away = tuple(c - o[:, None] for c, o in zip(columns(centre), columns(self.o[part]), strict=True))
            off = cross(away, tuple(x[:, None] for x in columns(unit[part])))
            far = np.abs(away[0]) + np.abs(away[1]) + np.abs(away[2])
            row, group = np.nonzero(dot(off, off) <= (radius * (1 + ROUNDING) + ROUNDING * far) ** 2)
            keep = self._undecided(part[row], group)
            found.append((part[row][keep], group[keep]))
        ray, group = (np.concatenate(side) for side in zip(*found, strict=True))
        return ray, group

    def _undecided(self, ray: Index, group: Index) -> NDArray[np.bool_]:
        """Mark pairs that have no two edges with certainly different signs."""
        d, o, corners = columns(self.d[ray]), self.o[ray], self.corners[group]
        some_above, some_below = np.zeros((2, len(ray)), bool)
        for k in range(3):
            start, edge = columns(corners[:, k] - o), columns(corners[:, (k + 1) % 3] - corners[:, k])
            side = dot(cross(d, start), edge)
            x, y, z = tuple(map(np.abs, start))
            error = ROUNDING * dot((y + z, z + x, x + y), tuple(map(np.abs, edge)))
            some_above |= side > error
            some_below |= side < -error
        return ~(some_above & some_below)

    def _crossings(self, rays: Index) -> Crossings:
        ray, group = self._candidates(rays)
        a, b, c = (columns(self._v[group, k] - self._p[ray]) for k in range(3))
        d = columns(self._w[ray])
        sides = np.stack([dot(d, cross(b, c)), dot(d, cross(c, a)), dot(d, cross(a, b))], axis=-1).reshape(-1, 3)
        det = sides.sum(axis=1)
        inside = ((sides >= 0).all(axis=1) | (sides <= 0).all(axis=1)) & (det != 0)
        ray, group, sides, det = ray[inside], group[inside], sides[inside], det[inside]
        order = np.lexsort((self.first[group], ray))
        return self._measured(ray[order], group[order], sides[order], det[order])

    def _measured(self, ray: Index, group: Index, sides: Whole, det: Whole) -> Crossings:
        """Compute t, u, v and distances of pairs that cross."""
        above = dot(columns(self._normal[group]), columns(self._v[group, 0] - self._p[ray]))
        shift = self._low - self._d_low[ray]
        up, down = (1 << np.maximum(s, 0).astype(object) for s in (shift, -shift))
        weights = ratio(sides, det[:, None]) if len(ray) else np.zeros((0, 3))
        d, n = columns(self.d[ray]), columns(self.normal[group])
        length = self._d_scale[ray] - self._d_low[ray]  # bits of a direction
        area = np.abs(ratio(det, self._unit**2 << length.astype(object)))  # |n . d|, scaled
        corners = self.corners[group]
        edges = [columns(corners[:, (k + 2) % 3] - corners[:, (k + 1) % 3]) for k in range(3)]
        with np.errstate(divide="ignore", invalid="ignore"):  # an edge along the ray
            heights = np.stack([area / norm(cross(d, edge)) for edge in edges], axis=-1).reshape(-1, 3)
        return Crossings(
            ray,
            self.first[group],
            (sides == 0).sum(axis=1).astype(np.int8),
            ratio(above * up, det * down) if len(ray) else np.zeros(0),
            weights[:, 1],
            weights[:, 2],
            np.ldexp(weights * np.where(np.isfinite(heights), heights, 0.0), self._scale),
            area / (norm(n) * norm(d)),
            np.ldexp(heights.min(axis=1, initial=np.inf), self._scale),
        )

    def facing(self, ray: Index, prim: Index) -> NDArray[np.int64]:
        """Sign of n . d per pair: -1: the ray sees the front; 0: it lies in the plane, or the triangle has no area."""
        side = dot(columns(self._normal[self.group[prim]]), columns(self._w[ray]))
        return np.sign(side).astype(np.int64)

    def ahead(self, ray: Index, prim: Index) -> NDArray[np.int64]:
        """Sign of t per pair that crosses: 1: beyond the origin; 0: at it; also where t itself underflows."""
        above = dot(columns(self._normal[self.group[prim]]), columns(self._v[self.group[prim], 0] - self._p[ray]))
        return np.sign(above).astype(np.int64) * self.facing(ray, prim)

    def has_area(self, prim: Index) -> NDArray[np.bool_]:
        """Whether each triangle has an area, decided exactly."""
        return np.asarray((self._normal[self.group[prim]] != 0).any(axis=1), bool)

    def reach(self, ray: Index, prim: Index) -> Doubles:
        """Distance from the ray's origin to the farthest vertex of the triangle, per pair; world units."""
        away = self.corners[self.group[prim]] - self.o[ray][:, None]
        return np.ldexp(np.sqrt((away**2).sum(axis=2).max(axis=1, initial=0.0)), self._scale)

    def distance(self, ray: Index, prim: Index, t: Doubles) -> Doubles:
        """Distance of the points o + t d from triangles, world units; t must be finite.

        The point relative to each vertex and its distance from the plane are computed exactly, then rounded once.
        Whether the point lies over the triangle is decided exactly. Integers grow with the size of t.
        """
        group = self.group[prim]
        whole, exponent = split_floats(np.asarray(t, np.float64))
        shift = np.where(whole != 0, self._d_low[ray] + exponent - self._low, 0)
        up, down = (np.maximum(s, 0).astype(object)[:, None] for s in (shift, -shift))
        moved = (self._w[ray] * whole.astype(object)[:, None]) << up
        q = [columns(((self._p[ray] - self._v[group, k]) << down) + moved) for k in range(3)]
        n = columns(self._normal[group])
        edges = [sub(columns(self._v[group, (k + 1) % 3]), columns(self._v[group, k])) for k in range(3)]
        over = np.ones(len(ray), bool)
        best = np.full(len(ray), np.inf)
        unit: Whole = np.asarray(self._unit << down[:, 0], object)
        for k in range(3):
            over &= np.asarray(dot(n, cross(edges[k], q[k])) >= 0, bool)
            point = columns(ratio(np.stack(q[k], axis=-1), unit[:, None]))
            edge = columns(ratio(np.stack(edges[k], axis=-1), self._unit))
            square = dot(edge, edge)
            share = np.clip(dot(point, edge) / np.where(square > 0, square, 1.0), 0, 1)
            best = np.minimum(best, norm(sub(point, columns(share[:, None] * np.stack(edge, axis=-1)))))
        length = norm(columns(self.normal[group]))
        plane = np.abs(ratio(dot(n, q[0]), unit * self._unit**2)) / np.where(length > 0, length, np.inf)
        return np.ldexp(np.where(over & (length > 0), plane, best), self._scale)
