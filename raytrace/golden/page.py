"""The page that a failed golden leaves: expected, actual, difference and SSIM map side by side, in one file."""

import io
from base64 import b64encode
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.golden.gates import Verdict
from raytrace.golden.noise import in_deviations, noise_of
from raytrace.golden.place import Place
from raytrace.golden.store import Approved
from raytrace.image import LUMINANCE, srgb8
from raytrace.reporting.error import TILE, ssim_map

WIDTH = 320  # screen pixels that a small picture is blown up to, by a whole factor
DARKER, BRIGHTER, NOT_FINITE = (0, 114, 178), (213, 94, 0), (255, 0, 255)  # blue, vermilion, magenta
SHARE = 0.995  # of the pixels lie within the scale of the difference
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; margin: 1.2em; color: #111; }
h1 { font-size: 1.4em; margin: 0; } .why { background: #fdeee6; border-left: .3em solid #d55e00; padding: .5em .8em; }
.row { display: flex; flex-wrap: wrap; gap: 1em; } figure { margin: 0; width: min-content; }
small { color: #555; display: block; }
figcaption { height: 2.9em; } img { image-rendering: pixelated; display: block; outline: 1px solid #bbb; }
.swap img { cursor: pointer; }
table { border-collapse: collapse; margin-top: 1em; } td { padding: .1em 1em .1em 0; } code { background: #f2f2f2; }
"""
SCRIPT = """
const swapped = [...document.querySelectorAll('.swap img')], sources = swapped.map(img => img.src);
swapped.forEach((img, k) => {
  img.onpointerdown = event => { event.preventDefault(); img.src = sources[1 - k]; };
  img.onpointerup = img.onpointerleave = () => { img.src = sources[k]; };
});
"""


class Failure(NamedTuple):
    """What went wrong."""

    name: str
    place: Place
    why: str
    actual: NDArray[np.float64]  # (h, w, 3): linear light
    golden: Approved | None  # None: there is none
    verdict: Verdict | None  # None: there was nothing to compare


def page(failure: Failure) -> str:
    """Write the page."""
    title = f"golden {failure.name}"
    actual = _figure("actual", "", srgb8(failure.actual))
    figures, numbers = [actual], ""
    if failure.golden is not None:
        figures = [_figure("expected", "", srgb8(failure.golden.rgb)), actual]
    if failure.golden is not None and failure.verdict is not None:
        figures = [f'<div class="row swap">{"".join(figures)}</div>', *_maps(failure.actual, failure.golden)]
        numbers = f"<p><small>Press on one of the first two to see the other.</small></p>{_table(failure.verdict)}"
    command = f"<p>If it is right as it is now: <code>{escape(failure.place.command)}</code></p>"
    lines = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style></head>',
        f"<body><h1>{escape(title)}</h1><p><code>{escape(failure.place.test)}</code></p>",
        f'<p class="why">{escape(failure.why)}</p><div class="row">',
        *figures,
        f"</div>{command}{numbers}</body><script>{SCRIPT}</script></html>",
    ]
    return "\n".join(lines) + "\n"


def _figure(title: str, note: str, rgb8: NDArray[np.uint8]) -> str:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(rgb8).save(stream, "PNG", optimize=True)
    picture = f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"
    width = rgb8.shape[1] * max(round(WIDTH / rgb8.shape[1]), 1)
    caption = f"<figcaption>{escape(title)} <small>{escape(note) or '&nbsp;'}</small></figcaption>"
    return f'<figure>{caption}<img alt="{escape(title)}" width="{width}" src="{picture}"></figure>'


def _maps(actual: NDArray[np.float64], golden: Approved) -> list[str]:
    """Difference, similarity and, for a noisy picture, the difference in deviations."""
    finite: NDArray[np.bool_] = np.all(np.isfinite(actual), axis=2)
    shown = np.where(finite[..., None], actual, golden.rgb)
    difference = (shown - golden.rgb) @ LUMINANCE
    similarity = ssim_map(shown, golden.rgb)
    least = min(float(similarity.min()), 0.999)
    grey = np.clip((similarity - least) / (1 - least), 0, 1)[..., None] * np.ones(3)
    maps = [
        _signed("difference", difference, float(np.quantile(np.abs(difference), SHARE)), "luminance", finite),
        _figure("SSIM", f"black {least:.3g}, white 1", (255 * grey + 0.5).astype(np.uint8)),
    ]
    if golden.stderr is not None:
        z = in_deviations(difference, noise_of(golden.rgb, golden.stderr, golden.pictures))
        maps.append(_signed("difference in deviations", z, 5.0, "deviations", finite))
    return maps


def _signed(title: str, values: NDArray[np.float64], top: float, unit: str, finite: NDArray[np.bool_]) -> str:
    """White where equal, blue where darker, orange where brighter."""
    share = np.clip(np.abs(values) / (top or 1.0), 0, 1)[..., None]
    colour = np.where(values[..., None] < 0, DARKER, BRIGHTER)
    rgb8 = (255 + share * (colour - 255.0) + 0.5).astype(np.uint8)
    rgb8[~finite] = NOT_FINITE
    note = f"blue {-top:.3g}, orange {top:.3g} {unit}"
    return _figure(title, note + ("" if finite.all() else "; magenta: not finite"), rgb8)


def _table(verdict: Verdict) -> str:
    c = verdict.comparison
    rows = {
        "SSIM": f"{c.ssim:.6g}",
        "relative bias of red, green, blue": ", ".join(f"{value:+.3g}" for value in c.relative_bias),
        f"worst {TILE} x {TILE} tile": f"{c.worst_tile:.3g}, at row {c.worst_tile_at[0]}, column {c.worst_tile_at[1]}",
        "share of outliers": f"{c.outliers:.3g}",
        "RMSE, linear": f"{c.rmse:.3g}",
        "RMSE on a screen, sRGB": f"{c.rmse_srgb:.3g}",
        "pixels that aren't finite": str(c.non_finite),
    }
    if verdict.rejected is not None:
        rows |= {"share of pixels that fail the z-test": f"{verdict.rejected:.3g}", "worst z": f"{verdict.worst_z:.3g}"}
    return (
        "<table>" + "".join(f"<tr><td>{escape(k)}</td><td>{escape(v)}</td></tr>" for k, v in rows.items()) + "</table>"
    )
