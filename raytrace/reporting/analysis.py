"""Analysis of the measured points: the Pareto front, fitted orders of convergence, and round numbers."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from raytrace.reporting.configurations import Configuration
from raytrace.reporting.intervals import student
from raytrace.reporting.measurements import Point

NICE = 1, 2, 5  # round numbers are these times powers of ten
TIE = 0.01  # relative difference below which errors count as equal


class Order(NamedTuple):
    """Error ~ spp^order, fitted to the points of a configuration."""

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
        rest = y - start - slope * x
        half = student(len(x) - 1) * math.sqrt(rest @ rest / (len(x) - 2) / (dx @ dx))
    return Order(configuration, slope, slope - half, slope + half, math.exp(start), len(x))


def curves_of(points: Iterable[Point]) -> dict[Configuration, list[Point]]:
    """Points of each configuration, sorted by increasing cost."""
    curves: dict[Configuration, list[Point]] = {}
    for point in points:
        curves.setdefault(point.configuration, []).append(point)
    return curves


def orders_of(points: Iterable[Point]) -> list[Order]:
    """Orders of convergence (sRGB) of selectable configurations with three or more points, without adaptive ones."""
    orders = []
    for configuration, curve in curves_of(points).items():
        if not configuration.selectable or configuration.adaptive:  # others have the same samples, so the same order
            continue
        good = [point for point in curve if point.rmse_srgb > 0.0]
        if len({point.spp for point in good}) > 2:
            orders.append(fit_order(configuration, [p.spp for p in good], [p.rmse_srgb for p in good]))
    return orders


def pareto(points: Sequence[Point]) -> list[bool]:
    """Whether each point is on the Pareto front: no other is faster and as accurate, or as fast and more accurate.

    Errors within `TIE` of each other count as equal: the same samples in another tree may differ in the last bits.
    """

    def beats(q: Point, p: Point) -> bool:
        if q.seconds == p.seconds:
            return q.rmse_srgb < p.rmse_srgb
        return q.seconds < p.seconds and q.rmse_srgb <= (1 + TIE) * p.rmse_srgb

    return [not any(beats(other, point) for other in points) for point in points]


def needed(curve: Sequence[Point], error: float) -> tuple[float, float] | None:
    """Samples per pixel and seconds that a configuration needs to reach an error, at a point or between two points.

    The fastest possibility is returned. Between points, the interpolation is logarithmic in both axes. None: the
    configuration does not reach the error.
    """
    measured = [(point.spp, point.seconds) for point in curve if point.rmse_srgb <= error]
    between = None if curve[0].rmse_srgb <= error else _between(curve, error)
    return min([*measured, *([between] if between else [])], key=lambda need: need[1], default=None)


def _between(curve: Sequence[Point], error: float) -> tuple[float, float] | None:
    """Samples per pixel and seconds where a curve first falls below an error."""
    for p, q in pairwise(curve):
        if q.rmse_srgb <= error < p.rmse_srgb:
            if q.rmse_srgb == 0.0:
                return q.spp, q.seconds
            share = math.log(p.rmse_srgb / error) / math.log(p.rmse_srgb / q.rmse_srgb)
            return p.spp * (q.spp / p.spp) ** share, p.seconds * (q.seconds / p.seconds) ** share
    return None


def nice_numbers(values: Sequence[float], most: int) -> list[float]:
    """Round numbers (1, 2, 5 times powers of ten) within the range of positive values, at most `most`, evenly spread.

    If there is none in the range, it is the geometric middle, to two digits.

    >>> nice_numbers([0.003, 0.4], 3), nice_numbers([0.011, 0.013], 3)
    ([0.005, 0.02, 0.2], [0.012])
    """
    known = [value for value in values if value > 0.0]
    if not known:
        return []
    low, high = min(known), max(known)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    inside = [number for k in decades for n in NICE if low <= (number := float(f"{n:g}e{k}")) <= high]
    if not inside:
        middle = float(f"{math.sqrt(low * high):.2g}")
        return [middle if low <= middle <= high else high]
    picks = np.linspace(0, len(inside) - 1, min(most, len(inside))).round().astype(int)
    return [inside[k] for k in picks]
