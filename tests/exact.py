"""The rational oracle: what a ray and a triangle do, in exact arithmetic on the floats as they are."""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

Vector = tuple[Fraction, Fraction, Fraction]


class Crossing(NamedTuple):
    """How the line o + t d meets a triangle."""

    kind: str  # "interior", "edge", "vertex", "coplanar" (or no area), "miss"
    t: Fraction | None  # None: no single point
    u: Fraction | None  # weight of v1
    v: Fraction | None  # weight of v2


def exact(a: ArrayLike) -> Vector:
    """The three numbers, without rounding; not finite: OverflowError or ValueError."""
    x, y, z = (Fraction(float(c)) for c in np.asarray(a).ravel())
    return x, y, z


def sub(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def dot(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def classify(triangle: ArrayLike, origin: ArrayLike, direction: ArrayLike) -> Crossing:
    """Where the whole line crosses the triangle (3, 3): behind the origin too, with t < 0."""
    v0, v1, v2 = (exact(corner) for corner in np.asarray(triangle))
    o, d = exact(origin), exact(direction)
    e1, e2, s = sub(v1, v0), sub(v2, v0), sub(o, v0)
    n = cross(e1, e2)
    det = -dot(n, d)  # Moeller and Trumbore, by Cramer's rule
    if det == 0:
        return Crossing("coplanar" if dot(n, s) == 0 else "miss", None, None, None)
    q = cross(s, d)
    t, u, v = dot(n, s) / det, dot(e2, q) / det, -dot(e1, q) / det
    weights = (1 - u - v, u, v)
    if min(weights) < 0:
        return Crossing("miss", t, u, v)
    return Crossing(("interior", "edge", "vertex")[weights.count(Fraction(0))], t, u, v)


def closest(
    vertices: ArrayLike,
    faces: ArrayLike,
    origin: ArrayLike,
    direction: ArrayLike,
    tmin: float = 0.0,
    tmax: float = float("inf"),
) -> tuple[Fraction | None, list[int], list[Crossing]]:
    """Exact nearest t with tmin < t < tmax (None: a miss), the triangles that share it in order, and all crossings."""
    corners = np.asarray(vertices)
    crossings = [classify(corners[face], origin, direction) for face in np.asarray(faces)]
    hits = [(c.t, i) for i, c in enumerate(crossings) if c.kind in ("interior", "edge", "vertex") and c.t is not None]
    hits = [(t, i) for t, i in hits if t > tmin and t < tmax]
    if not hits:
        return None, [], crossings
    nearest = min(t for t, _ in hits)
    return nearest, [i for t, i in hits if t == nearest], crossings
