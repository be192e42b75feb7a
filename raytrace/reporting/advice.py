"""Recommendations for a scene, computed from the measurements of a report."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from raytrace.limits import MAX_SPP
from raytrace.reporting.analysis import Order, curves_of, needed
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measurements import Point

NEGLIGIBLE = 1 / 3  # an error this much smaller than another adds 5 % to it: sqrt(1 + 1/9) = 1.05
WORSE = 1.05  # ratio of errors from which the larger error is mentioned
WIDE = 0.5  # width of a confidence interval of an order from which the interval is printed
NICE = 1, 2, 5  # advice is given for these errors times powers of ten
Curves = Mapping[Configuration, Sequence[Point]]


def recommendations(points: Sequence[Point], orders: Sequence[Order], gaps: Mapping[int, float]) -> list[str]:
    """Recommend settings; the first sentence is for an error in the middle of the measured range.

    Parameters
    ----------
    points : sequence of Point
        The precision of the first one is the default precision of the scene.
    orders : sequence of Order
    gaps : mapping of int to float
        RMSE (sRGB) between the two precisions, by samples per pixel.

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
    """Round numbers within the range of measured errors: a large, a middle and a small one."""
    errors = [point.rmse_srgb for point in points if point.rmse_srgb > 0.0]
    if not errors:
        return []
    low, high = min(errors), max(errors)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    inside = [error for k in decades for n in NICE if low <= (error := float(f"{n:g}e{k}")) <= high]
    return sorted({inside[0], inside[len(inside) // 2], inside[-1]}, reverse=True) if inside else [high]


def _best(curves: Curves, error: float) -> str:
    """Name the fastest selectable configuration for an error; in the default precision if that reaches the error."""
    found = {
        configuration: need
        for configuration, curve in curves.items()
        if configuration.selectable and (need := needed(curve, error))
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
    """Median ratio of the times of two curves, over all repetitions of the steps that both have."""
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
    limit = useless_below(fit, float(np.median(list(gaps.values()))))  # not the mean: one ray can change one gap
    if limit > MAX_SPP:
        return f"{cost} and gains nothing"
    if limit < 1:
        return f"{cost} and is needed: the error of float32 is larger than the noise"
    return f"{cost} and gains nothing below {two_digits(limit)} spp"


def useless_below(fit: Order, gap: float) -> float:
    """Samples per pixel up to which the difference of the precisions is negligible against the sampling error.

    The difference is the median over all numbers of samples. It is assumed not to shrink with more samples.
    """
    if fit.order >= 0 or gap == 0:
        return math.inf
    return float((gap / NEGLIGIBLE / fit.at_one) ** (1 / fit.order))


def two_digits(number: float) -> str:
    """Format a large number with two significant digits.

    >>> two_digits(4123.0), two_digits(37.4)
    ('4,100', '37')
    """
    return f"{round(number, 1 - math.floor(math.log10(number))):,.0f}"


def _samplers(orders: Sequence[Order]) -> list[str]:
    default = [fit for fit in orders if fit.configuration.precision == orders[0].configuration.precision]
    texts = [f"{fit.configuration.sampler} as spp^{fit.order:.2f}{_uncertainty(fit)}" for fit in default]
    return [f"The error shrinks: {', '.join(texts)}"] if texts else []


def _uncertainty(fit: Order) -> str:
    """The confidence interval of an order, if it is wide."""
    if fit.high - fit.low <= WIDE:
        return ""
    return f" (95 % interval {fit.low:.2f} to {fit.high:.2f}, from {fit.points} points)"


def _costs(curves: Curves) -> list[str]:
    names = {"median": "a median split", "none": "no tree"}
    texts = []
    for configuration, curve in curves.items():
        default = curves.get(configuration._replace(triangle="watertight", tree="sah"))
        if configuration.selectable or not default or (ratio := _ratio(curve, default)) is None:
            continue
        known = {point.step: point.rmse_srgb for point in default}
        worse = max((p.rmse_srgb / known[p.step] for p in curve if known.get(p.step)), default=1.0)
        what = names.get(configuration.tree, configuration.triangle)
        texts.append(f"{what} costs {ratio:.2g}x" + (f" and has {worse:.2g}x the error" if worse > WORSE else ""))
    return [f"Compared with the default, {', '.join(texts)}"] if texts else []
