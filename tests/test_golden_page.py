"""The page of a failure: a defect is seen at once however small it is, and the page fits a narrow screen."""

import html
import re
import shutil
import subprocess
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from raytrace.golden.gates import Gates, judge
from raytrace.golden.locations import GoldenLocation
from raytrace.golden.page import BRIGHTER, DARKER, NOT_FINITE, Failure, failure_page
from raytrace.golden.spots import Spot, find, largest_channel
from raytrace.golden.store import GoldenImage
from raytrace.image import flip
from raytrace.image.files import LUMINANCE
from raytrace.image.metrics import compare, difference_scale
from test_page import Reader

WHITE = (255, 255, 255)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def golden_light(height=96, width=128):
    y, x = np.mgrid[0:height, 0:width] / 96.0
    return np.stack([0.3 + 0.2 * x, 0.3 + 0.2 * y, 0.4 + 0 * x], axis=2)


def written(actual, golden, stderr=None, name="box"):
    approved = GoldenImage(golden, stderr, 1 if stderr is None else 8)
    location = GoldenLocation(Path("/g"), Path("/"), Path("/f"), Path("/"), "tests/test_a.py::test_a")
    verdict = judge(actual, approved, Gates())
    text = failure_page(Failure(name, location, "; ".join(verdict.broken), actual, approved, verdict))
    reader = Reader()
    reader.feed(text)
    assert reader.open == []
    return text


def canvases(text):
    """Title, codes and marks of each figure: percent of the left, top, width, height."""
    found = []
    for figure in text.split("<figure")[1:]:
        title = re.search(r"<figcaption>([^<]*?) <small>", figure)[1]
        data = re.search(r'src="data:image/png;base64,([^"]+)"', figure)[1]
        marks = [
            [float(value) for value in re.findall(r":([0-9.e-]+)%", style)]
            for style in re.findall(r'class="mark"[^>]*style="([^"]+)"', figure)
        ]
        found.append((title, np.asarray(Image.open(BytesIO(b64decode(data)))), marks))
    return found


DEFECTS = {  # row, column, height, width, factor
    "a tile": (40, 64, 8, 8, 1.5),
    "a faint tile": (40, 64, 8, 8, 1.01),
    "a pixel": (45, 67, 1, 1, 1.5),
    "a dark pixel in the corner": (95, 127, 1, 1, 0.2),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_a_local_defect_is_seen_at_once(name):
    row, column, height, width, factor = DEFECTS[name]
    golden = golden_light()
    actual = golden.copy()
    actual[row : row + height, column : column + width] *= factor
    text = written(actual, golden)
    shown = canvases(text)
    assert [title for title, _, _ in shown[:4]] == ["expected", "actual", "difference", "SSIM"]
    codes = shown[2][1]
    colour = np.array(DARKER if factor < 1 else BRIGHTER)
    inside = codes[row : row + height, column : column + width].astype(int)
    assert np.abs(inside - colour).max() < 60  # nearly as strong as colour gets
    assert np.abs(inside - colour).min() < 2
    assert (codes == WHITE).all(axis=2).sum() == codes.shape[0] * codes.shape[1] - height * width
    assert "blue -0, orange 0 " not in text
    for _, _, marks in shown[:4]:  # all have the marks
        left, top, wide, high = marks[0]
        assert left <= 100 * column / 128 + 0.01
        assert top <= 100 * row / 96 + 0.01
        assert 1.28 * (left + wide) >= column + width - 0.01
        assert 0.96 * (top + high) >= row + height - 0.01
        assert (round(1.28 * wide), round(0.96 * high)) == (8, 8)
    enlarged = shown[4 + flip.available() :][:3]
    assert [title for title, _, _ in enlarged] == ["expected", "actual", "difference"]
    assert max(enlarged[0][1].shape[:2]) <= 24
    assert (enlarged[2][1].reshape(-1, 3) == inside.reshape(-1, 3)[0]).all(axis=1).any()
    assert f"worst tile <small>row {40 if row < 90 else 88}, column {64 if row < 90 else 120};" in text


def test_one_tile_is_seen_at_once_among_small_differences():
    golden = golden_light()
    actual = golden + 0.002 * np.random.default_rng(0).normal(size=golden.shape)  # more than rounding, everywhere
    actual[40:48, 64:72] += 0.05
    codes = canvases(written(actual, golden))[2][1].astype(int)
    inside = codes[40:48, 64:72].reshape(-1, 3)
    codes[40:48, 64:72] = 255
    assert np.abs(inside - BRIGHTER).max() < 40
    assert codes.min(axis=2).mean() > 235  # all else is nearly white


def test_the_page_names_the_likely_cause():
    golden = golden_light() * (1 + 0.1 * np.random.default_rng(0).random((96, 128, 3)))
    for actual, cause in ((golden[:, ::-1], "it is flipped left to right"), (1.5 * golden, "multiplied by 1.5.")):
        text = written(actual, golden)
        assert re.search('<p class="cause">Likely cause: (.*?)</p>', text)[1].find(cause) >= 0
    actual = golden.copy()
    actual[8:16, 8:16] *= 1.3
    assert 'class="cause"' not in written(actual, golden)


def test_the_page_has_flip_or_says_what_to_install(monkeypatch):
    golden = golden_light()
    actual = golden.copy()
    actual[8:16, 8:16] = np.nan
    actual[16:24, 8:16] *= 1.5
    if flip.available():
        text = written(actual, golden)
        assert "FLIP" in [title for title, _, _ in canvases(text)]
        seen = flip.flip(np.where(np.isfinite(actual), actual, golden), golden)
        assert re.search("<td>FLIP, HDR-FLIP</td><td>([0-9.e-]+), ", text)[1] == f"{seen:.3g}"
    monkeypatch.setattr(flip, "find_spec", lambda _name: None)
    text = written(actual, golden)
    assert "FLIP" not in [title for title, _, _ in canvases(text)]
    assert "<td>not measured; pip install flip-evaluator</td>" in text


def test_a_defect_without_a_mean_is_marked_by_its_worst_pixel():
    golden = golden_light()
    actual = golden.copy()
    actual[40:48:2, 64:72] += 0.1
    actual[41:48:2, 64:72] -= 0.1
    actual[0:8, 0:8] += 1e-4  # the tile of the largest mean is another one
    text = written(actual, golden)
    spot = re.search(r"worst pixel <small>row (\d+), column (\d+);", text)
    assert 40 <= int(spot[1]) < 48
    assert 64 <= int(spot[2]) < 72
    assert text.count("<h2>") == 2


def test_a_change_of_hue_alone_is_seen():
    golden = golden_light()
    actual = golden.copy()
    actual[40:48, 64:72, 0] += 0.1
    actual[40:48, 64:72, 1] -= 0.1 * LUMINANCE[0] / LUMINANCE[1]
    codes = canvases(written(actual, golden))[2][1]
    assert (codes[40:48, 64:72] == BRIGHTER).all()


def test_a_pixel_that_is_not_finite_is_marked():
    golden = golden_light()
    actual = golden.copy()
    actual[50, 60] = np.nan
    text = written(actual, golden)
    assert "worst pixel <small>row 50, column 60;" in text
    shown = canvases(text)
    assert (shown[2][1][50, 60] == NOT_FINITE).all()
    assert (shown[-1][1] == NOT_FINITE).all(axis=2).sum() == 1


@pytest.mark.parametrize("black", [True, False])
def test_a_noisy_golden_has_a_page_even_if_it_is_black(black):
    golden = 0 * golden_light() if black else golden_light()
    actual = golden.copy()
    actual[50, 60] += 0.2
    with np.errstate(all="raise", under="ignore"):
        text = written(actual, golden, 0 * golden[:, :, 0])
    assert "worst pixel <small>row 50, column 60;" in text or "worst tile <small>row 48, column 56;" in text
    assert [title for title, _, _ in canvases(text)[:5]][-1] == "difference in standard deviations"


def test_one_bright_pixel_does_not_hide_the_rest():
    golden = golden_light()
    difference = np.full(golden.shape[:2], 0.01)
    difference[3, 3] = 100.0
    assert difference_scale(difference, golden) == pytest.approx(0.01)
    difference[:] = 0.0
    assert difference_scale(difference, golden) == 0.0
    difference[3, 3] = 0.25
    assert difference_scale(difference, golden) == 0.25


def test_the_channel_that_differs_most_has_its_sign():
    difference = np.array([[[0.1, -0.3, 0.2], [0.5, 0.0, -0.4]]])
    assert largest_channel(difference).tolist() == [[-0.3, 0.5]]


def test_spots_grow_within_the_image():
    assert Spot("", 0, 90, 8, 8).grown((20, 100)) == Spot("", 0, 82, 16, 18)
    assert Spot("", 0, 0, 8, 8).contains(Spot("", 7, 7, 1, 1))
    assert not Spot("", 0, 0, 8, 8).contains(Spot("", 7, 8, 1, 1))
    equal = golden_light(4, 5)
    assert find(np.zeros((4, 5)), np.ones((4, 5), bool), compare(equal, equal)) == []


@pytest.mark.skipif(CHROMIUM is None, reason="needs a Chromium")
@pytest.mark.parametrize(("width", "size"), [(390, (96, 128)), (390, (480, 640)), (320, (16, 16)), (1280, (30, 1500))])
def test_the_page_fits_the_screen(tmp_path, width, size):
    golden = golden_light(*size)
    actual = golden.copy()
    actual[8:16, 8:16] *= 1.5
    text = written(actual, golden, name="a-long-name-" * 12)
    frame = (
        f'<iframe id="f" width="{width}" height="800" srcdoc="{html.escape(text)}"></iframe><p id="told"></p><script>'
        "f.onload = () => { const d = f.contentDocument.documentElement;"
        " const shown = [...f.contentDocument.images].map(i => i.clientWidth);"
        " told.textContent = 'wide ' + d.scrollWidth + ' of ' + d.clientWidth + ' least ' + Math.min(...shown); }"
        "</script>"
    )
    (tmp_path / "frame.html").write_text(frame, "utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    options += ["--virtual-time-budget=60000", "--dump-dom", (tmp_path / "frame.html").as_uri()]
    done = subprocess.run([CHROMIUM, *options], capture_output=True, text=True, timeout=300)
    wide, held, least = map(int, re.search(r"wide (\d+) of (\d+) least (\d+)", done.stdout).groups())
    assert wide <= held <= width
    assert least >= min(width, 500) / 3
