"""Reports on several scenes, and one page over all of them."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from raytrace.errors import RaytraceError, printable
from raytrace.output_folder import check_folder, write
from raytrace.reporting.advice import recommended, seconds_text, setting
from raytrace.reporting.analysis import curves_of, nice_numbers
from raytrace.reporting.equal_cost import cost_text, time_to
from raytrace.reporting.page import head
from raytrace.reporting.page_images import png
from raytrace.reporting.sweep import Report

INDEX = "index.html"
TITLE = "Speed against error: all scenes"
INTERRUPTED = 130


class Entry(NamedTuple):
    """One scene of the overview."""

    name: str  # of its folder
    report: Report | None  # None: it failed
    message: str = ""  # why it failed
    exit_code: int = 0


def report_all(
    scenes: Sequence[Path], folder: Path, one: Callable[[Path, Path], Report], say: Callable[[str], None]
) -> tuple[list[Entry], Path]:
    """Report on several scenes, each in a folder of its own, and write one page with links to all.

    Parameters
    ----------
    scenes : sequence of Path
    folder : Path
        Created if missing. A scene's folder in it has the name of its file.
    one : callable
        Reports on a scene in a folder; may raise RaytraceError, which loses no other scene, or KeyboardInterrupt, which
        ends the series.
    say : callable
        Called with a line for each scene that is done or failed.

    Returns
    -------
    entries : list of Entry
    page : Path
    """
    check_folder(folder)
    entries: list[Entry] = []
    for path, name in zip(scenes, folder_names(scenes), strict=True):
        try:
            entries.append(Entry(name, one(path, folder / name)))
        except RaytraceError as error:
            entries.append(Entry(name, None, str(error), error.exit_code))
        except MemoryError:
            entries.append(Entry(name, None, "memory: not enough; use a smaller size", 2))
        except KeyboardInterrupt:
            entries.append(Entry(name, None, "interrupted", INTERRUPTED))
        entry = entries[-1]
        say(f"{entry.name}: {entry.report.files[-1] if entry.report else entry.message}")
        write(folder, {INDEX: overview_page(entries).encode()})  # after each: what is done is not lost
        if entry.exit_code == INTERRUPTED or (entry.report and entry.report.interrupted):
            break
    return entries, folder / INDEX


def exit_code(entries: Sequence[Entry]) -> int:
    """Exit code of a series: 130 if it was interrupted, else that of the first scene that failed, else 0."""
    codes = [INTERRUPTED if each.report and each.report.interrupted else each.exit_code for each in entries]
    return INTERRUPTED if INTERRUPTED in codes else next((code for code in codes if code), 0)


def folder_names(scenes: Sequence[Path]) -> list[str]:
    """Return a name for each scene: that of its file, with a number where it is taken.

    >>> folder_names([Path("a/box.json"), Path("b/box.json"), Path("ball.obj")])
    ['box', 'box-2', 'ball']
    """
    names: list[str] = []
    for path in scenes:
        number, name = 1, path.stem
        while name in names:
            number += 1
            name = f"{path.stem}-{number}"
        names.append(name)
    return names


def overview_page(entries: Sequence[Entry]) -> str:
    """HTML page with a row for each scene."""
    titles = "", "scene", "triangles", "recommended", "time to this error", "sobol", "stratified", "independent"
    rows = ["<tr>" + "".join(f"<th>{title}</th>" for title in titles) + "</tr>", *map(_row, entries)]
    return "\n".join([
        *head(TITLE),
        f"<h1>{TITLE}</h1>",
        "<p>Each scene links to its own page. The last three columns are times to the same error, in the default "
        "precision of the scene, interpolated between measured numbers of samples, with half of the 95 % interval.</p>",
        f'<div class="wide"><table class="costs">{"".join(rows)}</table></div>',
        "</body></html>",
    ]) + "\n"  # fmt: skip


def _row(entry: Entry) -> str:
    name = escape(printable(entry.name))
    if entry.report is None:
        why = escape(printable(entry.message.splitlines()[0] if entry.message else "failed"))
        left = 'style="text-align: left"'
        return f'<tr><td></td><td {left}>{name}</td><td colspan="6" {left}>failed: {why}</td></tr>'
    report: Any = entry.report
    link = f"{quote(entry.name)}/report.html"
    image = f'<a href="{link}"><img alt="{name}" src="{png(report.shown[0].rgb8)}"></a>'
    texts = [f"{report.about_scene['triangles']:,}", *_numbers(report)]
    cells = "".join(f"<td>{escape(text)}</td>" for text in texts)
    return f'<tr><td>{image}</td><td style="text-align: left"><a href="{link}">{name}</a></td>{cells}</tr>'


def _numbers(report: Report) -> list[str]:
    """Return the setting that the report recommends first, its error and time, and the times of all samplers."""
    errors = nice_numbers([point.rmse_srgb for point in report.points if point.configuration.selectable], 3)[::-1]
    error = errors[len(errors) // 2] if errors else 0.0
    best = recommended(report.points, error)
    texts = [setting(best), f"RMSE {error:g}: {seconds_text(best.seconds)}"] if best else ["-", "-"]
    curves = curves_of(report.points)
    first = report.points[0].configuration
    for sampler in ("sobol", "stratified", "independent"):
        curve = curves.get(first._replace(sampler=sampler, adaptive=False))
        texts.append(cost_text(time_to(curve, error), ".3g").replace(" ±", " s ±") if curve and error else "-")
    return texts
