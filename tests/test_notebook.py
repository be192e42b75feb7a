"""The picture in a notebook's cell while it is drawn, and the stop button: in a real kernel, and apart."""

import base64
import re
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

import raytrace as rt
from kernels import a_kernel
from raytrace.errors import OptionError
from raytrace.image.files import srgb8
from raytrace.image.png import SIGNATURE
from raytrace.jit import PLAIN
from raytrace.rendering import notebook
from raytrace.rendering.notebook import NotebookPreview, in_cell
from raytrace.rendering.progress import ProgressListener, listener_of
from small_scenes import studio
from test_init import python


class Shelf(NotebookPreview):
    """A preview whose cell is a list."""

    def __init__(self):
        super().__init__()
        self.shown = []

    def _say(self, text, picture=""):
        self._update = self.shown.append
        self.shown.append((text, picture))


def decoded(html):
    import io

    from PIL import Image

    data = base64.b64decode(re.search(r"base64,([^\"]+)", html)[1])
    return np.asarray(Image.open(io.BytesIO(data)))


@pytest.fixture
def eager(monkeypatch):
    """Previews that show all they hear of, of any picture."""
    for name, value in {"FIRST": 0.0, "PAUSE": 0.0, "SHARE": np.inf, "LONG": 0}.items():
        monkeypatch.setattr(notebook, name, value)


def test_the_bits_are_the_same_with_and_without(eager):
    ask = {"scene": studio(), "spp": 24, "size": (70, 50)}
    shelf = Shelf()
    seen, unseen = rt.render(**ask, progress=shelf), rt.render(**ask, progress=False)
    assert len(shelf.shown) > 3
    np.testing.assert_array_equal(seen.rgb, unseen.rgb)
    np.testing.assert_array_equal(seen.stderr, unseen.stderr)


def test_the_last_look_shows_the_picture(eager):
    shelf = Shelf()
    picture = rt.render(studio(), spp=8, size=(70, 50), progress=shelf)
    text, html = shelf.shown[-2]
    assert re.fullmatch(r"rendering: 8 samples per pixel, [\d.]+ M rays/s", text)
    assert 'width="70"' in html
    difference = decoded(html).astype(int) - srgb8(picture.rgb)
    assert np.abs(difference).max() <= 1  # of a value that lies half way between two
    assert (difference != 0).mean() < 1e-3
    assert shelf.shown[-1] == ("", "")


def test_a_crop_and_an_adaptive_picture_lie_where_they_belong(eager):
    for ask in ({"crop": (10, 5, 40, 30), "spp": 2}, {"target_error": 0.02}):
        shelf = Shelf()
        picture = rt.render(studio(), size=(70, 50), progress=shelf, **ask)
        assert np.abs(decoded(shelf.shown[-2][1]).astype(int) - srgb8(picture.rgb)).max() <= 1


def test_the_whole_picture_is_there_early_if_it_takes_long(monkeypatch, eager):
    def first(long):
        monkeypatch.setattr(notebook, "LONG", long)
        shelf = Shelf()
        rt.render(studio(), spp=64, size=(96, 96), progress=shelf, threads=1)
        return decoded(next(html for _, html in shelf.shown if html))

    assert (first(96 * 96 * 64) == 0).all(axis=2).mean() > 0.5  # tile after tile
    assert (first(96 * 96 * 64 - 1) == 0).all(axis=2).mean() < 0.5


def test_a_large_picture_is_shown_smaller(monkeypatch, eager):
    monkeypatch.setattr(notebook, "SIDE", 32)
    shelf = Shelf()
    rt.render(studio(), spp=1, size=(70, 50), progress=shelf)
    assert decoded(shelf.shown[-2][1]).shape == (17, 24, 3)
    assert 'width="70"' in shelf.shown[-2][1]


def test_a_quick_picture_is_not_shown():
    rt.render(studio(), spp=1, size=(16, 16), progress=False)  # kernels may have to be compiled
    shelf = Shelf()
    rt.render(studio(), spp=1, size=(16, 16), progress=shelf)
    assert shelf.shown == []


def test_looks_take_a_small_share_of_the_time(monkeypatch):
    shelf, clock = Shelf(), SimpleNamespace(now=0.0)
    monkeypatch.setattr(notebook.time, "perf_counter", lambda: clock.now)
    shelf._next = 0.0

    def slow(_progress):
        clock.now += 0.1

    monkeypatch.setattr(shelf, "_show", slow)
    for _ in range(1000):
        clock.now += 0.01
        shelf.look(None)
    assert 1 <= (clock.now - 10.0) / 0.1 <= 1 + 10.0 / (0.1 / notebook.SHARE)


def test_who_watches():
    assert type(listener_of(None)) is ProgressListener
    assert type(listener_of(False)) is ProgressListener
    told = []
    listener_of(told.append)("progress")
    assert told == ["progress"]
    sketch = NotebookPreview()
    assert listener_of(sketch) is sketch
    for wrong in (True, 1, "bar"):
        with pytest.raises(OptionError, match=r"^progress: expected a function, or False, got "):
            rt.render(studio(), progress=wrong)


def test_a_cell_is_told_from_all_else(monkeypatch):
    def ipython(shell):
        monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))

    ipython(SimpleNamespace(kernel=None))
    assert in_cell()
    elsewhere = []
    thread = threading.Thread(target=lambda: elsewhere.append(in_cell()))
    thread.start()
    thread.join()
    assert elsewhere == [False]  # what it would show has no cell
    ipython(SimpleNamespace())  # IPython in a terminal
    assert not in_cell()
    ipython(None)  # imported by a script
    assert not in_cell()
    monkeypatch.delitem(sys.modules, "IPython")
    assert not in_cell()


def test_nothing_of_ipython_is_imported_outside():
    program = "import sys, raytrace as rt; rt.render('scenes/cornell-box.json', spp=1, size=(16, 16))"
    python(f"{program}; assert not {{'IPython', 'ipykernel', 'traitlets'}} & sys.modules.keys()")


@pytest.fixture(scope="module")
def kernel():
    if PLAIN:
        pytest.skip("kernels are plain functions")
    with a_kernel() as cells:
        cells.run("import raytrace as rt; scene = rt.load('scenes/room.json'); rt.render(scene, spp=1, size=(64, 64))")
        yield cells


LONG = "rt.render(scene, spp=65536, size=(384, 384)"


def test_the_stop_button_returns_what_is_finished(kernel):
    kernel.begin(
        f"picture = {LONG})\nprint(picture.complete, picture.interrupted, (picture.aov['samples'] > 0).all())\npicture"
    )
    first = kernel.until("display_data")
    second = kernel.until("update_display_data")
    began = time.monotonic()
    kernel.manager.interrupt_kernel()
    assert kernel.finish() == "False True True\n"
    assert time.monotonic() - began < 600  # all of it would take an hour
    assert first["transient"] == second["transient"]
    for shown in (first, second):
        assert decoded(shown["data"]["text/html"]).shape == (384, 384, 3)
        assert "samples per pixel" in shown["data"]["text/plain"]
    said = kernel.each("update_display_data", "data")[-1]["text/plain"]
    assert re.fullmatch(r"interrupted at \d+ of 65536 samples per pixel", said)
    (result,) = kernel.each("execute_result", "data")
    assert base64.b64decode(result["image/png"]).startswith(SIGNATURE)


def test_a_cell_that_is_done_shows_its_picture_once(kernel):
    kernel.run("from raytrace.rendering import notebook; notebook.FIRST = 0.0; notebook.LONG = 0")
    kernel.run("rt.render(scene, spp=16, size=(64, 64))")
    assert len(kernel.each("display_data", "data")) == 1
    assert kernel.each("update_display_data", "data")[-1] == {"text/plain": "", "text/html": ""}
    assert len(kernel.each("execute_result", "data")) == 1


def test_it_can_be_switched_off(kernel):
    kernel.run("from raytrace.rendering import notebook; notebook.FIRST = 0.0")
    kernel.run("rt.render(scene, spp=16, size=(64, 64), progress=False)")
    assert kernel.each("display_data", "data") == []
    assert kernel.run("rt.render(scene, spp=1, size=(16, 16), progress=lambda p: print(p.stage)); None")
    assert kernel.each("display_data", "data") == []
