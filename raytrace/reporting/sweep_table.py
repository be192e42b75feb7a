"""Results of a sweep, as text for a terminal and as JSON."""

import math
from collections.abc import Sequence
from typing import Any

from raytrace.image.flip import INSTALL
from raytrace.reporting.analysis import Order
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measurements import First, Point

SCHEMA = "raytrace.report/1"  # of the JSON file; the number changes when a field changes its meaning or is removed
HEADER = "", "spp", "s", "Mray/s", "MB", "RMSE", "RMSE sRGB", "rel. MSE", "MRSE", "bias", "8x8 tile", "SSIM"
HEADER_END = "efficiency", ""
LEGEND = """\
RMSE: in linear light; RMSE sRGB: of sRGB codes, 0 to 1; bias: of the worst channel; 8x8 tile: the worst, relative;
MRSE: squared error relative to (value + 0.01)^2; FLIP: mean, as shown on a screen;
efficiency: 1 / (MSE of sRGB codes x s); *: Pareto front, no other point is faster and as accurate."""


def has_flip(points: Sequence[Point]) -> bool:
    """Whether the table has a column of FLIP: all points have one."""
    return all(point.flip is not None for point in points)


def header(points: Sequence[Point]) -> list[str]:
    """Titles of the columns."""
    return [*HEADER, *(["FLIP"] if has_flip(points) else []), *HEADER_END]


def legend(points: Sequence[Point]) -> str:
    """What the columns are, and what to install for one that is missing."""
    return LEGEND if has_flip(points) else f"{LEGEND}\nFLIP: not measured, it needs flip-evaluator: {INSTALL}"


def cells(point: Point, front: bool, flips: bool) -> list[str]:
    """Cells of one row of the table, with or without FLIP."""
    bias = max(point.bias, key=abs)
    return [
        point.configuration.name,
        f"{point.spp:.4g}",
        f"{point.seconds:.3g}",
        f"{point.rays_per_second / 1e6:.1f}",
        f"{point.peak_bytes / 1e6:.1f}",
        f"{point.rmse:.2e}",
        f"{point.rmse_srgb:.2e}",
        f"{point.relative_mse:.1e}",
        f"{point.mrse:.1e}",
        f"{bias:+.1e}",
        f"{point.worst_tile:.1e}",
        f"{point.ssim:.5f}",
        *([f"{point.flip:.4f}"] if flips else []),
        f"{point.efficiency:.2e}",
        "*" if front else "",
    ]


def lay_out(rows: list[list[str]]) -> str:
    """Format rows as text, with columns aligned to the right."""
    width = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join("  ".join(text.rjust(n) for text, n in zip(row, width, strict=True)).rstrip() for row in rows)


def order_text(order: Order) -> str:
    """Format an order of convergence with its interval.

    >>> order_text(Order(Configuration("sobol", "float32"), -0.751, -0.8, -0.7, 0.1, 9))
    'error ~ spp^-0.751 (95 %: -0.800 .. -0.700)'
    """
    interval = "unknown" if math.isnan(order.low) else f"{order.low:.3f} .. {order.high:.3f}"
    return f"error ~ spp^{order.order:.3f} (95 %: {interval})"


def text(report: Any) -> str:
    """Text of a ``Report``: table, orders, what was not measured, and advice."""
    flips = has_flip(report.points)
    rows = [header(report.points)[1:]]
    rows += [cells(point, front, flips)[1:] for point, front in zip(report.points, report.front, strict=True)]
    first, *lines = lay_out(rows).splitlines()
    table = [first]
    for k, (point, line) in enumerate(zip(report.points, lines, strict=True)):
        if k == 0 or point.configuration != report.points[k - 1].configuration:
            table.append(point.configuration.name)
        table.append(line)
    orders = [[order.configuration.name, order_text(order)] for order in report.orders]
    firsts = [[first.configuration.name, f"{first.seconds:.2f} s, {first.compile_seconds:.2f} s of this is compilation"]
              for first in report.firsts]  # fmt: skip
    parts = ["\n".join(table), legend(report.points), report.reference_text]
    parts += [_list("order of convergence of the RMSE (sRGB)", orders), _list("first image", firsts)]
    parts.append(_list("not measured", [list(row) for row in report.left_out]))
    parts.append("\n".join(report.advice))
    return "\n\n".join(part for part in parts if part)


def _list(title: str, rows: list[list[str]]) -> str:
    if not rows:
        return ""
    width = max(len(name) for name, _ in rows)
    return "\n".join([title, *(f"  {name:<{width}}  {rest}" for name, rest in rows)])


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
        "left_out": [{"what": what, "why": why} for what, why in report.left_out],
        "advice": list(report.advice),
    }
    plain: dict[str, Any] = _plain(found)
    return plain


def _configuration(configuration: Configuration) -> dict[str, Any]:
    return {"name": configuration.name, **configuration._asdict()}


def _point(point: Point, front: bool) -> dict[str, Any]:
    numbers = {name: value for name, value in point._asdict().items() if name not in ("configuration", "step", "times")}
    target = point.step if point.configuration.adaptive else None
    return {
        "way": _configuration(point.configuration),
        "target_error": target,
        **numbers,
        "bias": list(point.bias),
        "seconds": point.seconds,
        "seconds_of_rounds": list(point.times),
        "rays_per_second": point.rays_per_second,
        "efficiency": point.efficiency,
        "pareto": front,
    }


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
