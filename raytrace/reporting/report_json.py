"""A report as JSON, with the version of its fields."""

import math
from typing import Any

from raytrace.reporting.analysis import Order
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.equal_cost import Cost, Costs
from raytrace.reporting.intervals import Interval
from raytrace.reporting.measurements import EqualTime, First, Point
from raytrace.reporting.slopes import Slope
from raytrace.reporting.spectrum import Spectrum

SCHEMA = "raytrace.report/1"  # the number changes when a field changes its meaning or is removed; new ones may be added


def as_json(report: Any) -> dict[str, Any]:
    """All measurements of a ``Report`` as JSON values; NaN and infinity become null."""
    found: dict[str, Any] = {
        "schema": SCHEMA,
        "raytrace": report.version,
        "scene": report.about_scene,
        "machine": report.machine,
        "reference": report.about_reference,
        "budget_seconds": report.budget,
        "seconds": report.seconds,
        "complete": not report.interrupted,
        "points": [_point(point, front) for point, front in zip(report.points, report.front, strict=True)],
        "first_pictures": [_first(first) for first in report.firsts],
        "orders": [_order(order) for order in report.orders],
        "precision_gaps": [{"spp": spp, "rmse_srgb": gap} for spp, gap in sorted(report.gaps.items())],
        "slopes": [_slope(slope) for slope in report.slopes],
        "costs": _costs(report.costs),
        "float32_floor": report.floor._asdict() if report.floor else None,
        "spectra": [_spectrum(spectrum) for spectrum in report.spectra],
        "equal_time": _equal_time(report.equal_time),
        "left_out": [{"what": what, "why": why} for what, why in report.left_out],
        "advice": list(report.advice),
    }
    plain: dict[str, Any] = _plain(found)
    return plain


def _configuration(configuration: Configuration) -> dict[str, Any]:
    return {"name": configuration.name, **configuration._asdict()}


def _point(point: Point, front: bool) -> dict[str, Any]:
    aside = "configuration", "step", "times", "squares"
    numbers = {name: value for name, value in point._asdict().items() if name not in aside}
    target = point.step if point.configuration.adaptive else None
    squared = point.rmse_srgb**2 * point.fastest
    return {
        "way": _configuration(point.configuration),
        "target_error": target,
        **numbers,
        "bias": list(point.bias),
        "seconds": point.fastest,
        "seconds_of_rounds": list(point.times),
        "rays_per_second": point.rays / point.fastest,
        "efficiency": 1.0 / squared if squared else math.inf,
        "pareto": front,
        "seconds_median": {"value": point.seconds, **_interval(point.time)},
        "rmse_srgb_interval": {"value": point.rmse_srgb, **_interval(point.error)},
        "mse_srgb_of_rounds": list(point.squares),
    }


def _interval(interval: Interval) -> dict[str, float]:
    return {"low": interval.low, "high": interval.high}


def _slope(slope: Slope) -> dict[str, Any]:
    return {
        "way": _configuration(slope.configuration),
        "spp": list(slope.spp),
        "slope": slope.slope,
        **_interval(slope.interval),
        "certain": slope.certain,
    }


def _costs(costs: Costs | None) -> list[dict[str, Any]]:
    def listed(name: str, at: tuple[float, ...], found: tuple[Cost, ...]) -> list[dict[str, float]]:
        return [{name: x, "value": cost.value, **_interval(cost.interval)} for x, cost in zip(at, found, strict=True)]

    if costs is None:
        return []
    return [
        {
            "way": _configuration(row.configuration),
            "seconds_to_error": listed("rmse_srgb", costs.targets, row.times),
            "error_at_seconds": listed("seconds", costs.seconds, row.errors),
        }
        for row in costs.rows
    ]


def _spectrum(spectrum: Spectrum) -> dict[str, Any]:
    return {
        "name": spectrum.name,
        "cycles_per_pixel": spectrum.frequency.tolist(),
        "power": spectrum.power.tolist(),
        "low": {"value": spectrum.low, **_interval(spectrum.interval)},
        "verdict": spectrum.verdict,
    }


def _equal_time(found: EqualTime | None) -> dict[str, Any] | None:
    if found is None:
        return None
    numbers = "name", "spp", "seconds", "rmse_srgb"
    images = [{name: getattr(inset, name) for name in numbers} for inset in found.insets[1:]]
    return {"seconds": found.seconds, "windows": [list(window) for window in found.windows], "images": images}


def _first(first: First) -> dict[str, Any]:
    return {
        "way": _configuration(first.configuration),
        "seconds": first.seconds,
        "compile_seconds": first.compile_seconds,
    }


def _order(order: Order) -> dict[str, Any]:
    fitted = {"order": order.order, "low": order.low, "high": order.high}
    return {
        "way": _configuration(order.configuration),
        **fitted,
        "error_at_1_spp": order.at_one,
        "points": order.points,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
