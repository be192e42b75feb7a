"""Rays and triangles whose numbers differ so much in size that kernels cannot decide them: by Python's fractions.

The rule is that of ``crossing``. Only float64 numbers can differ that much: by a factor of about 1e86.
"""

from fractions import Fraction
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.hit_work import MARKED, ON_SURFACE, PAIRS, USED, HitWork
from raytrace.accel.lanes import PACKET
from raytrace.records import Columns, Rays

if TYPE_CHECKING:
    from raytrace.accel.ray_queries import RayQueries

Vector = tuple[Fraction, Fraction, Fraction]


class _Pair(NamedTuple):
    """A ray and a triangle, in the axes of the ray."""

    d: Vector
    a: Vector  # vertices relative to the origin
    b: Vector
    c: Vector


def decide_pairs(bvh: "RayQueries", rays: Rays, counts: NDArray[np.int32], work: HitWork) -> None:
    """Decide the pairs that a kernel noted, and add their crossings to the counts and hits of the rays."""
    corners = bvh.triangles[:, :9].reshape(-1, 3, 3)
    for ray, prim in zip(*(a[: work.state[PAIRS]].tolist() for a in (work.pair_ray, work.pair_prim)), strict=True):
        pair = _pair(_row(rays.o, ray), _row(rays.d, ray), corners[prim])
        signs = _signs(pair)
        if work.state[ON_SURFACE] and _holds_origin(pair):
            counts[ray] |= MARKED
        if signs[0] == 0 or len(set(signs)) > 1:
            continue
        weights = _edges(pair)
        height, total = _triple(pair.a, pair.b, pair.c), sum(weights)
        t = _rounded(-height / total, bvh.triangles.dtype)
        if not (_row(rays.tmin, ray, 1)[0] < t < _row(rays.tmax, ray, 1)[0]):
            continue
        counts[ray] += 1
        used = int(work.state[USED])
        work.state[USED] = used + 1
        if used + 1 + PACKET <= len(work.hit_t):
            work.hit_t[used], work.hit_u[used], work.hit_v[used] = t, weights[1] / total, weights[2] / total
            work.hit_prim[used], work.hit_ray[used] = prim, ray


def _row(columns: Columns, i: int, count: int = 3) -> list[float]:
    """The first numbers of one ray."""
    at = columns.start + i * columns.row
    return [float(columns.data[at + axis * columns.axis]) for axis in range(count)]


def _pair(o: list[float], d: list[float], corners: NDArray[np.floating]) -> _Pair:
    """Put the dominant axis of the ray last."""
    dominant = max(range(3), key=lambda axis: abs(d[axis]))  # of equal ones the first, as in kernels
    axes = [(dominant + 1) % 3, (dominant + 2) % 3, dominant]
    vertices = [[Fraction(float(corner[k])) - Fraction(o[k]) for k in axes] for corner in corners]
    x, y, z = (Fraction(d[k]) for k in axes)
    a, b, c = ((v[0], v[1], v[2]) for v in vertices)
    return _Pair((x, y, z), a, b, c)


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _triple(a: Vector, b: Vector, c: Vector) -> Fraction:
    x, y, z = _cross(b, c)
    return a[0] * x + a[1] * y + a[2] * z


def _sign(a: Fraction) -> int:
    return (a > 0) - (a < 0)


def _edges(pair: _Pair) -> list[Fraction]:
    """Edge functions of the line itself."""
    d, a, b, c = pair
    return [_triple(d, c, b), _triple(d, a, c), _triple(d, b, a)]


def _signs(pair: _Pair) -> list[int]:
    """Signs of the edge functions of the moved line."""
    d, a, b, c = pair
    signs = []
    for value, p, q in zip(_edges(pair), (c, a, b), (b, c, a), strict=True):
        x, y, _ = _cross(d, (q[0] - p[0], q[1] - p[1], q[2] - p[2]))
        signs.append(_sign(value) or _sign(x) or _sign(y))
    return signs


def _holds_origin(pair: _Pair) -> bool:
    """Whether the origin lies on the closed triangle, and that has an area."""
    _, a, b, c = pair
    if _triple(a, b, c) != 0:
        return False
    for axes in combinations(range(3), 2):
        parts = [p[axes[0]] * q[axes[1]] - p[axes[1]] * q[axes[0]] for p, q in ((a, b), (b, c), (c, a))]
        if sum(parts) != 0:
            return min(parts) >= 0 or max(parts) <= 0
    return False


def _rounded(t: Fraction, dtype: np.dtype) -> float:
    """The nearest number of the dtype that is finite, and zero only if t is."""
    kind = np.finfo(dtype)
    if t == 0:
        return 0.0
    largest, least = Fraction(float(kind.max)), Fraction(float(kind.smallest_subnormal))
    return float(dtype.type(float(min(max(abs(t), least), largest)))) * _sign(t)
