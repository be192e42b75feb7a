"""One self-contained HTML page about a sweep: it needs no network and no other files."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from raytrace.reporting.page_images import equal_time_section, slider, uri
from raytrace.reporting.page_style import SCRIPT, STYLE
from raytrace.reporting.plots import DARK
from raytrace.reporting.sweep_table import (
    COSTS_LEGEND,
    cells,
    cost_rows,
    has_flip,
    header,
    legend,
    slope_rows,
    spectrum_rows,
)

SPECTRUM = "error-spectrum"  # the plot that has its own section


def report_page(report: Any, plots: Mapping[str, bytes]) -> str:
    """HTML page of a ``Report``; `plots` has the plots by name."""
    about = report.about_scene
    title = f"{about['name']}: speed against error"
    lines = [
        *head(title),
        f"<h1>{escape(title)}</h1>",
        f"<p>{escape(about['about'])} {about['triangles']:,} triangles, "
        f"{about['size'][0]} x {about['size'][1]} pixels, {report.machine['threads']} threads.</p>",
        *(f'<p class="advice">{escape(line)}</p>' for line in report.advice[:1]),
        *(f"<p>{escape(line)}</p>" for line in report.advice[1:]),
        _costs(report),
        f'<div class="plots">{"".join(_plot(plots, name) for name in _names(plots) if name != SPECTRUM)}</div>',
        equal_time_section(report.equal_time),
        _slopes(report),
        _spectra(report, plots),
        slider(report),
        _table(report),
        _notes(report),
        f"</body><script>{SCRIPT}</script></html>",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def head(title: str) -> list[str]:
    """First lines of a page."""
    return [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head><body>',
    ]


def html_table(rows: Sequence[Sequence[str]], kind: str = "costs") -> str:
    """Return rows of text, the header first, as a table that scrolls where it is too wide."""
    first = "<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in rows[0]) + "</tr>"
    rest = ("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows[1:])
    return f'<div class="wide"><table class="{kind}">{first}{"".join(rest)}</table></div>'


def _names(plots: Mapping[str, bytes]) -> list[str]:
    return [name[:-4] for name in plots if name.endswith(".svg") and not name.endswith(DARK)]


def _plot(plots: Mapping[str, bytes], name: str) -> str:
    """Return a plot, in light or dark colours as the reader's system asks."""
    dark = plots.get(name + DARK)
    source = f'<source media="(prefers-color-scheme: dark)" srcset="{uri(dark, "svg+xml")}">' if dark else ""
    about = name.replace("-", " ")
    return f'<picture>{source}<img alt="{about}" src="{uri(plots[f"{name}.svg"], "svg+xml")}"></picture>'


def _costs(report: Any) -> str:
    if not report.costs or not report.costs.rows:
        return ""
    below = f'<p class="quiet">{escape(COSTS_LEGEND)}</p>'
    return f"<h2>Equal error, equal time</h2>{html_table(cost_rows(report.costs))}{below}"


def _slopes(report: Any) -> str:
    if not report.slopes:
        return ""
    return f"""<h2>How fast errors fall: local slopes</h2>
<p>Slope of log error against log samples, between neighbouring counts; ±: half of its 95 % interval. Independent
samples have -0.50. "Uncertain": the interval is too wide to tell anything.</p>
{html_table(slope_rows(report.slopes))}"""


def _spectra(report: Any, plots: Mapping[str, bytes]) -> str:
    if not report.spectra:
        return ""
    plot = _plot(plots, SPECTRUM) if f"{SPECTRUM}.svg" in plots else ""
    rows = [["noise of", "power of low frequencies"], *spectrum_rows(report.spectra)]
    return f"""<h2>Is the noise blue?</h2>
<p>Power spectrum of the noise, averaged over directions. White noise is 1 everywhere. Blue noise has little power
at low frequencies, left: it is fine-grained, and the eye or a filter averages it away.</p>
<div class="plots">{plot}<div>{html_table(rows)}<p class="quiet">Low: below 1/8 cycle per pixel, in patches of more than
8 pixels. Relative to white noise, with the 95 % interval from the scatter between pairs of renders.</p></div></div>"""


def _table(report: Any) -> str:
    rows = ["<tr>" + "".join(f"<th>{escape(name)}</th>" for name in header(report.points)) + "</tr>"]
    for point, front in zip(report.points, report.front, strict=True):
        row = "".join(f"<td>{escape(cell)}</td>" for cell in cells(point, front, has_flip(report.points)))
        rows.append(f'<tr class="front">{row}</tr>' if front else f"<tr>{row}</tr>")
    below = escape(legend(report.points))
    table = f'<div class="wide"><table class="all">{"".join(rows)}</table></div>'
    return f'<h2>All numbers</h2>{table}<p class="quiet">{below}</p>'


def _notes(report: Any) -> str:
    def items(rows: list[str]) -> str:
        return "<ul>" + "".join(f"<li>{escape(row)}</li>" for row in rows) + "</ul>"

    parts = [f"<h2>How it was measured</h2><p>{escape(report.reference_text)}</p>"]
    if report.floor:
        parts.append(f"<p>{escape(report.floor.text)}</p>")
    parts.append("<p>First images, with compilation or loading of kernels:</p>")
    parts.append(items([f"{first.configuration.name}: {first.seconds:.2f} s" for first in report.firsts]))
    if report.left_out:
        parts.append("<p>Not measured:</p>" + items([f"{what}: {why}" for what, why in report.left_out]))
    machine = ", ".join(f"{name} {value}" for name, value in report.machine.items())
    parts.append(
        f'<p class="quiet">raytrace {report.version}; {escape(machine)}; scene {report.about_scene["sha256"][:16]}</p>'
    )
    return "\n".join(parts)
