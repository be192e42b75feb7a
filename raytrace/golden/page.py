"""HTML page of a failed check: expected and actual image, difference and SSIM map, in one file."""

import io
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.golden.causes import likely_causes
from raytrace.golden.gates import Verdict
from raytrace.golden.locations import GoldenLocation
from raytrace.golden.noise import in_deviations, noise_of
from raytrace.golden.spots import Spot, find, largest_channel
from raytrace.golden.store import GoldenImage
from raytrace.image import flip
from raytrace.image.files import LUMINANCE, srgb8
from raytrace.image.metrics import TILE, Comparison, difference_scale, ssim_map

WIDTH = 320  # small images are enlarged to about this width, by an integer factor
ENLARGED = 220  # the same for enlarged regions
DARKER, BRIGHTER, NOT_FINITE = (0, 114, 178), (213, 94, 0), (255, 0, 255)  # blue, vermilion, magenta
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; margin: 1.2em; color: #111; overflow-wrap: anywhere; }
h1 { font-size: 1.4em; margin: 0; } h2 { font-size: 1em; margin: 1.2em 0 .2em; }
.why { background: #fdeee6; border-left: .3em solid #d55e00; padding: .5em .8em; }
.cause { background: #e8f2fa; border-left: .3em solid #0072b2; padding: .5em .8em; }
.row { display: flex; flex-wrap: wrap; gap: 1em; max-width: 100%; } figure { margin: 0; max-width: 100%; }
small { color: #555; display: block; font-weight: normal; }
figcaption { min-height: 2.9em; } .frame { position: relative; }
img { image-rendering: pixelated; display: block; outline: 1px solid #bbb; width: 100%; }
.mark { position: absolute; outline: 2px solid #111; box-shadow: 0 0 0 4px #fff; pointer-events: none; }
@media (min-width: 1000px) { .row > figure { max-width: calc(50% - .5em); } }
.swap img { cursor: pointer; }
table { border-collapse: collapse; margin-top: 1em; } td { padding: .1em 1em .1em 0; } code { background: #f2f2f2; }
@media (prefers-color-scheme: dark) {
  body { background: #15181c; color: #e6e6e6; } small { color: #a8a8a8; } code { background: #2a2e34; }
  .why { background: #3a2418; } .cause { background: #1d2a36; }
}
@media (min-width: 1600px) { body { font-size: 20px; } }
"""
SCRIPT = """
const swapped = [...document.querySelectorAll('.swap img')], sources = swapped.map(img => img.src);
swapped.forEach((img, k) => {
  img.onpointerdown = event => { event.preventDefault(); img.src = sources[1 - k]; };
  img.onpointerup = img.onpointerleave = () => { img.src = sources[k]; };
});
"""


class Failure(NamedTuple):
    """A failed check."""

    name: str
    location: GoldenLocation
    why: str
    actual: NDArray[np.float64]  # (h, w, 3): linear light
    golden: GoldenImage | None  # None: there is no golden image
    verdict: Verdict | None  # None: the images could not be compared


class Panel(NamedTuple):
    """An image with its caption on the page."""

    title: str
    note: str
    codes: NDArray[np.uint8]  # (h, w, 3): sRGB


def failure_page(failure: Failure) -> str:
    """HTML text of the page."""
    title = f"golden {failure.name}"
    actual = Panel("actual", "", srgb8(failure.actual))
    figures, numbers, details, causes = [_figure(actual)], "", "", ""
    if failure.golden is not None:
        both = [Panel("expected", "", srgb8(failure.golden.rgb)), actual]
        figures = [_figure(panel) for panel in both]
        if failure.verdict is not None:
            maps, marks = _maps(failure.actual, failure.golden, failure.verdict.comparison)
            outer = [mark for k, mark in enumerate(marks) if not any(each.contains(mark) for each in marks[:k])]
            figures = [f'<div class="row swap">{"".join(_figure(panel, outer) for panel in both)}</div>']
            figures += [_figure(panel, outer) for panel in maps]
            details = _details([*both, maps[0]], marks, failure.actual - failure.golden.rgb)
            hint = "<p><small>Click and hold the expected or actual image to compare.</small></p>"
            numbers = hint + _table(failure.verdict, failure.actual, failure.golden.rgb)
            found = likely_causes(failure.actual, failure.golden.rgb)
            causes = f'<p class="cause">Likely cause: {escape("; or ".join(found))}.</p>' if found else ""
    command = f"<p>If the actual image is correct, accept it: <code>{escape(failure.location.command)}</code></p>"
    lines = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">',
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>",
        f"<body><h1>{escape(title)}</h1><p><code>{escape(failure.location.test)}</code></p>",
        f'<p class="why">{escape(failure.why)}</p>{causes}<div class="row">',
        *figures,
        f"</div>{details}{command}{numbers}</body><script>{SCRIPT}</script></html>",
    ]
    return "\n".join(lines) + "\n"


def _figure(panel: Panel, marks: Sequence[Spot] = (), least: int = WIDTH) -> str:
    """HTML of an image, enlarged by an integer factor to about ``least`` pixels, with marked regions."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(panel.codes).save(stream, "PNG", optimize=True)
    source = f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"
    height, width = panel.codes.shape[:2]
    shown = width * max(round(least / width), 1)
    boxes = ""
    for mark in marks:
        numbers = mark.column / width, mark.row / height, mark.width / width, mark.height / height
        names = ("left", "top", "width", "height")
        style = ";".join(f"{name}:{100 * value:.4g}%" for name, value in zip(names, numbers, strict=True))
        boxes += f'<i class="mark" title="{escape(mark.title)}" style="{style}"></i>'
    title = escape(panel.title)
    caption = f"<figcaption>{title} <small>{escape(panel.note) or '&nbsp;'}</small></figcaption>"
    frame = f'<div class="frame"><img alt="{title}" src="{source}">{boxes}</div>'
    return f'<figure style="width:{shown}px">{caption}{frame}</figure>'


def _details(panels: Sequence[Panel], marks: Sequence[Spot], difference: NDArray[np.float64]) -> str:
    """HTML of the enlarged regions; a region inside another one is not shown again."""
    text, shown = "", list[Spot]()
    for mark in marks:
        if any(region.contains(mark) for region in shown):
            continue
        region = mark.grown(difference.shape)
        shown.append(region)
        inside = [
            inner._replace(row=inner.row - region.row, column=inner.column - region.column)
            for inner in marks
            if region.contains(inner)
        ]
        cut = (panel._replace(note="", codes=panel.codes[region.pixels]) for panel in panels)
        off = difference[mark.pixels].mean(axis=(0, 1))
        note = f"row {mark.row}, column {mark.column}; actual - expected {', '.join(f'{value:+.3g}' for value in off)}"
        text += f"<h2>{escape(mark.title)} <small>{note}</small></h2>"
        text += f'<div class="row">{"".join(_figure(panel, inside, ENLARGED) for panel in cut)}</div>'
    return text


def _maps(actual: NDArray[np.float64], golden: GoldenImage, comparison: Comparison) -> tuple[list[Panel], list[Spot]]:
    """Panels with difference, SSIM and, for a noisy image, difference in deviations; and the worst regions."""
    finite: NDArray[np.bool_] = np.all(np.isfinite(actual), axis=2)
    shown = np.where(finite[..., None], actual, golden.rgb)
    difference = largest_channel(shown - golden.rgb)
    similarity = ssim_map(shown, golden.rgb)
    least = min(float(similarity.min()), 0.999)
    grey = np.clip((similarity - least) / (1 - least), 0, 1)[..., None] * np.ones(3)
    maps = [
        _signed("difference", difference, _scale(difference, golden.rgb, comparison), "(worst channel)", finite),
        Panel("SSIM", f"black {least:.3g}, white 1", (255 * grey + 0.5).astype(np.uint8)),
    ]
    worst = difference
    if golden.stderr is not None:
        noise = noise_of(golden.rgb, golden.stderr, golden.pictures)
        worst = in_deviations((shown - golden.rgb) @ LUMINANCE, noise)
        maps.append(_signed("difference in standard deviations", worst, 5.0, "deviations", finite))
    if flip.available():
        seen = flip.flip_map(shown, golden.rgb)
        top = float(seen.max()) or 1.0
        grey = np.clip(1 - seen / top, 0, 1)[..., None] * np.ones(3)
        maps.append(Panel("FLIP", f"white 0, black {top:.3g}", (255 * grey + 0.5).astype(np.uint8)))
    return maps, find(worst, finite, comparison)


def _scale(difference: NDArray[np.float64], expected: NDArray[np.float64], comparison: Comparison) -> float:
    """Largest value of the colour scale: the worst tile has about its full colour, and a smaller rest is paler."""
    tile = Spot("", *comparison.worst_tile_at, TILE, TILE).pixels
    return max(difference_scale(difference, expected), float(np.abs(difference[tile]).mean()))


def _signed(title: str, values: NDArray[np.float64], top: float, unit: str, finite: NDArray[np.bool_]) -> Panel:
    """Panel of signed values: white where equal, blue where darker, orange where brighter."""
    share = np.clip(np.abs(values) / (top or 1.0), 0, 1)[..., None]
    colour = np.where(values[..., None] < 0, DARKER, BRIGHTER)
    rgb8 = (255 + share * (colour - 255.0) + 0.5).astype(np.uint8)
    rgb8[~finite] = NOT_FINITE
    note = f"blue {-top:.3g}, orange {top:.3g} {unit}"
    return Panel(title, note + ("" if finite.all() else "; magenta: not finite"), rgb8)


def _table(verdict: Verdict, actual: NDArray[np.float64], expected: NDArray[np.float64]) -> str:
    c, finite = verdict.comparison, np.isfinite(actual).all(axis=2, keepdims=True)
    flips, shown = f"not measured; {flip.INSTALL}", np.where(finite, actual, expected)
    if flip.available():
        flips = f"{flip.flip(shown, expected):.3g}, {flip.hdr_flip(shown, expected):.3g}"
    rows = {
        "SSIM": f"{c.ssim:.6g}",
        "relative bias of red, green, blue": ", ".join(f"{value:+.3g}" for value in c.relative_bias),
        f"worst {TILE} x {TILE} tile": f"{c.worst_tile:.3g}, at row {c.worst_tile_at[0]}, column {c.worst_tile_at[1]}",
        "share of outliers": f"{c.outliers:.3g}",
        "RMSE, linear": f"{c.rmse:.3g}",
        "RMSE, sRGB": f"{c.rmse_srgb:.3g}",
        "mean relative squared error": f"{c.mrse:.3g}",
        "FLIP, HDR-FLIP": flips,
        "pixels that are not finite": str(c.non_finite),
    }
    if verdict.rejected is not None:
        rows |= {"share of pixels that fail the z-test": f"{verdict.rejected:.3g}", "worst z": f"{verdict.worst_z:.3g}"}
    return (
        "<table>" + "".join(f"<tr><td>{escape(k)}</td><td>{escape(v)}</td></tr>" for k, v in rows.items()) + "</table>"
    )
