"""Local slopes: how fast the error falls between two neighbouring numbers of samples."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from raytrace.reporting.analysis import curves_of
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.intervals import UNKNOWN, Interval, student
from raytrace.reporting.measurements import Point

WIDE = 0.25  # width of an interval from which a slope is withheld: it could not tell -1/2 from -3/4


class Slope(NamedTuple):
    """The slope of log error against log samples between two neighbouring numbers of samples."""

    configuration: Configuration
    spp: tuple[float, float]
    slope: float
    interval: Interval

    @property
    def certain(self) -> bool:
        """Whether the interval is narrow enough for the slope to be shown."""
        return self.interval.known and self.interval.high - self.interval.low <= WIDE


def slope_between(few: Point, many: Point) -> Slope:
    """Return the local slope between two points of a configuration, with a 95 % interval.

    Notes
    -----
    With the mean squared errors m and M of n and N samples per pixel, ``slope = log(M / m) / (2 log(N / n))``.

    Render i has the same seed in both, and an image of n samples may be the first part of one of N samples, so their
    errors m_i and M_i are correlated. The interval therefore uses pairs. By the delta method, as for a ratio of means
    [Cochran1977, section 6.4], ``log(M / m)`` has the variance of the mean of
    ``d_i = M_i / M - m_i / m``. With k pairs, the half-width is ``t(k - 1) s_d / sqrt(k) / (2 log(N / n))``.
    """
    pairs = np.array(list(zip(few.squares, many.squares, strict=False)), np.float64).reshape(-1, 2)
    span = 2 * math.log(many.spp / few.spp)
    slope = 2 * math.log(many.rmse_srgb / few.rmse_srgb) / span
    if len(pairs) < 2:
        return Slope(few.configuration, (few.spp, many.spp), slope, UNKNOWN)
    differences = np.diff(pairs / pairs.mean(axis=0), axis=1)[:, 0]
    half = student(len(pairs)) * float(differences.std(ddof=1)) / math.sqrt(len(pairs)) / span
    return Slope(few.configuration, (few.spp, many.spp), slope, Interval(slope - half, slope + half))


def slopes_of(points: Sequence[Point]) -> list[Slope]:
    """Local slopes of all selectable configurations, and of other renderers.

    Adaptive sampling has none: its numbers of samples differ from pixel to pixel.
    """
    found = []
    for configuration, curve in curves_of(points).items():
        if configuration.adaptive or not configuration.standard:
            continue
        good = [point for point in curve if point.rmse_srgb > 0.0]
        found += [slope_between(a, b) for a, b in pairwise(good) if b.spp > a.spp]
    return found


def steep_text(slope: Slope) -> str:
    """Format a slope with its interval; or why it is withheld.

    >>> way = Configuration("sobol", "float32")
    >>> steep_text(Slope(way, (64, 128), -0.771, Interval(-0.79, -0.752)))
    '-0.77 ±0.02'
    >>> steep_text(Slope(way, (64, 128), -0.7, Interval(-1.9, 0.5)))
    'uncertain'
    """
    half = (slope.interval.high - slope.interval.low) / 2
    return f"{slope.slope:.2f} ±{half:.2f}" if slope.certain else "uncertain"
