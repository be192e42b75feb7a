"""``rt.show.live``: the widget's Python side by itself, and the whole in JupyterLab in a real Chromium."""

import base64
import io
import re
import sys
import time

import numpy as np
import pytest
import traitlets
from PIL import Image

import raytrace as rt
from browser import ROOT, a_lab, a_page, run_all, why_not, write_notebook
from kernels import a_kernel
from raytrace.errors import OptionError, PackageError
from raytrace.image.files import srgb8
from raytrace.image.png import SIGNATURE
from raytrace.jit import PLAIN
from small_scenes import studio
from test_init import python

FILE = "scenes/cornell-box-glass.json"


@pytest.fixture
def viewer(monkeypatch):
    made = rt.show.live(FILE, size=(40, 30), spp=4)
    made.sent = []
    monkeypatch.setattr(made, "send", lambda content, buffers=None: made.sent.append((content, buffers)))
    return made


def until(done):
    limit = time.monotonic() + 600
    while not done():
        assert time.monotonic() < limit
        time.sleep(0.005)


def test_it_begins_with_the_scene_as_it_is(viewer):
    scene = viewer.scene
    assert scene.sha256 == rt.load(FILE).sha256
    assert (scene.settings.size, scene.settings.spp) == ((40, 30), 4)
    assert viewer.ior == {"pane": 0.5}
    assert repr(viewer) == "<Viewer of cornell-box-glass: 40x30, 4 spp>"


def test_the_film_is_the_scene_s_made_smaller():
    assert rt.show.live("scenes/room.json").size == [256, 192]
    assert rt.show.live(studio()).size == list(studio().settings.size)
    assert rt.show.live(FILE, size=(300, 200)).size == [300, 200]


def test_turning_a_knob_draws_the_picture(viewer):
    viewer.power = 2.0
    until(lambda: viewer.sent and viewer.sent[-1][0]["type"] == "image/png")
    content, (data,) = viewer.sent[-1]
    assert len(content.pop("handles")) == 1  # of the light
    assert content == {"kind": "frame", "type": "image/png", "samples": 4, "turn": 0}
    np.testing.assert_array_equal(pixels(data), srgb8(rt.render(viewer.scene).rgb))


def pixels(data):
    return np.asarray(Image.open(io.BytesIO(data)))


def test_the_browser_can_ask_for_a_picture_and_for_a_path(viewer):
    viewer._receive(viewer, {"kind": "render"}, [])
    until(lambda: viewer.sent and viewer.sent[-1][0].get("type") == "image/png")
    viewer._receive(viewer, {"kind": "path", "pixel": [20, 15]}, [])
    content, _ = viewer.sent[-1]
    assert content["kind"] == "path"
    assert "sample 0 of pixel (20, 15)" in content["html"]
    viewer._receive(viewer, {"kind": "path", "pixel": [40, 15]}, [])
    assert viewer.sent[-1][0] == {"kind": "error", "text": "pixel: expected a number from 0 to 39, got 40"}


def test_at_rest_there_is_a_pixel_for_each_of_the_screen_after_a_small_image(viewer):
    viewer.scale = 3
    until(lambda: viewer.sent and viewer.sent[-1][0]["type"] == "image/png")
    (first, (small,)), (_, (large,)) = viewer.sent[0], viewer.sent[-1]
    assert (first["type"], first["samples"], pixels(small).shape) == ("image/jpeg", 1.0, (30, 40, 3))
    np.testing.assert_array_equal(pixels(large), srgb8(rt.render(FILE, size=(120, 90), spp=4).rgb))
    assert viewer.scene.settings.size == (120, 90)


def test_knobs_refuse_nonsense_in_a_line(viewer):
    wrong = [("ior", {"glas": 1.5}), ("ior", {"pane": 0.0}), ("ior", {"pane": float("nan")})]
    for name, value in (*wrong, ("power", -1.0), ("spp", 0), ("distance", 0.0)):
        with pytest.raises(traitlets.TraitError) as told:
            setattr(viewer, name, value)
        assert "\n" not in str(told.value)
    assert viewer.ior == {"pane": 0.5}
    viewer.ior = {}
    assert viewer.ior == {"pane": 0.5}


def test_what_can_not_be_shown_is_told():
    with pytest.raises(OptionError, match=r"size: expected .*got 0x3"):
        rt.show.live(FILE, size=(0, 3))
    with pytest.raises(OptionError, match="spp: expected"):
        rt.show.live(FILE, spp=0)


def test_without_anywidget_the_message_names_the_package(monkeypatch):
    monkeypatch.delitem(sys.modules, "raytrace.show.widget", raising=False)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(PackageError, match="pip install anywidget"):
        rt.show.live(FILE)


def test_nothing_of_widgets_is_imported_before_one_is_wanted():
    python("import sys, raytrace as rt; rt.show.live; assert not {'anywidget', 'ipywidgets'} & sys.modules.keys()")


def test_where_widgets_do_not_run_there_is_a_picture(viewer):
    data, _ = viewer._repr_mimebundle_()
    np.testing.assert_array_equal(pixels(data["image/png"]), srgb8(rt.render(viewer.scene).rgb))
    assert data["application/vnd.jupyter.widget-view+json"]["model_id"] == viewer.model_id
    assert data["text/plain"] == repr(viewer)


def test_the_browser_s_half_fetches_nothing():
    for name in ("widget.js", "widget.css"):
        text = (ROOT / "raytrace" / "show" / name).read_text("utf-8")
        assert not re.search(r"https?:|import |@import|url\(|fetch\(|eval\(", text)


def test_a_notebook_that_nobody_looks_at_keeps_a_picture():
    if PLAIN:
        pytest.skip("kernels are plain functions")
    with a_kernel() as kernel:
        kernel.run(f"import raytrace as rt; rt.show.live({FILE!r}, size=(40, 30))")
        (data,) = kernel.each("execute_result", "data")
        assert base64.b64decode(data["image/png"]).startswith(SIGNATURE)


# In a browser ---------------------------------------------------------------------------------------------------------

CELL = f"""\
import os, raytrace as rt
os.chdir({str(ROOT)!r})
viewer = rt.show.live("scenes/glass-sphere.json", spp=16)
viewer
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    reason = "kernels are plain functions" if PLAIN else why_not()
    if reason:
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("lab")
    write_notebook(folder / "live.ipynb", [CELL])
    with a_lab(folder) as lab, a_page() as page:
        run_all(page, lab.format("live.ipynb"))
        rest(page)
        yield page


def canvas(page):
    return page.locator(".raytrace-viewer canvas")


def rest(page):
    """Wait until the picture has all its samples."""
    page.locator(".raytrace-viewer canvas[data-type='image/png']").wait_for()


def moved(page, act):
    """Do something; wait until the picture has changed, and rests again."""
    before = canvas(page).get_attribute("data-turn")
    act()
    page.wait_for_function(
        "before => { const c = document.querySelector('.raytrace-viewer canvas');"
        "return c.dataset.turn !== before && c.dataset.type === 'image/png'; }",
        arg=before,
    )


def shown(page):
    """What the canvas shows, (h, w, 3)."""
    address = page.evaluate("document.querySelector('.raytrace-viewer canvas').toDataURL()")
    return pixels(base64.b64decode(address.partition(",")[2]))[..., :3]


def expected(**edits):
    twin = rt.show.live("scenes/glass-sphere.json", spp=16)
    twin.scale = 2  # 512 pixels of the screen, 256 of the moving image
    for name, value in edits.items():
        setattr(twin, name, value)
    return srgb8(rt.render(twin.scene).rgb)


def label(page, text):
    return page.locator(".raytrace-viewer").get_by_label(text)


def test_the_picture_at_rest_has_the_bits_of_render(page):
    np.testing.assert_array_equal(shown(page), expected())
    status = page.locator(".raytrace-viewer .status").text_content()
    assert status == "16 samples per pixel, 512 \N{MULTIPLICATION SIGN} 512"


def test_there_is_a_slider_for_light_each_glass_and_samples(page):
    names = page.locator(".raytrace-viewer label").all_text_contents()
    assert [re.sub(r"\W*[\d.]+$", "", name) for name in names] == [
        "light",
        "index of glass",
        "index of air",
        "samples per pixel",
        "hide walls seen from behind",
    ]


def test_sliders_do_what_they_say(page):
    moved(page, lambda: label(page, "index of glass").fill("1.8"))
    np.testing.assert_array_equal(shown(page), expected(ior={"glass": 1.8}))
    moved(page, lambda: label(page, "light").fill("1"))
    np.testing.assert_array_equal(shown(page), expected(ior={"glass": 1.8}, power=2.0))
    moved(page, lambda: label(page, "samples").fill("3"))
    np.testing.assert_array_equal(shown(page), expected(ior={"glass": 1.8}, power=2.0, spp=8))
    moved(page, lambda: label(page, "samples").fill("4"))
    moved(page, lambda: page.get_by_role("button", name="Reset").click())
    np.testing.assert_array_equal(shown(page), expected())


def test_keys_and_the_wheel_turn_and_zoom(page):
    canvas(page).focus()
    moved(page, lambda: page.keyboard.press("ArrowRight"))
    np.testing.assert_array_equal(shown(page), expected(azimuth=5.0))
    moved(page, lambda: page.keyboard.press("ArrowUp"))
    np.testing.assert_array_equal(shown(page), expected(azimuth=5.0, elevation=5.0))
    canvas(page).hover()
    moved(page, lambda: page.mouse.wheel(0, 200))
    np.testing.assert_array_equal(shown(page), expected(azimuth=5.0, elevation=5.0, distance=np.exp(0.3)))
    moved(page, lambda: page.get_by_role("button", name="Reset").click())


def test_dragging_turns_the_scene_while_the_hand_moves(page):
    box = canvas(page).bounding_box()
    x, y = box["x"] + 100, box["y"] + 100
    frames = int(canvas(page).get_attribute("data-frames"))
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 41):
        page.mouse.move(x + 2 * k, y + k)
        page.wait_for_timeout(20)
    seen = int(canvas(page).get_attribute("data-frames")) - frames
    page.mouse.up()
    page.wait_for_timeout(500)
    rest(page)
    assert seen > 5
    assert not np.array_equal(shown(page), expected())
    moved(page, lambda: page.get_by_role("button", name="Reset").click())
    np.testing.assert_array_equal(shown(page), expected())


def test_a_click_shows_the_path_of_that_pixel(page):
    box = canvas(page).bounding_box()
    page.mouse.click(box["x"] + 2 * 90 + 1, box["y"] + 2 * 180 + 1)
    page.locator(".raytrace-viewer .path table").first.wait_for()
    html = page.locator(".raytrace-viewer .path").inner_html()
    assert "sample 0 of pixel (181, 361)" in html
    assert page.locator(".raytrace-viewer .mark").is_visible()
    own = rt.show.path(rt.show.live("scenes/glass-sphere.json").scene, (181, 361), size=(512, 512))
    assert own.steps.path[0].event in html


def test_the_page_asks_no_other_machine_for_anything(page):
    assert page.elsewhere == []
