"""Sentences about what to use on a scene, computed from what was measured."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from raytrace.limits import MAX_SPP
from raytrace.reporting.analysis import Order, curves_of, needed
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measure import Point

NEGLIGIBLE = 1 / 3  # an error this much smaller than another adds 5 % to it: sqrt(1 + 1/9) = 1.05
WORSE = 1.05  # times the error of the usual configuration: said aloud from here on
WIDE = 0.5  # of a confidence interval of an order: wider ones are written out
NICE = 1, 2, 5  # errors that advice is given for, times powers of ten
Curves = Mapping[Configuration, Sequence[Point]]


def advice(points: Sequence[Point], orders: Sequence[Order], gaps: Mapping[int, float]) -> list[str]:
    """Say what to use; the first sentence is the answer for an error in the middle of what was measured.

    Parameters
    ----------
    points : sequence of Point
        The first one's precision is what the scene is drawn in by default.
    orders : sequence of Order
    gaps : mapping of int to float
        Samples per pixel to the RMSE on a screen between both precisions.

    Returns
    -------
    list of str
    """
    curves = curves_of(points)
    best = [line for error in nice_errors(points) if (line := _best(curves, error))]
    if len(best) > 1:
        best.insert(0, best.pop(len(best) // 2))
    precisions = _precisions(curves, orders, gaps)
    if best and precisions:
        best[0] = f"{best[0]}; {precisions}"
    return [f"{line}." for line in (*best, *_samplers(orders), *_costs(curves))]


def nice_errors(points: Sequence[Point]) -> list[float]:
    """Round numbers within the errors of the points: the large, the middle and the small one."""
    errors = [point.rmse_srgb for point in points if point.rmse_srgb > 0.0]
    if not errors:
        return []
    low, high = min(errors), max(errors)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    inside = [error for k in decades for n in NICE if low <= (error := float(f"{n:g}e{k}")) <= high]
    return sorted({inside[0], inside[len(inside) // 2], inside[-1]}, reverse=True) if inside else [high]


def _best(curves: Curves, error: float) -> str:
    """Name the quickest configuration that a user can choose; in the default precision, where that gets there."""
    found = {
        configuration: need
        for configuration, curve in curves.items()
        if configuration.usual and (need := needed(curve, error))
    }
    default = next(iter(curves)).precision
    found = {
        configuration: need for configuration, need in found.items() if configuration.precision == default
    } or found
    if not found:
        return ""
    configuration = min(found, key=lambda configuration: found[configuration][1])
    spp, seconds = found[configuration]
    sampler = f"{configuration.sampler}, adaptive" if configuration.adaptive else configuration.sampler
    used = f"{math.ceil(spp - 1e-9)} spp, {configuration.precision}"  # 64.0000000001 is 64
    return f"For RMSE {error:g} on this scene: {sampler}, {used}, {seconds:{'.2f' if seconds >= 0.1 else '.2g'}} s"


def _ratio(one: Sequence[Point], other: Sequence[Point]) -> float | None:
    """Median of time / time of the other, over all rounds of the steps that both have."""
    known = {point.step: point.times for point in other}
    ratios = [a / b for p in one if p.step in known for a, b in zip(p.times, known[p.step], strict=False)]
    return float(np.median(ratios)) if ratios else None


def _precisions(curves: Curves, orders: Sequence[Order], gaps: Mapping[int, float]) -> str:
    single, double = (curves.get(Configuration("sobol", precision)) for precision in ("float32", "float64"))
    ratio = _ratio(double, single) if single and double else None
    if ratio is None:
        return ""
    cost = f"float64 costs {ratio:.2g}x"
    fits = {fit.configuration: fit for fit in orders}
    fit = fits.get(Configuration("sobol", "float64")) or fits.get(Configuration("sobol", "float32"))
    if not gaps or not fit:
        return cost
    limit = useless_below(fit, float(np.median(list(gaps.values()))))  # one ray that just misses moves one of them
    if limit > MAX_SPP:
        return f"{cost} and gains nothing"
    if limit < 1:
        return f"{cost} and is needed: float32 is off by more than the noise"
    return f"{cost} and gains nothing below {two_digits(limit)} spp"


def useless_below(fit: Order, gap: float) -> float:
    """Samples per pixel up to which a difference of precisions is lost in the error of sampling.

    The difference is the median over all numbers of samples; it is assumed not to shrink with more of them.
    """
    if fit.order >= 0 or gap == 0:
        return math.inf
    return float((gap / NEGLIGIBLE / fit.at_one) ** (1 / fit.order))


def two_digits(number: float) -> str:
    """Write a large number with two digits that count.

    >>> two_digits(4123.0), two_digits(37.4)
    ('4,100', '37')
    """
    return f"{round(number, 1 - math.floor(math.log10(number))):,.0f}"


def _samplers(orders: Sequence[Order]) -> list[str]:
    default = [fit for fit in orders if fit.configuration.precision == orders[0].configuration.precision]
    texts = [f"{fit.configuration.sampler} as spp^{fit.order:.2f}{_uncertainty(fit)}" for fit in default]
    return [f"The error shrinks: {', '.join(texts)}"] if texts else []


def _uncertainty(fit: Order) -> str:
    """The interval of an order, where it is too wide to leave out."""
    if fit.high - fit.low <= WIDE:
        return ""
    return f" (95 % interval {fit.low:.2f} to {fit.high:.2f}, from {fit.points} points)"


def _costs(curves: Curves) -> list[str]:
    names = {"median": "a median split", "none": "no tree"}
    texts = []
    for configuration, curve in curves.items():
        usual = curves.get(configuration._replace(triangle="watertight", tree="sah"))
        if configuration.usual or not usual or (ratio := _ratio(curve, usual)) is None:
            continue
        known = {point.step: point.rmse_srgb for point in usual}
        worse = max((p.rmse_srgb / known[p.step] for p in curve if known.get(p.step)), default=1.0)
        what = names.get(configuration.tree, configuration.triangle)
        texts.append(f"{what} costs {ratio:.2g}x" + (f" and errs {worse:.2g}x as much" if worse > WORSE else ""))
    return [f"Beside the usual configuration, {', '.join(texts)}"] if texts else []
