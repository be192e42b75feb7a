"""``raytrace view``: the viewer as a web page, by its requests; and in a real Chromium, where there is one."""

import base64
import io
import json
import re
import threading
import urllib.error
import urllib.request
import webbrowser
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import raytrace as rt
from browser import ROOT, _chromium, a_page
from raytrace.cli import main, viewing
from raytrace.image.files import srgb8
from raytrace.jit import PLAIN
from raytrace.show import page_server
from raytrace.show.page_model import PageModel
from raytrace.show.page_server import PageServer
from raytrace.show.prepared_scene import prepare_scene

FILE = "scenes/cornell-box-glass.json"
WIDTH, HEIGHT = 24, 18


@pytest.fixture(scope="module")
def scene():
    return rt.load(FILE)


@contextmanager
def served(model):
    with PageServer(model, "a <box>") as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture
def server(scene):
    model = PageModel(prepare_scene(scene, (WIDTH, HEIGHT)), 4)
    with served(model) as server:
        server.model = model
        yield server


def ask(address, name="", body=None, **headers):
    """Status, headers and body of an answer."""
    request = urllib.request.Request(address + name, data=body, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=600) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read()


def change(server, **values):
    status, _, text = ask(server.address, "change", json.dumps(values).encode())
    return status, text.decode()


def messages(server, after=0):
    """What the page gets, one message after the other."""
    while True:
        status, _, body = ask(server.address, f"next?after={after}")
        assert status == 200
        end = 4 + int.from_bytes(body[:4], "big")
        text = json.loads(body[4:end])
        after = text["number"]
        yield text["content"], body[end:]


def final(server):
    """The first image with all samples, (h, w, 3)."""
    return next(pixels(data) for content, data in messages(server) if content.get("type") == "image/png")


def pixels(data):
    return np.asarray(Image.open(io.BytesIO(data)))[..., :3]


# The server -----------------------------------------------------------------------------------------------------------


def test_the_page_and_its_files_are_there(server):
    status, headers, body = ask(server.address)
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert b"a &lt;box&gt;" in body
    for name in re.findall(r'(?:href|src)="([^"]+)"', body.decode()):
        assert ask(server.address, name)[2] == (ROOT / "raytrace" / "show" / name).read_bytes()
    assert b'from "./widget.js"' in ask(server.address, "page.js")[2]


@pytest.mark.parametrize("body", [None, b"{}"], ids=["get", "post"])
def test_nothing_is_there_without_the_secret_path_or_for_another_host(server, body):
    root = f"http://127.0.0.1:{server.server_port}/"
    wrong = [(root, {}), (server.address[:-2] + "/", {}), (server.address, {"Host": "raytrace.example"})]
    for address, headers in wrong:
        for name in ("", "state", "change", "widget.js"):
            assert ask(address, name, body, **headers)[0] == 404
    assert ask(server.address, "../widget.py")[0] == 404
    assert ask(server.address, "next?after=x")[0] == 404


def test_it_listens_to_this_computer_only_and_at_a_path_of_its_own(server, scene):
    assert server.server_address[0] == "127.0.0.1"
    with served(PageModel(prepare_scene(scene, (2, 2)), 1)) as other:
        assert other.root != server.root
        assert len(other.root) > 20


def test_the_page_asks_no_other_computer_for_anything(server):
    text = (ROOT / "raytrace" / "show" / "page.js").read_text("utf-8") + page_server.PAGE
    assert not re.search(r"https?:|//(?! )|@import|url\(|eval\(", text)
    assert "default-src 'none'" in ask(server.address)[1]["Content-Security-Policy"]


def test_a_request_for_news_comes_back_without_any(server, monkeypatch):
    monkeypatch.setattr(page_server, "PATIENCE", 0.0)
    status, headers, body = ask(server.address, "next?after=0")
    assert (status, headers.get("Content-Length"), body) == (204, None, b"")


# The values -----------------------------------------------------------------------------------------------------------


def test_the_page_has_every_value_that_a_notebook_has(server):
    widget = pytest.importorskip("raytrace.show.widget", reason="needs anywidget")
    own = set(widget.Viewer.class_trait_names(sync=True)) - set(widget.AnyWidget.class_trait_names(sync=True))
    own = {name for name in own if not name.startswith("_")}
    state = json.loads(ask(server.address, "state")[2])
    assert own == state.keys()
    viewer = rt.show.live(FILE, size=(WIDTH, HEIGHT), spp=4)
    assert state == {name: getattr(viewer, name) for name in own}


@pytest.mark.filterwarnings("ignore::raytrace.errors.SceneWarning")  # of walls seen from behind
def test_a_change_renders_an_image_with_the_bits_of_render(server):
    assert change(server, azimuth=30, distance=0.9, power=2, ior={"pane": 0.7}, spp=8, turn=1) == (204, "")
    edited = rt.show.live(FILE, size=(WIDTH, HEIGHT), spp=8)
    edited.azimuth, edited.distance, edited.power, edited.ior = 30.0, 0.9, 2.0, {"pane": 0.7}
    np.testing.assert_array_equal(final(server), srgb8(rt.render(edited.scene).rgb))
    content, _ = next(messages(server))
    assert (content["kind"], content["samples"], content["turn"]) == ("frame", 8, 1)


def test_a_page_can_ask_for_an_image_and_for_a_path(server):
    assert ask(server.address, "send", b'{"kind": "render"}')[0] == 204
    assert final(server).shape == (HEIGHT, WIDTH, 3)
    assert ask(server.address, "send", b'{"kind": "path", "pixel": [12, 9]}')[0] == 204
    content = next(content for content, _ in messages(server) if content["kind"] == "path")
    assert "sample 0 of pixel (12, 9)" in content["html"]
    assert ask(server.address, "send", b'{"kind": "path", "pixel": [99, 9]}')[0] == 204
    content = next(content for content, _ in messages(server) if content["kind"] == "error")
    assert content["text"] == "pixel: expected a number from 0 to 23, got 99"


def test_a_new_page_gets_no_messages_of_an_older_one(server):
    assert ask(server.address, "send", b'{"kind": "path", "pixel": [99, 9]}')[0] == 204
    assert next(messages(server))[0]["kind"] == "error"
    assert ask(server.address, "send", b'{"kind": "render"}')[0] == 204
    assert next(messages(server))[0]["kind"] == "frame"


@pytest.mark.parametrize(
    "values",
    [
        {"ior": {"glas": 1.5}},
        {"ior": {"pane": 0}},
        {"ior": 1.5},
        {"spp": 0},
        {"spp": "4"},
        {"turn": -1},
        {"scale": 0},
        {"light_positions": [[0, 1]]},
        {"light_positions": [[0, 1, float("inf")]]},
        {"distance": 0},
        {"power": -1},
        {"azimuth": float("nan")},
        {"azimuth": True},
        {"azimuth": 5, "elevation": None},
        {"size": [9, 9]},
        {"scene": "other.json"},
    ],
    ids=str,
)
def test_values_that_cannot_be_are_refused_in_a_line_and_change_nothing(server, values):
    before = dict(server.model.state)
    status, text = change(server, **values)
    assert (status, len(text.splitlines())) == (400, 1)
    assert server.model.state == before


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b"[" * 9000, b" " * (page_server.MOST + 1)])
def test_requests_that_cannot_be_are_refused(server, body):
    assert ask(server.address, "send", body)[0] == 400


# The command ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def opened(monkeypatch):
    """Addresses for which a browser was asked; Ctrl-C comes at once."""
    opened = []

    def interrupt(_server):
        raise KeyboardInterrupt

    monkeypatch.setattr(PageServer, "serve_forever", interrupt)
    monkeypatch.setattr(viewing.webbrowser, "open", lambda address: opened.append(address) or True)
    monkeypatch.setenv("DISPLAY", ":0")
    return opened


def test_view_opens_a_browser_and_ends_well_with_ctrl_c(opened, capsys):
    assert main.main(["view", FILE, "--size", "4x3", "--spp", "2"]) == 0
    out, err = capsys.readouterr()
    assert out == f"{opened[0]}\n"
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{16,}/", opened[0])
    assert err.splitlines()[-1] == "Ctrl-C ends the viewer"


def test_view_shows_a_mesh(opened, tmp_path, capsys):
    path = tmp_path / "triangle.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main.main(["view", str(path), "--size", "4x3", "--no-browser"]) == 0
    assert not opened
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")


def test_where_no_browser_is_the_address_is_enough(opened, monkeypatch, capsys):
    def none(_address):
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(viewing.webbrowser, "open", none)
    assert main.main(["view", FILE, "--size", "4x3"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("http://127.0.0.1:")
    assert err.startswith("no browser was found here: open the address in one")


def test_without_a_window_no_browser_of_the_terminal_is_opened(opened, monkeypatch, capsys):
    monkeypatch.setattr(viewing.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    assert main.main(["view", FILE, "--size", "4x3"]) == 0
    assert not opened
    assert "no browser was found here" in capsys.readouterr().err


def test_ctrl_c_before_the_page_opens_is_an_interrupt(opened, monkeypatch, capsys):
    image = rt.render(FILE, spp=1, size=(2, 2))
    monkeypatch.setattr(rt, "render", lambda *_args, **_options: replace(image, interrupted=True))
    assert main.main(["view", FILE, "--size", "4x3"]) == 130
    assert capsys.readouterr().out == ""
    assert not opened


def test_the_default_size_is_the_scene_s_made_smaller(scene):
    assert viewing._smaller(rt.load("scenes/room.json")) == (512, 384)
    assert viewing._smaller(scene) == tuple(scene.settings.size)


def test_view_fails_as_other_commands_do(capsys):
    assert main.main(["view", "nowhere.json"]) == 4
    assert main.main(["view", FILE, "--size", "999999x4"]) == 2
    for words in (["view", FILE, "--spp", "999999"], ["view"]):
        with pytest.raises(SystemExit, match="2"):
            main.main(words)
    assert capsys.readouterr().out == ""


# In a browser ---------------------------------------------------------------------------------------------------------


def test_the_page_works_in_a_browser(scene):
    if PLAIN or not _chromium():
        pytest.skip("kernels are plain functions" if PLAIN else "needs a Chromium")
    model = PageModel(prepare_scene(scene, (WIDTH, HEIGHT)), 4)
    numbers, wait = [], model.message_after
    model.message_after = lambda number, seconds: numbers.append(number) or wait(number, seconds)
    with served(model) as server, a_page() as page:
        page.goto(server.address)
        canvas = page.locator(".raytrace-viewer canvas[data-type='image/png']")
        canvas.wait_for()
        canvas.focus()
        page.keyboard.press("ArrowRight")
        page.locator(".raytrace-viewer canvas[data-type='image/png'][data-turn='1']").wait_for()
        data = page.evaluate("document.querySelector('canvas').toDataURL()").partition(",")[2]
        np.testing.assert_array_equal(pixels(base64.b64decode(data)), srgb8(rt.render(model.scene()).rgb))
        assert model.state["azimuth"] == 5.0
        assert len(set(numbers)) == len(numbers)  # no message twice
        assert page.elsewhere == []
