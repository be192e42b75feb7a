"""What each configuration needs for an error, and what error it reaches in a time."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

from raytrace.reporting.analysis import curves_of, nice_numbers
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.intervals import UNKNOWN, Interval, log_half_width
from raytrace.reporting.measurements import Point

COLUMNS = 3  # errors, and times, of the table


class Cost(NamedTuple):
    """Time to an error, or error at a time, of one configuration."""

    value: float  # NaN: out of the measured range
    interval: Interval
    bound: str = ""  # of `value` that is NaN: "<" all measured points are better, ">" all are worse


class Row(NamedTuple):
    """Costs of one configuration."""

    configuration: Configuration
    times: tuple[Cost, ...]  # s: to reach each error
    errors: tuple[Cost, ...]  # RMSE (sRGB): at each time


class Costs(NamedTuple):
    """The table of costs: all configurations at equal errors and at equal times."""

    targets: tuple[float, ...]  # RMSE (sRGB), decreasing
    seconds: tuple[float, ...]  # increasing
    rows: tuple[Row, ...]


def costs_of(points: Sequence[Point]) -> Costs:
    """Return the costs of all configurations, at round errors and times within the range of the first one."""
    curves = curves_of(points)
    first = [point for point in next(iter(curves.values()), []) if point.rmse_srgb > 0.0]
    targets = nice_numbers([point.rmse_srgb for point in first], COLUMNS)[::-1]
    seconds = nice_numbers([point.seconds for point in first], COLUMNS)
    rows = [
        Row(configuration,
            tuple(time_to(curve, error) for error in targets),
            tuple(error_at(curve, time) for time in seconds))
        for configuration, curve in curves.items()
    ]  # fmt: skip
    return Costs(tuple(targets), tuple(seconds), tuple(rows))


def time_to(curve: Sequence[Point], error: float) -> Cost:
    """Seconds until a configuration reaches an error; see `_across`."""
    return _across(curve, error, lambda p: (p.rmse_srgb, p.error), lambda p: (p.seconds, p.time))


def error_at(curve: Sequence[Point], seconds: float) -> Cost:
    """Error that a configuration has after a time; see `_across`."""
    return _across(curve[::-1], seconds, lambda p: (p.seconds, p.time), lambda p: (p.rmse_srgb, p.error))


Axis = Callable[[Point], tuple[float, Interval]]


def _across(curve: Sequence[Point], at: float, x: Axis, y: Axis) -> Cost:
    """Interpolate y where x falls to `at`, between two neighbouring points, on logarithmic axes.

    Notes
    -----
    ``log y = (1 - s) log y_p + s log y_q`` with ``s = log(x_p / at) / log(x_p / x_q)``. Its derivatives with respect to
    log y_p and log y_q are 1 - s and s; with respect to log x_p and log x_q they are ``(1 - s) g`` and ``s g`` with
    ``g = log(y_q / y_p) / log(x_p / x_q)``. With half-widths h of the four logarithms, the interval has the half-width
    ``sqrt(((1 - s) h(y_p) + s h(y_q))^2 + g^2 ((1 - s) h(x_p) + s h(x_q))^2)``: neighbouring points may be correlated,
    so their half-widths add up; times and errors are independent. The curve between the points is taken as straight.
    """
    known = [point for point in curve if x(point)[0] > 0.0 and y(point)[0] > 0.0]
    if not known:
        return Cost(math.nan, UNKNOWN)
    if x(known[0])[0] < at:
        return Cost(math.nan, UNKNOWN, "<" if len(known) == len(curve) else "")
    for p, q in pairwise([*known, known[-1]]):
        (xp, hxp), (xq, hxq), (yp, hyp), (yq, hyq) = x(p), x(q), y(p), y(q)
        if xq <= at <= xp:
            span = math.log(xp / xq)
            s = math.log(xp / at) / span if span else 0.0
            g = math.log(yq / yp) / span if span else 0.0
            across = (1 - s) * log_half_width(hxp) + s * log_half_width(hxq)
            along = (1 - s) * log_half_width(hyp) + s * log_half_width(hyq)
            value = yp ** (1 - s) * yq**s
            half = math.hypot(along, g * across)
            return Cost(float(value), Interval(value * math.exp(-half), value * math.exp(half)))
    return Cost(math.nan, UNKNOWN, ">")


def cost_text(cost: Cost, form: str) -> str:
    """Format a cost with its interval as a percentage.

    >>> cost_text(Cost(0.5, Interval(0.45, 0.5556)), ".3g"), cost_text(Cost(float("nan"), UNKNOWN), ".3g")
    ('0.5 ±11 %', '-')
    >>> cost_text(Cost(0.5, Interval(0.01, 25.0)), ".3g")
    '0.5 ±>100 %'
    """
    if math.isnan(cost.value):
        return "-"
    half = log_half_width(cost.interval)
    if math.isnan(half):
        return f"{cost.value:{form}}"
    share = 100 * math.expm1(half)
    return f"{cost.value:{form}} ±" + (f"{share:.0f} %" if share <= 100 else ">100 %")


def spp_at(curve: Sequence[Point], seconds: float) -> float:
    """Samples per pixel that a configuration has time for; NaN: out of the measured range."""
    return _across(curve[::-1], seconds, lambda p: (p.seconds, UNKNOWN), lambda p: (p.spp, UNKNOWN)).value
