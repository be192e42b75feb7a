"""Mirror, Snell and whole paths with fifty digits, on the floats as they are."""

from collections.abc import Sequence
from typing import NamedTuple

import mpmath
import numpy as np
from mpmath import mpf
from numpy.typing import ArrayLike, NDArray

import naive

DIGITS = 50
INDICES = [1.5, 1 / 1.5, 2.4, 1 / 2.4, 1.0001, 0.9999, 1 + 1e-6, 1 - 1e-6, 1e3, 1e-3]
WHERE = ["all", "through", "normal", "grazing", "critical"]
Vector = tuple[mpf, mpf, mpf]


class Bend(NamedTuple):
    """What an ideal interface does to a direction."""

    w: Vector  # unit: refracted, or mirrored where reflection is total
    rest: mpf  # square of the cosine of the refracted direction; not positive: reflection is total


def vector(a: ArrayLike) -> Vector:
    """The three numbers, without rounding."""
    x, y, z = (c if isinstance(c, mpf) else mpf(float(c)) for c in a)
    return x, y, z


def dot(a: Vector, b: Vector) -> mpf:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def plus(a: Vector, s: mpf, b: Vector) -> Vector:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def unit(a: Vector) -> Vector:
    length = mpmath.sqrt(dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length


def mirror(d: Vector, n: Vector) -> Vector:
    """Mirrored direction; n unit."""
    return plus(d, -2 * dot(d, n), n)


def snell(d: Vector, n: Vector, eta: mpf) -> Bend:
    """Refracted or mirrored direction; d and n unit, n on the side of the ray."""
    cosine = dot(d, n)
    rest = 1 - (1 - cosine**2) / eta**2
    if rest <= 0:
        return Bend(mirror(d, n), rest)
    along = plus(d, -cosine, n)
    return Bend(tuple(x / eta - mpmath.sqrt(rest) * y for x, y in zip(along, n, strict=True)), rest)


def arriving(w: Vector, n: Vector, eta: mpf) -> Vector | None:
    """The direction that is refracted to w; None where none is."""
    back = snell(tuple(-x for x in w), tuple(-x for x in n), 1 / eta)
    return tuple(-x for x in back.w) if back.rest > 0 else None


def distance(a: ArrayLike, b: ArrayLike) -> float:
    """Largest difference of a component."""
    with mpmath.workdps(DIGITS):
        return float(max(abs(x - y) for x, y in zip(vector(a), vector(b), strict=True)))


def agrees(w: ArrayLike, total: bool, given: tuple[ArrayLike, ArrayLike, float], tolerance: float) -> bool:
    """Whether w and the verdict of total reflection are what ``given`` (d, n, eta) asks for, within a tolerance.

    By the error of w, wherever the question is well posed. It is not where eta < 1 and the ray leaves at less than 0.1
    rad to the surface: there cos_t = sqrt(1 - sin_i^2 / eta^2), and a rounding of d moves the answer by eps / cos_t, at
    the critical angle without bound. What can be asked there is a small backward error: w is the exact answer for a
    direction that is d within the tolerance. The verdict may be wrong only where cos_t^2 is below the tolerance.
    """
    d, n, eta = given
    with mpmath.workdps(DIGITS):
        incident, normal, index = unit(vector(d)), unit(vector(n)), mpf(float(eta))
        truth = snell(incident, normal, index)
        if total != (truth.rest <= 0):
            return abs(truth.rest) < tolerance
        if total or eta > 1 or truth.rest > 0.01:
            return distance(w, truth.w) < tolerance
        back = arriving(unit(vector(w)), normal, index)
        return back is not None and distance(back, incident) < tolerance


class Triangle(NamedTuple):
    """A triangle of a path, as floats."""

    corners: ArrayLike  # (3, 3) world units
    normals: ArrayLike | None  # (3, 3): shading normals of the corners; None: flat
    ior: float  # behind the triangle over before it


def follow(o: ArrayLike, d: ArrayLike, path: Sequence[Triangle]) -> tuple[Vector, Vector]:
    """Where a ray leaves the last triangle of a path through interfaces, and its unit direction; fails if it misses."""
    with mpmath.workdps(DIGITS):
        origin, way = vector(o), unit(vector(d))
        for triangle in path:
            a, b, c = (vector(corner) for corner in triangle.corners)
            e1, e2 = plus(b, mpf(-1), a), plus(c, mpf(-1), a)
            ng = cross(e1, e2)
            t = dot(ng, plus(a, mpf(-1), origin)) / dot(ng, way)
            assert t > 0
            origin = plus(origin, t, way)
            s = plus(origin, mpf(-1), a)
            u, v = dot(cross(s, e2), ng) / dot(ng, ng), dot(cross(e1, s), ng) / dot(ng, ng)
            assert min(u, v, 1 - u - v) >= 0
            entering = dot(way, ng) < 0
            n = ng
            if triangle.normals is not None:
                n0, n1, n2 = (vector(normal) for normal in triangle.normals)
                n = plus(plus(plus((mpf(0),) * 3, 1 - u - v, n0), u, n1), v, n2)
            n = unit(tuple(x if entering else -x for x in n))
            ior = mpf(float(triangle.ior))
            way = snell(way, n, ior if entering else 1 / ior).w
        return origin, way


def at_angles(angle: NDArray, seed: int, precision: str) -> tuple[NDArray, NDArray]:
    """Unit directions that arrive at these angles to their unit normals, rounded."""
    rng = np.random.default_rng(seed)
    normal = naive.unit(rng.normal(size=(len(angle), 3)))
    along = naive.unit(np.cross(normal, rng.normal(size=normal.shape)))
    d = np.sin(angle)[:, None] * along - np.cos(angle)[:, None] * normal
    return d.astype(precision), normal.astype(precision)


def angles(where: str, eta: float, n: int, seed: int) -> NDArray:
    """n angles of incidence: all through, or where digits are lost."""
    rng = np.random.default_rng(seed)
    critical = np.arcsin(min(eta, 1.0))
    return {
        "all": rng.uniform(0, np.pi / 2, n),
        "through": critical * rng.uniform(0, 1, n),
        "normal": 10.0 ** rng.uniform(-8, -1, n),
        "grazing": np.pi / 2 - 10.0 ** rng.uniform(-7, -2, n),
        "critical": np.minimum(critical + 10.0 ** rng.uniform(-9, -3, n) * rng.choice([-1, 1], n), np.pi / 2 - 1e-6),
    }[where]
