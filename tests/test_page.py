"""The page: whole, by itself, and safe with any text."""

import json
import re
from base64 import b64decode
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
from PIL import Image

from raytrace.reporting.crops import equal_time
from raytrace.reporting.measurements import Inset, Shown
from raytrace.reporting.page import report_page
from test_sweep_table import a_report

GREY = np.full((6, 8, 3), 128, np.uint8)
SHOWN = (Shown("reference", GREY, None), Shown("</script><b>, 1 spp", GREY, np.full((6, 8), 0.1, np.float32)))
FILES = {
    "error-against-time.png": b"png",
    "error-against-time.svg": b"<svg>time</svg>",
    "error-against-time-dark.svg": b"<svg>dark</svg>",
}


class Reader(HTMLParser):
    """Collects tags and checks that all are closed."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.links = [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in ("src", "href") and value]
        if tag not in ("meta", "img", "input", "source", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def written(**other):
    return report_page(a_report(shown=SHOWN, **other), FILES)


def pictures(text):
    (data,) = re.findall(r'<script type="application/json" id="shown">(.*?)</script>', text, re.DOTALL)
    return json.loads(data)


def test_the_page_is_well_formed_and_needs_nothing_else():
    reader = Reader()
    reader.feed(written())
    assert reader.open == []
    assert reader.links
    assert all(link.startswith("data:image/") for link in reader.links)
    assert not re.findall(r"https?://|@import|url\(", written())


def test_it_holds_the_plot_the_table_and_the_advice():
    text = written()
    dark, plot = re.findall(r'data:image/svg\+xml;base64,([^"]+)"', text)
    assert b64decode(plot) == FILES["error-against-time.svg"]
    assert b64decode(dark) == FILES["error-against-time-dark.svg"]
    assert text.count('<source media="(prefers-color-scheme: dark)"') == 1
    assert '<p class="advice">Use it.</p>' in text
    assert text.count("<tr") == 3  # a header and two points
    assert text.count('<tr class="front">') == 1
    assert "stratified, float32: 256 spp: no time" in text


def test_each_picture_lies_beside_its_error():
    first, second = pictures(written())
    assert second["name"] == SHOWN[1].name
    for shown in (first, second):
        for kind in ("image", "error"):
            data = b64decode(shown[kind].removeprefix("data:image/png;base64,"))
            assert Image.open(BytesIO(data)).size == (8, 6)
    black = np.asarray(Image.open(BytesIO(b64decode(first["error"].split(",")[1]))))
    assert black.max() < 8  # the reference has no error
    assert first["error"] != second["error"]


def test_text_from_a_scene_cannot_become_markup():
    evil = a_report().about_scene | {"name": "<i>box</i>", "about": "<script>alert(1)</script>"}
    text = written(about_scene=evil)
    assert "<i>box" not in text
    assert "alert(1)</script>" not in text
    assert text.count("<script") == 2  # the data and the program


def test_the_page_is_the_same_for_the_same_report():
    assert written() == written()


def test_insets_show_each_sampler_after_the_same_time():
    error = np.zeros((12, 16), np.float32)
    error[5, 9] = 0.5
    images = [Inset(name, 4, seconds, 0.01, np.full((12, 16, 3), 99, np.uint8), error)
              for name, seconds in (("reference", np.nan), ("<sobol>", 0.05), ("independent", 0.06))]  # fmt: skip
    text = written(equal_time=equal_time(0.05, images))
    assert "The same time: 50 ms per image" in text
    assert text.count("<figure>") == 3
    assert "&lt;sobol&gt;" in text
    assert "60 ms, 4 spp" in text
    reader = Reader()
    reader.feed(text)
    assert reader.open == []
