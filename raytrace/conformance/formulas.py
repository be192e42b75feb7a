"""Closed forms of light transport, in float64; docs/closed-forms.md derives them."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def furnace(albedo: float, emission: float, depth: int) -> float:
    """Radiance in a closed room of equal walls, after ``depth`` surfaces: Le (1 - rho^(d + 1)) / (1 - rho).

    >>> furnace(0.5, 0.25, 1), furnace(0.5, 0.25, 100)
    (0.375, 0.5)
    """
    return emission * (1 - albedo ** (depth + 1)) / (1 - albedo)


def lossy_furnace(albedo: float, emission: float, first: int) -> float:
    """Radiance in that room if roulette, from surface ``first`` on, survives with the throughput and does not divide.

    >>> round(lossy_furnace(0.5, 0.25, 1000), 6)
    0.5
    """
    throughput, alive, total = 1.0, 1.0, emission
    for surface in range(1, 1000):
        throughput *= albedo
        alive *= throughput if surface >= first else 1.0
        total += emission * throughput * alive
    return total


def lit_sphere(flux: float, radius: float, albedo: float, depth: int) -> float:
    """Radiance in a sphere with a point light at its centre, after ``depth`` surfaces.

    >>> round(lit_sphere(2 * math.pi**2, 1, 0.5, 1), 12)
    0.25
    """
    irradiance = flux / (4 * math.pi * radius**2)
    return albedo * irradiance / math.pi * (1 - albedo**depth) / (1 - albedo)


def polygon_irradiance(corners: ArrayLike) -> float:
    """Irradiance at the origin, on a plane of normal z, of a polygon of radiance 1 [Lambert1760].

    It is half the sum, over all edges, of the angle that the edge subtends times the z component of the unit normal of
    the plane through the origin and the edge. The polygon must lie above the plane.
    """
    points = np.asarray(corners, np.float64)
    units = points / np.linalg.norm(points, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(units, np.roll(units, -1, axis=0), strict=True):
        cross = np.cross(a, b)
        total += math.acos(np.dot(a, b)) * cross[2] / np.linalg.norm(cross) / 2
    return abs(float(total))


def opposed_squares(distance: float = 1.0) -> float:
    """Form factor of two equal, parallel, directly opposed squares of side 1 [Howell, C-11].

    >>> round(opposed_squares(), 6)
    0.199825
    """
    x = 1 / distance
    s = math.sqrt(1 + x * x)
    logarithm = math.log((1 + x * x) / math.sqrt(1 + 2 * x * x))
    return 2 / (math.pi * x * x) * (logarithm + 2 * x * s * math.atan(x / s) - 2 * x * math.atan(x))


def fresnel(cosine: float, ior: float) -> float:
    """Reflectance of a smooth dielectric for unpolarised light; ``ior`` is that of the far side over the near side."""
    sine2 = (1 - cosine * cosine) / (ior * ior)
    if sine2 >= 1:
        return 1.0
    inner = math.sqrt(1 - sine2)
    rs, rp = (cosine - ior * inner) / (cosine + ior * inner), (ior * cosine - inner) / (ior * cosine + inner)
    return (rs * rs + rp * rp) / 2


def conductor(cosine: float, eta: float, k: float) -> float:
    """Reflectance of a conductor of complex index eta + i k, for unpolarised light.

    >>> round(conductor(1.0, 0.2, 3.0), 6) == round((0.8**2 + 9) / (1.2**2 + 9), 6)
    True
    """
    n = complex(eta, k)
    inner = (1 - (1 - cosine * cosine) / (n * n)) ** 0.5
    rs, rp = (cosine - n * inner) / (cosine + n * inner), (n * cosine - inner) / (n * cosine + inner)
    return (abs(rs) ** 2 + abs(rp) ** 2) / 2


def slab_transmission(r: float, depth: int | None = None) -> float:
    """Share of light that a lossless plate passes, of reflectance r per side; of paths of at most ``depth`` surfaces.

    (1 - r)^2 (1 + r^2 + r^4 ...): (1 - r) / (1 + r) in the limit.
    """
    terms = math.inf if depth is None else depth // 2  # each pair of surfaces more is a term more
    return (1 - r) / (1 + r) * (1 - r ** (2 * terms)) if r else float(terms > 0)


def slab_reflection(r: float, depth: int | None = None) -> float:
    """Share of light that a lossless plate sends back: r + (1 - r)^2 r (1 + r^2 ...), 2 r / (1 + r) in the limit."""
    terms = math.inf if depth is None else (depth - 1) // 2
    return r + (1 - r) / (1 + r) * r * (1 - r ** (2 * terms))


def inside_slab(ior: float, depth: int | None = None) -> float:
    """Radiance inside of a plate of glass, at right angles to it, in an environment of 1: n^2 (1 - r^d)."""
    r = fresnel(1.0, ior)
    return ior * ior * (1 if depth is None else 1 - r**depth)


def rough_albedo(alpha: float, nodes: int = 400) -> float:
    """Share of light that a white GGX mirror reflects at normal incidence with one scattering.

    The integral over t = tan^2 of the angle of the microfacet's normal, from 0 to 1, of alpha^2 / (alpha^2 + t)^2
    times G1 of the reflected direction, 2 (1 - t) / (1 - t + sqrt((1 - t)^2 + 4 alpha^2 t)). 1 - ln 2 where alpha is 1.

    >>> round(rough_albedo(1.0) - (1 - math.log(2)), 9)
    0.0
    """
    x, weights = np.polynomial.legendre.leggauss(nodes)
    low = alpha**2 / (1 + alpha**2)  # t as a function of s = alpha^2 / (alpha^2 + t): dt alpha^2 / (...)^2 = -ds
    s = low + (1 - low) * (x + 1) / 2
    t = alpha**2 * (1 - s) / s
    seen = 2 * (1 - t) / (1 - t + np.sqrt((1 - t) ** 2 + 4 * alpha**2 * t))
    return float((seen * weights).sum() * (1 - low) / 2)


def plastic_albedo(cosine: float, albedo: float, ior: float) -> float:
    """Share of even light that a smooth coat over a diffuse base sends back.

    F + (1 - F) a (1 - Fi) / (1 - a Fi); Fi is the diffuse reflectance of the coat from inside [Walsh1926].
    """
    f, inner = fresnel(cosine, ior), 1 - (1 - _diffuse_fresnel(ior)) / ior**2
    return f + (1 - f) * albedo * (1 - inner) / (1 - albedo * inner)


def _diffuse_fresnel(n: float) -> float:
    """Diffuse reflectance of a dielectric from outside [Walsh1926]; it loses digits near n = 1."""
    a = (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2)
    a += n**2 * (n**2 - 1) ** 2 / (n**2 + 1) ** 3 * math.log((n - 1) / (n + 1))
    b = 2 * n**3 * (n**2 + 2 * n - 1) / ((n**2 + 1) * (n**4 - 1))
    return 0.5 + a - b + 8 * n**4 * (n**4 + 1) / ((n**2 + 1) * (n**4 - 1) ** 2) * math.log(n)


def blurred_edge(x: ArrayLike) -> NDArray[np.float64]:
    """Share of a disc of radius 1 at points with coordinate below ``x``: the image of an edge out of focus."""
    x = np.clip(np.asarray(x, np.float64), -1, 1)
    return np.asarray(1 - (np.arccos(x) - x * np.sqrt(1 - x * x)) / math.pi)


def bright_texel(height: int, row: int) -> float:
    """Irradiance of one texel of radiance 1 of an environment, on a plane that faces it: (pi / h)^2 sin(theta)."""
    return (math.pi / height) ** 2 * math.sin(math.pi * (row + 0.5) / height)


def texel_direction(height: int, row: int, column: int) -> NDArray[np.float64]:
    """Direction of the centre of a texel of an environment of height x 2 height texels, as the scene format has it."""
    theta, azimuth = math.pi * (row + 0.5) / height, math.pi * (column + 0.5) / height
    return np.array([math.sin(theta) * math.sin(azimuth), math.cos(theta), -math.sin(theta) * math.cos(azimuth)])
