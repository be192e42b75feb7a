"""One HTML page that lists several failures, with small images; it links to the page of each."""

import io
import re
from base64 import b64decode, b64encode
from collections.abc import Sequence
from html import escape, unescape
from pathlib import Path
from urllib.parse import quote

from raytrace.golden.locations import relative
from raytrace.output_folder import check_folder, write

NAME = "index.html"
TITLE = "golden images differ"
SMALL = 160  # pixels: the longer side of a small image
SHOWN = "expected", "actual", "difference"
STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; margin: 1.2em; color: #111; overflow-wrap: anywhere; }
h1 { font-size: 1.4em; margin: 0; } h2 { font-size: 1em; margin: 0; }
section { border-top: 1px solid #bbb; margin-top: 1em; padding-top: 1em; }
.row { display: flex; flex-wrap: wrap; gap: 1em; } figure { margin: 0; } figcaption, small { color: #555; }
img { image-rendering: pixelated; display: block; outline: 1px solid #bbb; max-width: 100%; }
.why, .cause { border-left: .3em solid #d55e00; padding-left: .8em; } .cause { border-color: #0072b2; }
@media (prefers-color-scheme: dark) {
  body { background: #15181c; color: #e6e6e6; } figcaption, small { color: #a8a8a8; } a { color: #56b4e9; }
}
@media (min-width: 1600px) { body { font-size: 20px; } }
"""


def write_index(folder: Path, pages: Sequence[Path]) -> Path:
    """Write the page, and return its path.

    Parameters
    ----------
    folder : Path
        Folder of the failures.
    pages : sequence of Path
        Pages of failures, as ``failure_page`` makes them.
    """
    path = folder / NAME
    while path in pages:  # a golden image has this name
        path = path.with_name(f"all-{path.name}")
    parts = [_section(page, folder) for page in pages]
    title = f"{len(pages)} {TITLE}"
    lines = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">',
        f"<title>{title}</title><style>{STYLE}</style></head><body><h1>{title}</h1>",
        *parts,
        "</body></html>",
    ]
    check_folder(folder)
    write(folder, {path.name: ("\n".join(lines) + "\n").encode()})
    return path


def remove_index(folder: Path) -> None:
    """Remove the page of an earlier run."""
    path = folder / NAME
    if path.is_file() and TITLE in path.read_text("utf-8", "replace"):
        path.unlink()


def _section(page: Path, folder: Path) -> str:
    """What the page of one failure says, in short."""
    link = escape(quote(relative(page, folder).replace("\\", "/")))
    try:
        text = page.read_text("utf-8")
    except OSError as error:
        return f"<section><h2>{escape(page.name)}</h2><p>{escape(str(error))}</p></section>"
    name, test = _first(r"<h1>golden (.*?)</h1>", text), _first(r"<p><code>(.*?)</code></p>", text)
    paragraphs = "".join(
        f'<p class="{kind}">{escape(found)}</p>'
        for kind in ("why", "cause")
        if (found := _first(rf'<p class="{kind}">(.*?)</p>', text))
    )
    figures = "".join(_figure(title, text, link) for title in SHOWN)
    heading = f'<h2><a href="{link}">{escape(name)}</a> <small>{escape(test)}</small></h2>'
    return f'<section>{heading}{paragraphs}<div class="row">{figures}</div></section>'


def _first(pattern: str, text: str) -> str:
    found = re.search(pattern, text, re.S)
    return unescape(found[1]) if found else ""


def _figure(title: str, text: str, link: str) -> str:
    """A small copy of the first image of this title."""
    from PIL import Image, ImageFilter

    data = _first(rf'<img alt="{title}" src="data:image/png;base64,([^"]+)"', text)
    if not data:
        return ""
    image: Image.Image = Image.open(io.BytesIO(b64decode(data)))
    shrink = -(-max(image.size) // SMALL)
    if shrink > 1:
        if title == "difference":  # on white: what differs stays as large as a pixel of the small image
            image = image.filter(ImageFilter.MinFilter(shrink | 1))
        image = image.resize([max(side // shrink, 1) for side in image.size], Image.Resampling.BOX)
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    source = f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"
    width = image.width * max(round(SMALL / max(image.size)), 1)
    picture = f'<a href="{link}"><img alt="{title}" width="{width}" src="{source}"></a>'
    return f"<figure>{picture}<figcaption>{title}</figcaption></figure>"
