"""``rt.show``: its names, what they cost, and what every drawing can do."""

import inspect
import sys
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.errors import FileError, OptionError, PackageError
from small_scenes import studio
from test_init import HEAVY, python

PACKAGE = Path(rt.__file__).parent / "show"
FUNCTIONS = {"bvh", "heatmap", "live", "path", "samples", "error", "convergence"}


def test_the_names_are_the_promised_ones():
    assert set(rt.show.__all__) == FUNCTIONS | {"Drawing"}
    assert set(rt.show.__all__) <= set(dir(rt.show))
    assert all(inspect.isfunction(getattr(rt.show, name)) for name in FUNCTIONS)
    with pytest.raises(AttributeError, match="no attribute 'bhv'"):
        _ = rt.show.bhv


@pytest.mark.parametrize("name", sorted(FUNCTIONS | {"Drawing"}))
def test_every_name_is_documented_with_an_example(name):
    assert ">>>" in inspect.getdoc(getattr(rt.show, name))


def test_no_file_has_the_name_of_a_function():
    assert not FUNCTIONS & {path.stem for path in PACKAGE.glob("*")}


def test_the_room_is_light_until_something_is_drawn():
    program = f"import sys, raytrace as rt; rt.show; print(*({HEAVY!r} & sys.modules.keys()))"
    assert python(program).split() == []


def test_no_window_system_is_asked_for():
    python(
        "import sys, raytrace as rt; rt.show.samples('sobol', 4)._repr_png_();"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )


@pytest.fixture(scope="module")
def drawing():
    return rt.show.samples("sobol", 16)


def test_it_shows_itself_in_a_notebook_as_a_png_for_fine_screens(drawing):
    data, size = drawing._repr_png_()
    width, height = (int.from_bytes(data[k : k + 4], "big") for k in (16, 20))
    assert data.startswith(b"\x89PNG")
    assert (width, height) == (2 * size["width"], 2 * size["height"])


@pytest.mark.parametrize(("name", "begin"), [("a.png", b"\x89PNG"), ("new/a.SVG", b"<?xml")])
def test_it_saves_itself_whole(tmp_path, drawing, name, begin):
    path = drawing.save(tmp_path / name)
    assert path == tmp_path / name
    assert path.read_bytes().startswith(begin)
    assert [other.name for other in path.parent.iterdir() if other.is_file()] == [path.name]


def test_the_same_drawing_gives_the_same_bytes(drawing):
    for kind in ("png", "svg"):
        assert drawing.encode(kind) == rt.show.samples("sobol", 16).encode(kind)


def test_an_ending_that_is_not_known_is_told(tmp_path, drawing):
    with pytest.raises(FileError, match=r"a\.pdf: unknown kind of drawing '\.pdf'; use \.png or \.svg"):
        drawing.save(tmp_path / "a.pdf")


def test_without_matplotlib_the_message_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(PackageError, match="pip install matplotlib scikit-image"):
        rt.show.samples("sobol", 16)


@pytest.mark.parametrize(
    "call",
    [
        lambda: rt.show.samples("sobol", 0),
        lambda: rt.show.samples("sobol", 1025),
        lambda: rt.show.samples("halton", 4),
        lambda: rt.show.samples("sobol", 4, pixel=(-1, 0)),
        lambda: rt.show.bvh(studio(), depth=-1),
        lambda: rt.show.bvh(studio(), depth=1.5),
        lambda: rt.show.path(studio(), (48, 0)),
        lambda: rt.show.path(studio(), (0, 0), sample=-1),
        lambda: rt.show.heatmap(studio(), (0, 4)),
    ],
)
def test_what_can_not_be_drawn_is_told_in_a_line(call):
    with pytest.raises(OptionError) as told:
        call()
    assert "\n" not in str(told.value)


def test_a_split_that_is_not_known_is_told():
    with pytest.raises(ValueError, match="split: expected one of sah, median, got 'best'"):
        rt.show.heatmap(studio(), (4, 4), split="best")


def test_labels_do_not_leave_the_sheet():
    figure = rt.show.heatmap(studio(), (24, 16)).figure
    figure.draw_without_rendering()
    width, height = figure.get_size_inches() * figure.dpi
    for axes in figure.axes:
        box = axes.get_tightbbox()
        assert np.all([box.x0 >= -1, box.y0 >= -1, box.x1 <= width + 1, box.y1 <= height + 1])
