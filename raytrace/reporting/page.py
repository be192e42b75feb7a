"""One self-contained HTML page about a sweep: it needs no network and no other files."""

import io
import json
from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.plots import heat
from raytrace.reporting.sweep_table import cells, has_flip, header, legend, order_text

STYLE = """
body { font: 20px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1500px; padding: 1.2em; color: #111; }
h1 { margin: 0; } h2 { margin: 1.4em 0 .4em; }
.advice { font-size: 1.35em; background: #eef5fb; border-left: .3em solid #0072b2; padding: .5em .8em; }
.plots, .pair { display: flex; flex-wrap: wrap; gap: 1em; }
.plots img { flex: 1 1 600px; max-width: 100%; min-width: 0; }
.pair > div { flex: 1 1 420px; }
.both { position: relative; overflow: hidden; cursor: ew-resize; touch-action: none; user-select: none; }
.both img { display: block; width: 100%; image-rendering: pixelated; pointer-events: none; }
.both img.b { position: absolute; inset: 0; height: 100%; }
.both i { position: absolute; top: 0; bottom: 0; width: 2px; margin-left: -1px; background: #fff;
  box-shadow: 0 0 3px #000; }
select, input { font: inherit; } input[type=range] { width: 100%; margin: 0; }
.scale { height: .8em; } .scale + div { display: flex; justify-content: space-between; font-size: .8em; }
table { border-collapse: collapse; font-size: .72em; } td, th { padding: .15em .6em; text-align: right; }
td:first-child { text-align: left; } tr.front { background: #fff3d6; } tr:hover { outline: 1px solid #888; }
.wide { overflow-x: auto; } small, .quiet { color: #555; font-size: .8em; }
"""
SCRIPT = """
const shown = JSON.parse(document.getElementById('shown').textContent);
const [one, other, where] = ['one', 'other', 'where'].map(id => document.getElementById(id));
const boxes = [...document.querySelectorAll('.both')];
shown.forEach((image, k) => { for (const list of [one, other]) list.add(new Option(image.name, k)); });
one.value = Math.min(1, shown.length - 1); other.value = 0;
function update() {
  boxes.forEach(box => {
    const kind = box.dataset.kind, [a, b] = box.querySelectorAll('img');
    a.src = shown[other.value][kind]; b.src = shown[one.value][kind];
    b.style.clipPath = `inset(0 ${100 - where.value}% 0 0)`; box.querySelector('i').style.left = where.value + '%';
  });
}
function moveLine(event) {
  const at = event.currentTarget.getBoundingClientRect();
  if (event.type == 'pointerdown') event.currentTarget.setPointerCapture(event.pointerId);
  if (event.buttons) { where.value = 100 * (event.clientX - at.left) / at.width; update(); }
}
boxes.forEach(box => { box.onpointerdown = moveLine; box.onpointermove = moveLine; });
for (const control of [one, other, where]) control.oninput = update;
update();
"""


def report_page(report: Any, files: Mapping[str, bytes]) -> str:
    """HTML page of a ``Report``; `files` has the plots by name."""
    about = report.about_scene
    title = f"{about['name']}: speed against error"
    lines = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head><body>',
        f"<h1>{escape(title)}</h1>",
        f"<p>{escape(about['about'])} {about['triangles']:,} triangles, "
        f"{about['size'][0]} x {about['size'][1]} pixels, {report.machine['threads']} threads.</p>",
        *(f'<p class="advice">{escape(line)}</p>' for line in report.advice[:1]),
        *(f"<p>{escape(line)}</p>" for line in report.advice[1:]),
        '<div class="plots">',
        *(f'<img alt="{name[:-4].replace("-", " ")}" src="{_uri(files[name], "svg+xml")}">'
          for name in files if name.endswith(".svg")),
        "</div>",
        _slider(report),
        _table(report),
        _notes(report),
        f"</body><script>{SCRIPT}</script></html>",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _uri(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{b64encode(data).decode()}"


def _png(rgb8: NDArray[np.uint8]) -> str:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(rgb8).save(stream, "PNG", optimize=True)
    return _uri(stream.getvalue(), "png")


def _slider(report: Any) -> str:
    height, width = report.shown[0].rgb8.shape[:2]
    none = np.zeros((height, width), np.float32)
    images = [
        {"name": s.name, "image": _png(s.rgb8), "error": _png(heat(none if s.error is None else s.error))}
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


def _table(report: Any) -> str:
    rows = ["<tr>" + "".join(f"<th>{escape(name)}</th>" for name in header(report.points)) + "</tr>"]
    for point, front in zip(report.points, report.front, strict=True):
        row = "".join(f"<td>{escape(cell)}</td>" for cell in cells(point, front, has_flip(report.points)))
        rows.append(f'<tr class="front">{row}</tr>' if front else f"<tr>{row}</tr>")
    below = escape(legend(report.points))
    return f'<h2>All numbers</h2><div class="wide"><table>{"".join(rows)}</table></div><p class="quiet">{below}</p>'


def _notes(report: Any) -> str:
    def items(rows: list[str]) -> str:
        return "<ul>" + "".join(f"<li>{escape(row)}</li>" for row in rows) + "</ul>"

    parts = [f"<h2>How it was measured</h2><p>{escape(report.reference_text)}</p>"]
    if report.orders:
        parts.append("<p>Order of convergence of the RMSE (sRGB):</p>")
        parts.append(items([f"{order.configuration.name}: {order_text(order)}" for order in report.orders]))
    parts.append("<p>First images, with compilation or loading of kernels:</p>")
    parts.append(items([f"{first.configuration.name}: {first.seconds:.2f} s" for first in report.firsts]))
    if report.left_out:
        parts.append("<p>Not measured:</p>" + items([f"{what}: {why}" for what, why in report.left_out]))
    machine = ", ".join(f"{name} {value}" for name, value in report.machine.items())
    parts.append(
        f'<p class="quiet">raytrace {report.version}; {escape(machine)}; scene {report.about_scene["sha256"][:16]}</p>'
    )
    return "\n".join(parts)
