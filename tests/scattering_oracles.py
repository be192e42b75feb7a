"""Checks of scattering functions that know nothing of microfacets: quadrature over the sphere, and chi-square tests."""

import functools
import math
from typing import Any, NamedTuple

import mpmath
import numpy as np

import raytrace as rt

TINY = 5.0  # expected samples: bins with fewer are merged
MATERIALS = {
    "conductor": {"type": "conductor", "eta": [0.2, 0.9, 1.4], "k": [3.9, 2.5, 1.6]},
    "dielectric": {"type": "dielectric", "ior": 1.5},
    "plastic": {"type": "plastic", "albedo": [0.2, 0.5, 0.8], "ior": 1.5},
}


def at_angle(degrees: float) -> np.ndarray:
    """Direction at an angle from z, turned about it so that no axis is special; below the surface beyond 90."""
    angle = math.radians(degrees)
    return np.array([math.sin(angle) * math.cos(0.7), math.sin(angle) * math.sin(0.7), math.cos(angle)])


class Chart(NamedTuple):
    """Coordinates (x, y) of [0, 1)^2 for all directions, fine around an axis.

    The tangent of half the angle to the axis is width sqrt(x / (1 - x)); y is the azimuth.
    """

    axis: np.ndarray  # (3,)
    width: float

    def _frame(self) -> np.ndarray:
        side = np.cross(self.axis, [1.0, 0, 0] if abs(self.axis[0]) < 0.5 else [0, 1.0, 0])
        side /= np.linalg.norm(side)
        return np.stack([side, np.cross(self.axis, side), self.axis])

    def directions(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions, and the solid angle per area of the chart: 2 width^2 / ((1 - x)^2 (1 + tan^2)^2) 2 pi."""
        tan2 = self.width**2 * x / (1 - x)
        sin, cos = 2 * np.sqrt(tan2) / (1 + tan2), (1 - tan2) / (1 + tan2)
        local = np.stack([sin * np.cos(2 * np.pi * y), sin * np.sin(2 * np.pi * y), cos], axis=-1)
        return local @ self._frame(), 4 * np.pi * self.width**2 / ((1 - x) * (1 + tan2)) ** 2

    def horizon(self, y: np.ndarray) -> np.ndarray:
        """The x from which on directions lie on the other side of the surface than the axis."""
        frame = self._frame() * (1.0 if self.axis[2] > 0 else -1.0)
        slope = frame[0, 2] * np.cos(2 * np.pi * y) + frame[1, 2] * np.sin(2 * np.pi * y)
        tan2 = np.tan((np.arctan2(slope, frame[2, 2]) + np.pi / 2) / 2) ** 2
        return np.asarray(tan2 / (tan2 + self.width**2))

    def coordinates(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        local = directions @ self._frame().T
        tan2 = (local[:, 0] ** 2 + local[:, 1] ** 2) / (1 + np.maximum(local[:, 2], -1 + 1e-12)) ** 2
        return tan2 / (tan2 + self.width**2), np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) % 1


def charts(material: dict[str, Any], wo: np.ndarray) -> list[tuple[int, Chart]]:
    """A chart for each side of the surface, around its perfectly specular direction."""
    alpha = material.get("alpha", 1.0)
    mirror = np.array([-wo[0], -wo[1], wo[2]])
    eta = material.get("ior", 1.0) if wo[2] > 0 else 1 / material.get("ior", 1.0)
    across = -wo[:2] / eta
    length = math.hypot(*across)
    across /= max(length, 1.0)  # where all is reflected, what is rough transmits along the surface
    rest = math.sqrt(1 - length**2) if length < 1 else 1e-9
    through = np.array([*across, -math.copysign(rest, wo[2])])
    bend = abs(eta - 1) / eta if material["type"] == "dielectric" and length < 1 else 1.0
    return [(1, Chart(mirror, alpha)), (-1, Chart(through, alpha * bend if length < 1 else min(alpha, 0.1)))]


def cell_integrals(function: Any, chart: Chart, bins: int, cells: np.ndarray, fine: int) -> np.ndarray:
    """Integral of a function of directions on the axis' side of the surface, over cells of a grid of bins x bins.

    Gauss's quadrature with fine^2 nodes in each cell, in x up to the horizon, so that it cuts no smooth piece.
    """
    nodes, weights = np.polynomial.legendre.leggauss(fine)
    nodes, weights = (nodes + 1) / 2, weights / 2
    low, y = (cells // bins)[:, None] / bins, ((cells % bins)[:, None] + nodes) / bins  # (c, 1), (c, fine)
    high = np.minimum(low + 1 / bins, np.maximum(chart.horizon(y), low))
    x = low[..., None] + (high - low)[..., None] * nodes  # (c, fine, fine)
    directions, angle = chart.directions(x.ravel(), np.broadcast_to(y[..., None], x.shape).ravel())
    inner = (function(directions) * angle).reshape(x.shape) @ weights * (high - low)
    return np.asarray(inner @ weights / bins)


def integrals(function: Any, chart: Chart, bins: int, n: int, finest: int) -> np.ndarray:
    """Expected counts of n samples in all cells; those that n samples could tell from another grid's are refined."""
    cells, fine = np.arange(bins**2), 8
    counts = n * cell_integrals(function, chart, bins, cells, fine)
    while len(cells) and fine < finest:
        fine *= 2
        better = n * cell_integrals(function, chart, bins, cells, fine)
        unsure = np.abs(better - counts[cells]) > 0.03 * np.sqrt(better) + 1e-3
        counts[cells], cells = better, cells[unsure]
    return counts


def chi_square(material: dict[str, Any], wo: np.ndarray, n: int, finest: int, drawn: Any = None) -> float:
    """p-value of the hypothesis that ``sample`` draws from ``pdf``; samples that carry nothing are a cell of their own.

    ``drawn``: another material to draw from, so that the test can be seen to fail.
    """
    bins, seed = 12, int(1e4 * abs(wo[2])) + int(1e6 * material.get("alpha", 0))
    u = np.random.default_rng(seed).random((n, 3))
    wi, _, density = rt.bsdf.sample(drawn or material, wo, u)
    found = np.isfinite(density) & (density > 0)
    observed, expected = [], []
    for side, chart in charts(material, wo):
        expected.append(integrals(lambda directions: rt.bsdf.pdf(material, wo, directions), chart, bins, n, finest))
        x, y = chart.coordinates(wi[found & (wi[:, 2] * side * wo[2] > 0)])
        cell = np.minimum((x * bins).astype(int), bins - 1) * bins + np.minimum((y * bins).astype(int), bins - 1)
        observed.append(np.bincount(cell, minlength=bins**2))
    return p_value(np.concatenate(observed), np.concatenate(expected), n)


def p_value(observed: np.ndarray, expected: np.ndarray, n: int) -> float:
    """p-value of Pearson's test; the cell of what is in none of these is added, rare cells are merged."""
    observed, expected = np.append(observed, n - observed.sum()), np.append(expected, n - expected.sum())
    rare = expected < TINY
    few = observed[rare].sum(), expected[rare].sum()
    observed, expected = observed[~rare], expected[~rare]
    if few[1] >= TINY:
        observed, expected = np.append(observed, few[0]), np.append(expected, few[1])
    elif few[0] > 40:  # samples where none should be
        return 0.0
    statistic = ((observed - expected) ** 2 / expected).sum()
    return float(mpmath.gammainc((len(observed) - 1) / 2, statistic / 2, regularized=True))


def correlation(alpha: float, o: np.ndarray, i: np.ndarray) -> np.ndarray:
    """Height-correlated masking over the separable one, for reflection: (1 + a) (1 + b) / (1 + a + b) [Walter2007]."""

    def hidden(v: np.ndarray) -> np.ndarray:
        tan2 = (v[..., 0] ** 2 + v[..., 1] ** 2) / np.maximum(v[..., 2] ** 2, 1e-20)
        return np.asarray((np.sqrt(1 + alpha**2 * tan2) - 1) / 2)

    a, b = hidden(o), hidden(i)
    return np.asarray((1 + a) * (1 + b) / (1 + a + b))


def energy(material: dict[str, Any], wo: np.ndarray, fine: int = 16, correlated: bool = False) -> np.ndarray:
    """Share of even light, (3,), that leaves towards wo, but for perfectly specular parts: the integral of f cos.

    Where light is transmitted, radiance is multiplied by n^2, so that energy is what is counted. ``correlated``: with
    height-correlated masking, of conductors only.
    """
    ior = material.get("ior", 1.0) if wo[2] > 0 else 1 / material.get("ior", 1.0)
    total = np.zeros(3)
    for side, chart in charts(material, wo):
        factor = 1.0 if side > 0 else ior**2

        def leaving(directions: np.ndarray, channel: int) -> np.ndarray:
            f = rt.bsdf.eval(material, wo, directions)[:, channel]
            f = f * correlation(material["alpha"], wo, directions) if correlated else f
            return np.asarray(f * np.abs(directions[:, 2]))

        for channel in range(3):
            one = functools.partial(leaving, channel=channel)
            total[channel] += factor * cell_integrals(one, chart, 12, np.arange(144), fine).sum()
    return total
