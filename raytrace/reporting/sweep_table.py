"""Results of a sweep as tables, and as text for a terminal."""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from raytrace.image.flip import INSTALL
from raytrace.reporting.equal_cost import Costs, cost_text
from raytrace.reporting.intervals import Interval, log_half_width
from raytrace.reporting.measurements import Point
from raytrace.reporting.slopes import Slope, steep_text
from raytrace.reporting.spectrum import Spectrum

HEADER = "", "spp", "s", "± %", "Mray/s", "MB", "RMSE", "RMSE sRGB", "± %", "rel.MSE", "MRSE", "bias", "tile", "SSIM"
HEADER_END = "effic.", ""
LEGEND = """\
s: median; ± %: half of the 95 % interval of the number before it; RMSE: in linear light; RMSE sRGB: of sRGB codes,
0 to 1; bias: of the worst channel; tile: the worst of 8x8 pixels, relative; MRSE: squared error relative to
(value + 0.01)^2; FLIP: mean, as shown on a screen; effic.: 1 / (MSE of sRGB codes x s); *: Pareto front, no other is
faster and as accurate."""
COSTS_LEGEND = (
    "Interpolated between neighbouring points on logarithmic axes; ±: half of the 95 % interval; "
    "-: not within the measured range."
)


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
        percent(point.time),
        f"{point.rays / point.seconds / 1e6:.1f}" if point.rays else "-",
        f"{point.peak_bytes / 1e6:.1f}" if point.peak_bytes else "-",
        f"{point.rmse:.2e}",
        f"{point.rmse_srgb:.2e}",
        percent(point.error),
        f"{point.relative_mse:.1e}",
        f"{point.mrse:.1e}",
        f"{bias:+.1e}",
        f"{point.worst_tile:.1e}",
        f"{point.ssim:.4f}",
        *([f"{point.flip:.4f}"] if flips else []),
        f"{point.efficiency:.1e}",
        "*" if front else "",
    ]


def lay_out(rows: list[list[str]]) -> str:
    """Format rows as text, with columns aligned to the right."""
    width = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join("  ".join(text.rjust(n) for text, n in zip(row, width, strict=True)).rstrip() for row in rows)


def seconds_label(seconds: float) -> str:
    """Format a time with its unit.

    >>> seconds_label(0.05), seconds_label(2.5)
    ('50 ms', '2.5 s')
    """
    return f"{1000 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"


def percent(interval: Interval) -> str:
    """Format half of the width of an interval as a percentage.

    >>> percent(Interval(0.9, 1.1)), percent(Interval(0.1, 10.0)), percent(Interval(math.nan, math.nan))
    ('11', '>100', '-')
    """
    half = log_half_width(interval)
    if math.isnan(half):
        return "-"
    share = 100 * math.expm1(half)
    if share > 100:
        return ">100"
    return f"{share:.0f}" if share >= 9.5 else f"{share:.1g}"


def cost_rows(costs: Costs) -> list[list[str]]:
    """Rows of the table of time to reach an error and of error at equal time, the header first."""
    header = [f"time to RMSE {error:g}" for error in costs.targets] + [f"RMSE at {time:g} s" for time in costs.seconds]
    rows = [["", *header]]
    for row in costs.rows:
        times = [cost_text(cost, ".3g").replace(" ±", " s ±") for cost in row.times]
        rows.append([row.configuration.name, *times, *(cost_text(cost, ".2e") for cost in row.errors)])
    return rows


def slope_rows(slopes: Sequence[Slope]) -> list[list[str]]:
    """Rows of the table of local slopes, the header first: one column for each pair of sample counts."""
    pairs = sorted({slope.spp for slope in slopes})
    rows = [["", *(f"{a:g} to {b:g} spp" for a, b in pairs)]]
    for configuration, group in groupby(slopes, lambda slope: slope.configuration):
        found = {slope.spp: steep_text(slope) for slope in group}
        rows.append([configuration.name, *(found.get(pair, "-") for pair in pairs)])
    return rows


def spectrum_rows(spectra: Sequence[Spectrum]) -> list[list[str]]:
    """Rows of the table of noise: name, and the relative power of low frequencies with its interval."""
    return [
        [each.name, f"{each.low:.2f} ({each.interval.low:.2f} .. {each.interval.high:.2f}): {each.verdict}"]
        for each in spectra
    ]


def text(report: Any) -> str:
    """Text of a ``Report``: tables, what was not measured, and advice."""
    flips = has_flip(report.points)
    rows = [header(report.points)[1:]]
    rows += [cells(point, front, flips)[1:] for point, front in zip(report.points, report.front, strict=True)]
    first, *lines = lay_out(rows).splitlines()
    table = [first]
    for k, (point, line) in enumerate(zip(report.points, lines, strict=True)):
        if k == 0 or point.configuration != report.points[k - 1].configuration:
            table.append(point.configuration.name)
        table.append(line)
    firsts = [[first.configuration.name, f"{first.seconds:.2f} s, {first.compile_seconds:.2f} s of this is compilation"]
              for first in report.firsts]  # fmt: skip
    parts = ["\n".join(table), legend(report.points)]
    if report.costs and report.costs.rows:
        parts.append(f"{lay_out(cost_rows(report.costs))}\n{COSTS_LEGEND}")
    if report.slopes:
        title = "local slopes: error ~ spp^slope between neighbouring counts (±: half of the 95 % interval)"
        columns = [list(row) for row in zip(*slope_rows(report.slopes), strict=True)]
        parts.append(f"{title}\n{lay_out(columns)}")
    parts.append(
        _list("noise at low frequencies, relative to white noise (95 % interval)", spectrum_rows(report.spectra))
    )
    parts += [report.reference_text, report.floor.text if report.floor else "", _list("first image", firsts)]
    parts.append(_list("not measured", [list(row) for row in report.left_out]))
    parts.append("\n".join(report.advice))
    return "\n\n".join(part for part in parts if part)


def _list(title: str, rows: list[list[str]]) -> str:
    if not rows:
        return ""
    width = max(len(name) for name, _ in rows)
    return "\n".join([title, *(f"  {name:<{width}}  {rest}" for name, rest in rows)])
