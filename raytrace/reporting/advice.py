"""Recommendations for a scene: always settings that were measured, and that no other measured setting beats."""

from collections.abc import Mapping, Sequence

import numpy as np

from raytrace.reporting.analysis import curves_of, nice_numbers
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.intervals import of_median
from raytrace.reporting.measurements import Point
from raytrace.reporting.precision_floor import Floor

NEGLIGIBLE = 1 / 3  # an error this much smaller than another adds 5 % to it: sqrt(1 + 1/9) = 1.05
WORSE = 1.05  # ratio of errors from which the larger error is mentioned
ERRORS = 3  # advice is given for so many errors
Curves = Mapping[Configuration, Sequence[Point]]


def recommendations(points: Sequence[Point], floor: Floor | None = None) -> list[str]:
    """Recommend settings; the first sentence is for an error in the middle of the measured range.

    Parameters
    ----------
    points : sequence of Point
        The precision of the first one is the default precision of the scene.
    floor : Floor, optional
        The bias of float32.

    Returns
    -------
    list of str
    """
    curves = curves_of(points)
    errors = nice_numbers([point.rmse_srgb for point in points if point.configuration.selectable], ERRORS)[::-1]
    best = [line for error in errors if (line := _best(points, error))]
    if len(best) > 1:
        best.insert(0, best.pop(len(best) // 2))
    precisions = _precisions(curves, points, floor)
    if best and precisions:
        best[0] = f"{best[0]}; {precisions}"
    return [f"{line}." for line in (*best, *_costs(curves))]


def recommended(points: Sequence[Point], error: float) -> Point | None:
    """Return the measured setting to recommend for an error, or None if no setting reaches it.

    Parameters
    ----------
    points : sequence of Point
    error : float
        RMSE (sRGB).

    Returns
    -------
    Point or None
        No selectable point has both a smaller or equal time and a smaller or equal error, and one of them smaller.

    Notes
    -----
    Of the selectable points whose error is below `error` with certainty (the upper end of the interval, where there is
    one), the fastest; in the precision of the first point, if that has any. If another selectable point beats it in
    time and error, that one, until none does. Nothing is interpolated between measured points.
    """
    known = [point for point in points if point.configuration.selectable]
    reach = [point for point in known if (point.error.high if point.error.known else point.rmse_srgb) <= error]
    if not reach:
        return None
    reach = [point for point in reach if point.configuration.precision == points[0].configuration.precision] or reach
    best = min(reach, key=lambda point: (point.seconds, point.rmse_srgb))
    return min((point for point in (*known, best) if beats(point, best) or point == best),
               key=lambda point: (point.seconds, point.rmse_srgb))  # fmt: skip


def beats(one: Point, other: Point) -> bool:
    """Whether a point is at least as good as another in time and error, and better in one of them."""
    a, b = (one.seconds, one.rmse_srgb), (other.seconds, other.rmse_srgb)
    return a != b and a[0] <= b[0] and a[1] <= b[1]


def _best(points: Sequence[Point], error: float) -> str:
    """Name the recommended setting for an error, and others that the measurement cannot tell from it."""
    point = recommended(points, error)
    if point is None:
        return ""
    text = f"For RMSE {error:g} on this scene: {setting(point)}, {seconds_text(point.seconds)}"
    ties = [other for other in _rivals(points, point, error) if _overlap(point, other)]
    if ties:
        text += f" ({' and '.join(setting(other) for other in ties[:2])}: the same time within the intervals)"
    return text


def setting(point: Point) -> str:
    """Name the options of a point.

    >>> way = Configuration("sobol", "float32", adaptive=True)
    >>> setting(Point(way, 0.01, 5.3, (1.0,), 1, 1, 0.1, 0.1, 0.1, (0.0, 0.0, 0.0), 0.1, 1.0))
    'sobol, target error 0.01 (5.3 spp), float32'
    """
    way = point.configuration
    count = f"target error {point.step:g} ({point.spp:.3g} spp)" if way.adaptive else f"{point.step:g} spp"
    return f"{way.sampler}, {count}, {way.precision}"


def seconds_text(seconds: float) -> str:
    """Format a time.

    >>> seconds_text(0.0512), seconds_text(2.0)
    ('0.051 s', '2.00 s')
    """
    return f"{seconds:{'.2f' if seconds >= 0.1 else '.2g'}} s"


def _rivals(points: Sequence[Point], best: Point, error: float) -> list[Point]:
    """Fastest points of other configurations that reach an error."""
    found = []
    for configuration, curve in curves_of(points).items():
        same = configuration.selectable and configuration.precision == best.configuration.precision
        if configuration != best.configuration and same:
            reach = [point for point in curve if point.rmse_srgb <= error]
            found += [min(reach, key=lambda point: point.seconds)] if reach else []
    return sorted(found, key=lambda point: point.seconds)


def _overlap(one: Point, other: Point) -> bool:
    a, b = one.time, other.time
    return a.known and b.known and a.low <= b.high and b.low <= a.high


def _cost(one: Sequence[Point], other: Sequence[Point]) -> str:
    """Compare the times of two curves: the median ratio over all pairs of renders with equal seeds; "" without any."""
    known = {point.step: point.times for point in other}
    ratios = [a / b for p in one if p.step in known for a, b in zip(p.times, known[p.step], strict=False)]
    interval = of_median(ratios)
    if interval.known and interval.low <= 1.0 <= interval.high:
        return "costs the same within the intervals"
    return f"costs {float(np.median(ratios)):.2g}x" if ratios else ""


def _precisions(curves: Curves, points: Sequence[Point], floor: Floor | None) -> str:
    """Say what float64 costs and gains, from the floor of float32 and the measured errors."""
    single, double = (curves.get(Configuration("sobol", precision)) for precision in ("float32", "float64"))
    ratio = _cost(double, single) if single and double else ""
    if not ratio:
        return ""
    cost = f"float64 {ratio}"
    errors = [p.rmse_srgb for p in points if p.configuration.precision == "float32" and p.configuration.selectable]
    if floor is None or floor.renders < 2 or not errors:
        return cost
    if floor.high <= NEGLIGIBLE * min(errors):
        return f"{cost} and gains nothing: the floor of float32 is far below all measured errors"
    if floor.rmse_srgb == 0.0:
        return f"{cost}; whether it gains anything below RMSE {floor.high / NEGLIGIBLE:.1g} takes more renders"
    return f"{cost} and gains accuracy below RMSE {floor.rmse_srgb / NEGLIGIBLE:.1g}, where the floor of float32 counts"


def _costs(curves: Curves) -> list[str]:
    names = {"median": "a median split", "none": "no tree"}
    texts = []
    for configuration, curve in curves.items():
        default = curves.get(configuration._replace(triangle="watertight", tree="sah"))
        own = configuration.renderer == "raytrace" and not configuration.selectable
        if not own or not default or not (ratio := _cost(curve, default)):
            continue
        known = {point.step: point.rmse_srgb for point in default}
        worse = max((p.rmse_srgb / known[p.step] for p in curve if known.get(p.step)), default=1.0)
        what = names.get(configuration.tree, configuration.triangle)
        texts.append(f"{what} {ratio}" + (f" and has {worse:.2g}x the error" if worse > WORSE else ""))
    return [f"Compared with the default, {', '.join(texts)}"] if texts else []
