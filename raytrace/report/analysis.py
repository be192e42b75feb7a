"""What the points of a sweep say: orders of convergence, the Pareto front, and advice."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from raytrace.report.measure import Point
from raytrace.report.ways import Way

CONFIDENCE = 0.95  # of intervals
NEGLIGIBLE = 1 / 3  # an error this much smaller than another adds 5 % to it: sqrt(1 + 1/9) = 1.05
NICE = 1.0, 2.0, 5.0  # errors that advice is given for, times powers of ten


class Order(NamedTuple):
    """Error ~ spp^order, fitted to a way's points."""

    way: Way
    order: float
    low: float  # of the confidence interval; NaN with two points
    high: float
    at_one: float  # fitted error at one sample per pixel
    points: int


def fit_order(way: Way, spp: Sequence[float], error: Sequence[float]) -> Order:
    """Fit a straight line to log error against log spp, by least squares.

    Parameters
    ----------
    way : Way
    spp, error : sequence of float
        Positive; at least two different numbers of samples.

    Returns
    -------
    Order
        With a 95 % interval: slope +- t(n - 2) s / sqrt(sum (x - mean x)^2), Student's t, s^2 the residual variance.

    Examples
    --------
    >>> fit = fit_order(Way("sobol", "float32"), [1, 4, 16], [0.8, 0.2, 0.05])
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
    return Order(way, slope, slope - half, slope + half, math.exp(start), len(x))


def curves_of(points: Iterable[Point]) -> dict[Way, list[Point]]:
    """Points of each way, from cheap to dear."""
    curves: dict[Way, list[Point]] = {}
    for point in points:
        curves.setdefault(point.way, []).append(point)
    return curves


def orders_of(points: Iterable[Point]) -> list[Order]:
    """Orders of convergence on a screen, of the ways with three points or more."""
    orders = []
    for way, curve in curves_of(points).items():
        good = [point for point in curve if point.rmse_srgb > 0.0]
        if len({point.spp for point in good}) > 2:
            orders.append(fit_order(way, [p.spp for p in good], [p.rmse_srgb for p in good]))
    return orders


def pareto(points: Sequence[Point]) -> list[bool]:
    """Tell for each point whether no other is as quick and as accurate, and better in one of the two."""

    def beaten(p: Point) -> bool:
        return any(
            q.seconds <= p.seconds
            and q.rmse_srgb <= p.rmse_srgb
            and (q.seconds, q.rmse_srgb) != (p.seconds, p.rmse_srgb)
            for q in points
        )

    return [not beaten(point) for point in points]


def needed(curve: Sequence[Point], error: float) -> tuple[float, float] | None:
    """Samples per pixel and seconds that a way needs for an error, between its points on logarithmic axes.

    None where it never gets there; the first point where that is good enough already.
    """
    if curve[0].rmse_srgb <= error:
        return curve[0].spp, curve[0].seconds
    for p, q in pairwise(curve):
        if q.rmse_srgb <= error < p.rmse_srgb:
            if q.rmse_srgb == 0.0:
                return q.spp, q.seconds
            share = math.log(p.rmse_srgb / error) / math.log(p.rmse_srgb / q.rmse_srgb)
            return p.spp * (q.spp / p.spp) ** share, p.seconds * (q.seconds / p.seconds) ** share
    return None


def nice_errors(points: Sequence[Point]) -> list[float]:
    """Round numbers within the errors of the points: the large, the middle and the small one."""
    errors = [point.rmse_srgb for point in points if point.rmse_srgb > 0.0]
    if not errors:
        return []
    low, high = min(errors), max(errors)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    inside = [error for k in decades for n in NICE if low <= (error := float(f"{n:g}e{k}")) <= high]
    return sorted({inside[0], inside[len(inside) // 2], inside[-1]}, reverse=True) if inside else [high]


def advice(points: Sequence[Point], orders: Sequence[Order], gaps: Mapping[int, float]) -> list[str]:
    """Say in sentences what to use; the first one is the answer for an error in the middle of what was measured."""
    curves, errors = curves_of(points), nice_errors(points)
    best = [line for error in errors if (line := _best(curves, error))]
    if len(best) > 1:
        best.insert(0, best.pop(len(best) // 2))
    lines = best[:1] + _precisions(curves, orders, gaps) + _samplers(orders) + _costs(curves)
    return lines[:1] + best[1:] + lines[1:]


def _best(curves: Mapping[Way, Sequence[Point]], error: float) -> str:
    found = {way: need for way, curve in curves.items() if (need := needed(curve, error))}
    if not found:
        return ""
    way = min(found, key=lambda way: found[way][1])
    spp, seconds = found[way]
    return f"For RMSE {error:g} on this scene: {way.name}, {math.ceil(spp - 1e-9)} spp, {_short(seconds)} s."


def _ratio(one: Sequence[Point], other: Sequence[Point]) -> float | None:
    """Median over the steps that both have of time / time of the other."""
    times = {point.step: point.seconds for point in other}
    ratios = [point.seconds / times[point.step] for point in one if point.step in times]
    return float(np.median(ratios)) if ratios else None


def _precisions(curves: Mapping[Way, Sequence[Point]], orders: Sequence[Order], gaps: Mapping[int, float]) -> list[str]:
    single, double = (curves.get(Way("sobol", precision)) for precision in ("float32", "float64"))
    ratio = _ratio(double, single) if single and double else None
    if ratio is None:
        return []
    line = f"float64 costs {ratio:.2g}x as much time as float32"
    fits = {fit.way: fit for fit in orders}
    fit = fits.get(Way("sobol", "float64")) or fits.get(Way("sobol", "float32"))
    if not gaps or not fit:
        return [line + "."]
    gap = gaps[max(gaps)]
    if gap == 0.0:
        return [line + " and gives the same picture."]
    limit = useless_below(fit, gap)
    if limit < 1:
        return [line + " and is needed: float32 is off by more than the noise."]
    return [line + f" and gains nothing below {two_digits(limit)} spp."]


def useless_below(fit: Order, gap: float) -> float:
    """Samples per pixel up to which a difference of precisions is lost in the error of sampling.

    The difference is that of the most samples which both precisions drew; it is assumed not to shrink further.
    """
    return float((gap / NEGLIGIBLE / fit.at_one) ** (1 / fit.order)) if fit.order < 0 else math.inf


def two_digits(number: float) -> str:
    """Write a large number with two digits that count.

    >>> two_digits(4123.0), two_digits(37.4)
    ('4,100', '37')
    """
    if not math.isfinite(number):
        return "any number of"
    return f"{round(number, 1 - math.floor(math.log10(number))):,.0f}"


def _samplers(orders: Sequence[Order]) -> list[str]:
    plain = [
        fit for fit in orders if not fit.way.adaptive and (fit.way.triangle, fit.way.tree) == ("watertight", "sah")
    ]
    texts = [
        f"{fit.way.sampler} as spp^{fit.order:.2f}" for fit in plain if fit.way.precision == plain[0].way.precision
    ]
    return [f"The error shrinks: {', '.join(texts)}."] if texts else []


def _costs(curves: Mapping[Way, Sequence[Point]]) -> list[str]:
    lines = []
    for way, curve in curves.items():
        usual = way._replace(triangle="watertight", tree="sah")
        if usual != way and usual in curves and (ratio := _ratio(curve, curves[usual])):
            what = way.name.removeprefix(usual.name + ", ")
            lines.append(f"{what.capitalize()} costs {ratio:.2g}x as much time as the usual way.")
    return lines


def _short(seconds: float) -> str:
    return f"{seconds:.2f}" if seconds >= 0.1 else f"{seconds:.2g}"
