"""The judgement of a renderer as text, as JSON, and as one HTML page."""

import json
from base64 import b64encode
from html import escape
from pathlib import Path
from typing import Any

import raytrace
from raytrace.conformance.judging import FAILS, MISSING, PASSES, UNJUDGED, Judgement, RegionResult, SceneResult
from raytrace.errors import RaytraceError, printable
from raytrace.image.files import load, png_bytes
from raytrace.output_folder import write

SCHEMA = "raytrace.conformance-judgement/1"
WIDTH = 128  # pixels of an image on the page
CLASSES = {PASSES: "passes", FAILS: "fails", UNJUDGED: "unjudged", MISSING: "missing"}
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; margin: 1.2em; color: #111; overflow-wrap: anywhere; }
h1 { font-size: 1.4em; margin: 0; } table { border-collapse: collapse; margin-top: 1em; }
td, th { padding: .2em .8em .2em 0; text-align: left; vertical-align: top; border-top: 1px solid #ddd; }
.fails { color: #a33a00; font-weight: bold; } .unjudged { color: #7a5c00; font-weight: bold; } .missing { color: #555; }
img { image-rendering: pixelated; outline: 1px solid #bbb; } small { color: #555; display: block; }
td table { margin: 0; } td td { border: 0; padding: 0 .8em 0 0; font-size: 14px; } .number { white-space: nowrap; }
@media (max-width: 700px) {
 body > table, body > table > tbody, body > table > tbody > tr, body > table > tbody > tr > td { display: block; }
 body > table > tbody > tr > td { border: 0; } td td { overflow-wrap: normal; }
 body > table > tbody > tr { border-top: 1px solid #ddd; padding: .4em 0; }
 body > table > tbody > tr:first-child { display: none; } .number { white-space: normal; }
}
"""


def summary(judgement: Judgement) -> str:
    """One line: how many scenes have each verdict."""
    words = {PASSES: "pass", FAILS: "fail"}
    return ", ".join(f"{judgement.count(verdict)} {words.get(verdict, verdict)}" for verdict in CLASSES)


def text(judgement: Judgement) -> str:
    """All scenes as lines of text, the failed ones with their cause."""
    lines = []
    for scene in judgement.scenes:
        worst = scene.worst
        numbers = "" if worst is None else f"{_percent(worst.error):>8} (tolerance {worst.tolerance:.2%}{_z(worst)})"
        lines.append(f"{scene.name:<26}{scene.verdict:<18}{numbers}".rstrip())
        if scene.reason:
            lines.append(f"    {scene.reason}")
    return "\n".join([*lines, summary(judgement)])


def _percent(error: float) -> str:
    """An error in percent; a factor where it is huge."""
    return f"{error:+.2%}" if abs(error) < 100 else f"x {error + 1:.3g}"


def _z(region: RegionResult) -> str:
    if region.z is None:
        return ""
    return f", z {region.z:+.1f}" if abs(region.z) < 1e4 else f", z {region.z:+.1g}"


def json_text(judgement: Judgement) -> str:
    """Return the judgement as JSON."""
    scenes: list[dict[str, Any]] = [
        {**scene._asdict(), "regions": [region._asdict() for region in scene.regions]} for scene in judgement.scenes
    ]
    content = {"schema": SCHEMA, "raytrace": raytrace.__version__, "ok": judgement.ok, "scenes": scenes}
    return json.dumps(content, indent=1) + "\n"


def page(judgement: Judgement, images: Path) -> str:
    """Return one self-contained HTML page."""
    title = "Conformance"
    rows = "".join(_row(scene, images) for scene in _ordered(judgement))
    heads = "".join(f"<th>{head}</th>" for head in ("scene", "image", "verdict", "expected, measured, error"))
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{STYLE}</style>"
        f"<h1>{title}</h1><p>{escape(summary(judgement))}</p><table><tr>{heads}</tr>{rows}</table>"
        f"<p><small>raytrace {escape(raytrace.__version__)}. Error and tolerance are relative; z is the error beyond "
        "the accuracy of the answer (0.03 %), in standard errors, where variances or "
        "several seeds are known.</small></p></html>\n"
    )


def _ordered(judgement: Judgement) -> list[SceneResult]:
    """Failures first."""
    order = [FAILS, UNJUDGED, PASSES, MISSING]
    return sorted(judgement.scenes, key=lambda scene: order.index(scene.verdict))


def _row(scene: SceneResult, images: Path) -> str:
    reason = f"<br>{escape(scene.reason)}" if scene.reason else ""
    lines = "".join(_region(region) for region in scene.regions)
    return (
        f"<tr><td>{escape(scene.name)}<small>{escape(scene.about)}</small></td><td>{_image(scene, images)}</td>"
        f'<td><span class="{CLASSES[scene.verdict]}">{scene.verdict}</span>{reason}</td>'
        f"<td><table>{lines}</table></td></tr>"
    )


def _region(region: RegionResult) -> str:
    cells = [escape(region.name), _colour(region.expected), _colour(region.measured)]
    cells.append(f"{_percent(region.error)} of {region.tolerance:.2%}{_z(region)}")
    marked = CLASSES[region.verdict]
    return "".join(
        [
            "<tr>",
            *(f'<td class="number {marked if k == 3 else ""}">{cell}</td>' for k, cell in enumerate(cells)),
            "</tr>",
        ]
    )


def _colour(values: tuple[float, ...]) -> str:
    shown = values if len({f"{value:.4g}" for value in values}) > 1 else values[:1]
    return " ".join(f"{value:.4g}" for value in shown)


def _image(scene: SceneResult, images: Path) -> str:
    """The first image of a scene, as a data URL."""
    if not scene.images:
        return ""
    try:
        data = b64encode(png_bytes(load(images / scene.images[0]).rgb)).decode()
    except RaytraceError:
        return ""
    name = escape(printable(scene.images[0]))
    return f'<img width="{WIDTH}" src="data:image/png;base64,{data}" alt="{name}"><small>{name}</small>'


def write_judgement(judgement: Judgement, images: Path, folder: Path) -> tuple[Path, ...]:
    """Write ``conformance.html`` and ``conformance.json`` into a folder; return their paths."""
    files = {"conformance.html": page(judgement, images), "conformance.json": json_text(judgement)}
    return write(folder, {name: content.encode() for name, content in files.items()})
