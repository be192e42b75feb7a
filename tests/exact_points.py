"""Closest points in exact arithmetic: distances of rational points, rounded once; and points that are hard to decide.

A float is an integer times a power of two. Scaled to integers, every region test of a triangle is exact, and so is the
squared distance, a ratio of two integers [Ericson2004, 5.1.5]. ``judge`` compares the answers of ``BVH`` with it.
"""

from fractions import Fraction
from math import dist, isqrt
from typing import NamedTuple

import numpy as np

import raytrace as rt
from raytrace.hardcases import meshes

DIGITS = {"float32": 24, "float64": 53}
RESOLUTION = 2.0**-60  # of R: distances that differ by less may count as equal (in slivers)
SMALLEST = {"float32": -149, "float64": -1074}  # exponent of the smallest positive number


class Verdict(NamedTuple):
    """Largest errors in units of eps R, and numbers of answers that are not the rounded exact ones."""

    points: int
    p: float  # error of p beyond the rounding of its coordinates
    distance: float
    not_rounded: int  # distances above R / 10^6 that are not the exact distance of the mesh, rounded once
    not_lowest: int  # where not the lowest of the triangles at the same rounded distance is returned


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def sub(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def along(a, e, share):
    """A + share e, as a numerator and a denominator."""
    up, down = share
    return tuple(x * down + up * y for x, y in zip(a, e, strict=True)), down


def closest(a, b, c):
    """The point of triangle abc closest to the origin: numerators and denominator; all are integers."""
    ab, ac = sub(b, a), sub(c, a)
    d1, d2, d3, d4, d5, d6 = (-dot(e, x) for x in (a, b, c) for e in (ab, ac))
    if d1 <= 0 and d2 <= 0:
        return a, 1
    if d3 >= 0 and d4 <= d3:
        return b, 1
    if d6 >= 0 and d5 <= d6:
        return c, 1
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if vc <= 0 and d1 >= 0 and d3 <= 0:
        return along(a, ab, (d1, d1 - d3))
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        return along(a, ac, (d2, d2 - d6))
    if va <= 0 and d4 >= d3 and d5 >= d6:
        return along(b, sub(c, b), (d4 - d3, d4 - d3 + d5 - d6))
    total = va + vb + vc
    return tuple(x * total + vb * y + vc * z for x, y, z in zip(a, ab, ac, strict=True)), total


def integers(rows):
    """Floats as Python's integers in units of 2^low, and low."""
    pairs = [float(x).as_integer_ratio() for x in np.asarray(rows, np.float64).ravel()]
    low = max(down.bit_length() - 1 for _, down in pairs)
    whole = [up << low >> (down.bit_length() - 1) for up, down in pairs]
    return [tuple(whole[i : i + 3]) for i in range(0, len(whole), 3)], -low


def nearest_float(up, down, precision):
    """Up / down to the nearest float of that precision, ties to even; both are integers, up >= 0."""
    if up == 0:
        return 0.0
    digits = DIGITS[precision]
    exponent = max(up.bit_length() - down.bit_length() - digits, SMALLEST[precision])
    while True:
        scaled_up, scaled_down = (up, down << exponent) if exponent >= 0 else (up << -exponent, down)
        whole, rest = divmod(scaled_up, scaled_down)
        if whole < 1 << digits:
            break
        exponent += 1
    whole += 2 * rest > scaled_down or (2 * rest == scaled_down and whole & 1)
    return float(np.ldexp(float(whole), exponent))


def rounded_root(up, down, low, precision):
    """Sqrt(up / down) 2^low to the nearest float: 300 bits of the root, the last one odd if it is not exact."""
    if up == 0:
        return 0.0
    shift = max(600 - up.bit_length() + down.bit_length(), 0)
    shift += shift & 1
    whole, rest = divmod(up << shift, down)
    root = isqrt(whole)
    root = 2 * root + (root * root != whole or rest != 0)
    exponent = low - shift // 2 - 1
    return nearest_float(root << max(exponent, 0), 1 << max(-exponent, 0), precision)


def approximate(points, corners):
    """Squared distances in float64, (n, m): the plain twin of the kernels; good to about 1e-13 of the largest terms."""
    a, b, c = (points[:, None] - corners[None, :, k] for k in range(3))
    best = np.full(a.shape[:2], np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = p - q
        t = np.clip((p * edge).sum(-1) / (edge * edge).sum(-1), 0, 1)[..., None]
        best = np.minimum(best, ((p - t * edge) ** 2).sum(-1))
    n = np.cross(a - b, a - c)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    inside = np.ones(best.shape, bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (n * np.cross(p - q, p)).sum(-1) >= 0
    return np.where(inside, np.minimum((n * a).sum(-1) ** 2, best), best)


def judge(corners, points, answer, precision):
    """Compare answers with exact arithmetic; corners (m, 3, 3) of triangles that have an area, points (n, 3)."""
    eps = float(np.finfo(precision).eps)
    scale = 0.5 ** np.frexp(float(max(np.abs(corners).max(), np.abs(points).max())))[1]
    with np.errstate(all="ignore"):
        squares = approximate(np.float64(points) * scale, np.float64(corners) * scale)
    reach = np.abs(points * scale).max(axis=1) + np.abs(corners).max() * scale
    near = ~(squares > (squares.min(axis=1) * (1 + 1e-6) + 1e-11 * reach**2)[:, None])
    whole, low = integers(np.concatenate([np.float64(corners).reshape(-1, 3), np.float64(points)]))
    m, worst_p, worst_d, not_rounded, not_lowest = len(corners), 0.0, 0.0, 0, 0
    for i in range(len(points)):
        origin, found = whole[3 * m + i], int(answer.prim_id[i])
        exact = {}
        for j in {*np.flatnonzero(near[i]).tolist(), found}:
            at, down = closest(*(sub(x, origin) for x in whole[3 * j : 3 * j + 3]))
            exact[j] = at, down, Fraction(dot(at, at), down * down)
        rounded = {j: rounded_root(x.numerator, x.denominator, low, precision) for j, (_, _, x) in exact.items()}
        least = min(rounded.values())
        at, down, _ = exact[found]
        radius = eps * max(dist(corner, points[i].tolist()) for corner in corners[found].tolist())
        lowest = min(j for j in rounded if rounded[j] == least)
        not_lowest += found > lowest or rounded[found] - least > RESOLUTION / eps * radius
        not_rounded += float(answer.distance[i]) != least and least * eps > 1e-6 * radius
        worst_d = max(worst_d, abs(float(answer.distance[i]) - least) / radius)
        unit = Fraction(2) ** low
        off = [
            float(abs(Fraction(float(x)) - unit * (o + Fraction(y, down)))) - np.spacing(abs(x)) / 2
            for x, o, y in zip(answer.p[i], origin, at, strict=True)
        ]
        worst_p = max(worst_p, float(np.linalg.norm(np.maximum(off, 0) / radius)))
    return Verdict(len(points), worst_p, worst_d, not_rounded, not_lowest)


def needles(aspect):
    """Slivers with tips of different angles, in all directions."""
    corners = meshes.uniform(3, 12, 3, 3)
    side = corners[:, 1] - corners[:, 0]
    middle = corners[:, 0] + (0.5 + 0.45 * meshes.uniform(4, 12, 1)) * side
    corners[:, 2] = middle + (corners[:, 2] - middle) / aspect
    return corners


def overlapping():
    """Triangles in one plane that overlap, repeat each other with other corners first, and share edges."""
    v, f = meshes.grid(3)
    flat = v[f]
    return np.concatenate([flat, flat[::3, [1, 2, 0]], flat[::4, [0, 2, 1]], flat[:5] * 2.0, flat[:4] + [0.25, 0.5, 0]])


def threads():
    """Slivers through the origin, of heights down to 1e-40, and a triangle of ordinary shape."""
    side = np.round(meshes.uniform(5, 12, 1, 3) * 2**20) / 2**20
    heights = np.logspace(-40, -7, 12)[:, None, None]
    slivers = np.concatenate([-3 * side, 5 * side, heights * meshes.uniform(6, 12, 1, 3)], axis=1)
    return np.concatenate([slivers, [[[1.0, 2.0, 3.0], [2.0, 1.0, 2.5], [1.5, 2.5, 1.5]]]])


MESHES = {
    "cube": lambda: corners_of(meshes.cube()),
    "overlapping": overlapping,
    "icosphere": lambda: corners_of(meshes.icosphere(1)),
    "fan": lambda: corners_of(meshes.fan(40)),
    "needles": lambda: needles(1e3),
    "slivers": lambda: needles(3e5),
    "needles of 1e9": lambda: needles(1e9),
    "threads": threads,
    "strip": lambda: corners_of(meshes.strip(6, 1e6)),
}


def usable(name, scale, precision):
    """Triangles of a mesh that have an area in that precision, (m, 3, 3)."""
    corners = (MESHES[name]() * scale).astype(precision)
    bvh = rt.BVH(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), precision)
    return corners[np.isfinite(bvh.triangles[:, 9])]


def corners_of(mesh):
    vertices, faces = mesh
    return vertices[faces]


def aimed(corners, n, seed, dtype):
    """Points on and above vertices, edges and faces, next to them by some roundings, and near and far away."""
    rng = np.random.default_rng(seed)
    triangle = np.float64(corners[rng.integers(len(corners), size=n)])
    weights = rng.dirichlet((1, 1, 1), n)
    kind = rng.integers(8, size=n)
    weights[kind == 0] = np.eye(3)[rng.integers(3, size=np.count_nonzero(kind == 0))]
    on_edge = (kind == 1) | (kind == 2)
    weights[on_edge] *= np.roll([0.0, 1.0, 1.0], 1)
    weights[kind == 1] = [0.5, 0.0, 0.5]
    weights /= weights.sum(axis=1, keepdims=True)
    on = (weights[..., None] * triangle).sum(axis=1)
    on[kind == 0] = triangle[kind == 0][np.arange(np.count_nonzero(kind == 0)), weights[kind == 0].argmax(axis=1)]
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    size = np.abs(triangle - triangle.mean(axis=1, keepdims=True)).max(axis=(1, 2))[:, None]
    with np.errstate(all="ignore"):
        normal = np.nan_to_num(normal / np.abs(normal).max(axis=1, keepdims=True))
    height = rng.choice([0.0, 0.0, 1e-7, -1e-3, 0.25, -0.5, 1.0, 30.0, 1e4], n)[:, None] * size
    p = on + height * np.round(normal * 4) / 4 * rng.choice([1.0, 1.0, 1.01], n)[:, None]
    p += (kind == 5)[:, None] * rng.integers(-2, 3, (n, 3)) * np.spacing(np.abs(p).astype(dtype)).astype(np.float64)
    p[kind == 6] = rng.uniform(-2, 2, (np.count_nonzero(kind == 6), 3)) * np.abs(corners).max()
    direction = triangle[:, 1] - triangle[:, 0]
    p[kind == 7] = (triangle[:, 1] + direction * rng.choice([1e-7, 1e-3, 0.5, 3.0], n)[:, None])[kind == 7]
    return p.astype(dtype)
