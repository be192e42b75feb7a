"""What the points of a sweep say: orders of convergence, the Pareto front, and what an error costs."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measure import Point

CONFIDENCE = 0.95  # of intervals
TIE = 0.01  # relative difference of errors that means nothing


class Order(NamedTuple):
    """Error ~ spp^order, fitted to a configuration's points."""

    configuration: Configuration
    order: float
    low: float  # of the confidence interval; NaN with two points
    high: float
    at_one: float  # fitted error at one sample per pixel
    points: int


def fit_order(configuration: Configuration, spp: Sequence[float], error: Sequence[float]) -> Order:
    """Fit a straight line to log error against log spp, by least squares.

    Parameters
    ----------
    configuration : Configuration
    spp, error : sequence of float
        Positive; at least two different numbers of samples.

    Returns
    -------
    Order
        With a 95 % interval: slope +- t(n - 2) s / sqrt(sum (x - mean x)^2), Student's t, s^2 the residual variance.

    Examples
    --------
    >>> fit = fit_order(Configuration("sobol", "float32"), [1, 4, 16], [0.8, 0.2, 0.05])
    >>> round(fit.order, 3), round(fit.at_one, 3)
    (-1.0, 0.8)
    """
    x, y = np.log(np.asarray(spp, float)), np.log(np.asarray(error, float))
    dx = x - x.mean()
    slope = float(dx @ y / (dx @ dx))
    start = float(y.mean() - slope * x.mean())
    half = math.nan
    if len(x) > 2:
        from scipy.special import stdtrit  # comes with scikit-image

        rest = y - start - slope * x
        half = float(stdtrit(len(x) - 2, (1 + CONFIDENCE) / 2) * math.sqrt(rest @ rest / (len(x) - 2) / (dx @ dx)))
    return Order(configuration, slope, slope - half, slope + half, math.exp(start), len(x))


def curves_of(points: Iterable[Point]) -> dict[Configuration, list[Point]]:
    """Points of each configuration, from cheap to dear."""
    curves: dict[Configuration, list[Point]] = {}
    for point in points:
        curves.setdefault(point.configuration, []).append(point)
    return curves


def orders_of(points: Iterable[Point]) -> list[Order]:
    """Orders of convergence (sRGB) of the usual configurations with at least three points; adaptive sampling has none."""
    orders = []
    for configuration, curve in curves_of(points).items():
        if (
            not configuration.usual or configuration.adaptive
        ):  # the samples, and so the order, are those of the usual configuration
            continue
        good = [point for point in curve if point.rmse_srgb > 0.0]
        if len({point.spp for point in good}) > 2:
            orders.append(fit_order(configuration, [p.spp for p in good], [p.rmse_srgb for p in good]))
    return orders


def pareto(points: Sequence[Point]) -> list[bool]:
    """Tell for each point whether no other is quicker and as accurate, or as quick and more accurate.

    Errors within `TIE` of each other are equal: the same samples through another tree differ in their last bits.
    """

    def beats(q: Point, p: Point) -> bool:
        if q.seconds == p.seconds:
            return q.rmse_srgb < p.rmse_srgb
        return q.seconds < p.seconds and q.rmse_srgb <= (1 + TIE) * p.rmse_srgb

    return [not any(beats(other, point) for other in points) for point in points]


def needed(curve: Sequence[Point], error: float) -> tuple[float, float] | None:
    """Samples per pixel and seconds that a configuration needs for an error: of a point, or between two points.

    The quickest of all; between points, both axes are logarithmic. None where the configuration never gets there.
    """
    measured = [(point.spp, point.seconds) for point in curve if point.rmse_srgb <= error]
    between = None if curve[0].rmse_srgb <= error else _between(curve, error)
    return min([*measured, *([between] if between else [])], key=lambda need: need[1], default=None)


def _between(curve: Sequence[Point], error: float) -> tuple[float, float] | None:
    """Samples per pixel and seconds where a curve first goes below an error."""
    for p, q in pairwise(curve):
        if q.rmse_srgb <= error < p.rmse_srgb:
            if q.rmse_srgb == 0.0:
                return q.spp, q.seconds
            share = math.log(p.rmse_srgb / error) / math.log(p.rmse_srgb / q.rmse_srgb)
            return p.spp * (q.spp / p.spp) ** share, p.seconds * (q.seconds / p.seconds) ** share
    return None
