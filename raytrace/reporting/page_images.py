"""Images of a report's page: insets at equal time, and a slider between any two images."""

import io
import json
from base64 import b64encode
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.measurements import EqualTime, Inset
from raytrace.reporting.plots import heat
from raytrace.reporting.sweep_table import seconds_label


def uri(data: bytes, kind: str) -> str:
    """Return the content of an image file as an address."""
    return f"data:image/{kind};base64,{b64encode(data).decode()}"


def png(rgb8: NDArray[np.uint8]) -> str:
    """Return an image (h, w, 3) as the address of a PNG file."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb8)).save(stream, "PNG", optimize=True)
    return uri(stream.getvalue(), "png")


def equal_time_section(found: EqualTime | None) -> str:
    """Return the section of insets at equal time; "" without any."""
    if found is None:
        return ""
    figures = "".join(_inset(inset, found) for inset in found.insets)
    side = found.windows[0][2] if found.windows else 0
    return f"""<h2>The same time: {seconds_label(found.seconds)} per image</h2>
<p>{len(found.windows)} windows of {side} x {side} pixels, where the errors are largest: the image, and its error below
it. The caption has the time that it really took.</p>
<div class="crops">{figures}</div>"""


def _inset(inset: Inset, found: EqualTime) -> str:
    images = ""
    for x, y, side in found.windows:
        part = np.s_[y : y + side, x : x + side]
        shown = inset.rgb8[part]
        if np.isnan(inset.seconds):
            images += _crop(shown, f"{inset.name}")
            images += _crop(_outline(found, inset, (x, y, side)), "position of the window in the image")
        else:
            images += _crop(shown, inset.name) + _crop(heat(inset.error[part]), f"error of {inset.name}")
    text = f"<b>{escape(inset.name)}</b>"
    if not np.isnan(inset.seconds):
        text += f"<br>{seconds_label(inset.seconds)}, {inset.spp:.4g} spp<br>RMSE {inset.rmse_srgb:.2e}"
    else:
        text += "<br>and where the windows are"
    return f"<figure>{images}<figcaption>{text}</figcaption></figure>"


def _crop(rgb8: NDArray[np.uint8], about: str) -> str:
    return f'<img class="whole" alt="{escape(about)}" src="{png(rgb8)}">'


def _outline(found: EqualTime, inset: Inset, window: tuple[int, int, int]) -> NDArray[np.uint8]:
    """Return a square part of the image around a window, with the window outlined in white and black."""
    x, y, side = window
    height, width = inset.rgb8.shape[:2]
    size = min(height, width)
    left = min(max(x + side // 2 - size // 2, 0), width - size)
    top = min(max(y + side // 2 - size // 2, 0), height - size)
    shown = inset.rgb8[top : top + size, left : left + size].copy()
    thick = max(size // 120, 1)
    for margin, colour in ((2 * thick, 0), (thick, 255)):
        a, b = max(y - top - margin, 0), max(x - left - margin, 0)
        c, d = y - top + side + margin, x - left + side + margin
        frame = np.zeros(shown.shape[:2], bool)
        frame[a:c, b:d] = True
        frame[a + thick : c - thick, b + thick : d - thick] = False
        shown[frame] = colour
    return shown


def slider(report: Any) -> str:
    """Return the section with a slider between two images, and between their errors."""
    height, width = report.shown[0].rgb8.shape[:2]
    none = np.zeros((height, width), np.float32)
    images = [
        {"name": s.name, "image": png(s.rgb8), "error": png(heat(none if s.error is None else s.error))}
        for s in report.shown
    ]
    data = json.dumps(images).replace("<", "\\u003c")  # "</script>" in a name would end the data
    ramp = ", ".join(f"rgb{tuple(int(c) for c in colour)}" for colour in heat(10.0 ** np.linspace(-4, 0, 9)))
    both = '<div class="both" data-kind="{}"><img alt=""><img alt="" class="b"><i></i></div>'
    return f"""<h2>Images and their errors</h2>
<p><select id="one" aria-label="left image"></select> left of the line,
<select id="other" aria-label="right image"></select> right of it</p>
<div class="pair"><div>{both.format("image")}
<input type="range" id="where" min="0" max="100" step="0.1" value="50" aria-label="position of the line">
<small>images; drag the line to compare</small></div>
<div>{both.format("error")}<div class="scale" style="background: linear-gradient(to right, {ramp})"></div>
<div><span>error 0.0001</span><span>0.001</span><span>0.01</span><span>0.1</span><span>1</span></div>
<small>largest difference of a channel from the reference, sRGB</small></div></div>
<script type="application/json" id="shown">{data}</script>"""
