"""Checks of scattering functions that know nothing of microfacets: quadrature over the sphere, and chi-square tests."""

import functools
import math
from typing import Any

import numpy as np

import raytrace as rt
from raytrace.testing.charts import Chart, cell_integrals

MATERIALS = {
    "conductor": {"type": "conductor", "eta": [0.2, 0.9, 1.4], "k": [3.9, 2.5, 1.6]},
    "dielectric": {"type": "dielectric", "ior": 1.5},
    "plastic": {"type": "plastic", "albedo": [0.2, 0.5, 0.8], "ior": 1.5},
}


def at_angle(degrees: float) -> np.ndarray:
    """Direction at an angle from z, turned about it so that no axis is special; below the surface beyond 90."""
    angle = math.radians(degrees)
    return np.array([math.sin(angle) * math.cos(0.7), math.sin(angle) * math.sin(0.7), math.cos(angle)])


def side_chart(axis: np.ndarray, width: float) -> Chart:
    """A chart around an axis, of the directions on its side of the surface."""
    return Chart(tuple(axis.tolist()), width, 1 if axis[2] > 0 else -1)


def charts(material: dict[str, Any], wo: np.ndarray) -> list[Chart]:
    """A chart for each side of the surface, around its perfectly specular direction; the viewer's side first."""
    alpha = material.get("alpha", 1.0)
    mirror = np.array([-wo[0], -wo[1], wo[2]])
    eta = material.get("ior", 1.0) if wo[2] > 0 else 1 / material.get("ior", 1.0)
    across = -wo[:2] / eta
    length = math.hypot(*across)
    across /= max(length, 1.0)  # where all is reflected, what is rough transmits along the surface
    rest = math.sqrt(1 - length**2) if length < 1 else 1e-9
    through = np.array([*across, -math.copysign(rest, wo[2])])
    bend = abs(eta - 1) / eta if material["type"] == "dielectric" and length < 1 else 1.0
    return [side_chart(mirror, alpha), side_chart(through, alpha * bend if length < 1 else min(alpha, 0.1))]


def chi_square(material: dict[str, Any], wo: np.ndarray, n: int, finest: int, drawn: Any = None) -> float:
    """p-value of the hypothesis that ``sample`` draws from ``pdf``; samples that carry nothing are a cell of their own.

    ``drawn``: another material to draw from, so that the test can be seen to fail.
    """
    seed = int(1e4 * abs(wo[2])) + int(1e6 * material.get("alpha", 0))

    def sample(u: np.ndarray) -> np.ndarray:
        wi, _, density = rt.bsdf.sample(drawn or material, wo, u)
        return np.where((np.isfinite(density) & (density > 0))[:, None], wi, np.nan)

    try:
        found = rt.testing.chi_square(
            sample,
            lambda directions: rt.bsdf.pdf(material, wo, directions),
            n=n,
            dimensions=3,
            charts=charts(material, wo),
            finest=finest,
            seed=seed,
        )
    except rt.testing.StatisticalError as error:
        found = error.result
    return float(found.p_value)


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
    for chart, factor in zip(charts(material, wo), (1.0, ior**2), strict=True):

        def leaving(directions: np.ndarray, channel: int) -> np.ndarray:
            f = rt.bsdf.eval(material, wo, directions)[:, channel]
            f = f * correlation(material["alpha"], wo, directions) if correlated else f
            return np.asarray(f * np.abs(directions[:, 2]))

        for channel in range(3):
            one = functools.partial(leaving, channel=channel)
            total[channel] += factor * cell_integrals(one, chart, 12, np.arange(144), fine).sum()
    return total
