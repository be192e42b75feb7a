"""The thread that draws what was wanted last."""

import io
import threading
import time

import numpy as np
import pytest
from PIL import Image

import raytrace as rt
from raytrace.errors import OptionError, SceneWarning
from raytrace.image.files import srgb8
from raytrace.show import background_renderer
from raytrace.show.background_renderer import BackgroundRenderer
from raytrace.show.prepared_scene import prepare_scene
from raytrace.show.scene_edits import SceneEdits, edited
from small_scenes import studio

SIZE = (64, 48)


class Desk:
    """Wants pictures, and keeps what comes."""

    def __init__(self, spp):
        self.prepared, self.edits = prepare_scene(studio(), SIZE), SceneEdits(spp=spp)
        self.frames, self.errors, self.made = [], [], []
        self.done = threading.Event()
        self.renderer = BackgroundRenderer(self.make, self.take, self.errors.append)

    def make(self):
        self.made.append(self.edits)
        return edited(self.prepared, self.edits)

    def take(self, frame):
        self.frames.append((self.made[-1], frame))
        if frame.kind == "image/png":
            self.done.set()

    def wait(self):
        assert self.done.wait(120)
        limit = time.monotonic() + 600
        while any(thread.name == "raytrace-viewer" for thread in threading.enumerate()):
            assert time.monotonic() < limit
            time.sleep(0.01)


def pixels(frame):
    return np.asarray(Image.open(io.BytesIO(frame.data))).astype(int)


def test_a_rough_picture_first_and_the_whole_one_at_last(monkeypatch):
    monkeypatch.setattr(background_renderer, "PAUSE", 0.0)
    monkeypatch.setattr(background_renderer, "GRACE", 0.0)
    desk = Desk(64)
    desk.renderer.request()
    desk.wait()
    frames = [frame for _, frame in desk.frames]
    assert [frame.kind for frame in frames[:-1]] == ["image/jpeg"] * (len(frames) - 1)
    assert frames[0].samples == 1
    assert [frame.samples for frame in frames] == sorted(frame.samples for frame in frames)
    assert frames[-1].samples == 64
    right = srgb8(rt.render(edited(desk.prepared, desk.edits)).rgb)
    np.testing.assert_array_equal(pixels(frames[-1]), right)
    errors = [np.abs(pixels(frame) - right).mean() for frame in frames]
    assert errors[0] < 25  # of 255: one sample a pixel, and JPEG
    assert errors[-2] < errors[0]


def test_what_nobody_wants_any_more_is_dropped():
    desk = Desk(65536)  # would take minutes
    desk.renderer.request()
    while not desk.frames:
        time.sleep(0.001)
    desk.edits = SceneEdits(spp=2, power=3.0)
    began = time.monotonic()
    desk.renderer.request()
    desk.wait()
    assert time.monotonic() - began < 300
    assert desk.made[-1] is desk.frames[-1][0] is desk.edits
    assert desk.frames[-1][1].samples == 2


def test_a_hand_that_never_rests_sees_pictures_all_the_same():
    desk = Desk(64)
    stop = threading.Event()

    def hand():
        while not stop.wait(0.001):  # more often than any picture is drawn
            desk.edits = desk.edits._replace(azimuth=desk.edits.azimuth + 1)
            desk.renderer.request()

    moving = threading.Thread(target=hand)
    moving.start()
    limit = time.monotonic() + 600
    while len(desk.frames) < 5 and time.monotonic() < limit:
        time.sleep(0.001)
    stop.set()
    moving.join()
    desk.wait()
    assert len(desk.frames) >= 5
    assert desk.made[-1] == desk.edits  # the last one is never forgotten


def test_what_is_wrong_with_a_scene_is_told_and_the_next_one_drawn():
    desk = Desk(1)
    make = desk.renderer._make

    def wrong():
        desk.renderer._make = make
        raise OptionError("nothing to see")

    desk.renderer._make = wrong
    desk.renderer.request()
    while not desk.errors:
        time.sleep(0.001)
    desk.renderer.request()
    desk.wait()
    assert [str(error) for error in desk.errors] == ["nothing to see"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_mistake_of_ours_is_told_and_the_next_picture_drawn_all_the_same():
    desk = Desk(1)
    make, desk.renderer._make = desk.renderer._make, lambda: 1 / 0
    desk.renderer.request()
    while not desk.errors:
        time.sleep(0.001)
    desk.renderer._make = make
    desk.renderer.request()
    desk.wait()
    assert [str(error) for error in desk.errors] == ["division by zero"]


@pytest.mark.parametrize("spp", [1, 3])
def test_few_samples_are_enough(spp):
    desk = Desk(spp)
    desk.renderer.request()
    desk.wait()
    assert desk.frames[-1][1].samples == spp


def test_a_camera_behind_a_wall_is_no_cause_to_warn():
    """A warning in this thread would be an exception where warnings are errors, as in these tests."""
    scene = rt.load("scenes/cornell-box.json").replace(camera={"position": [9, 1, 0], "look_at": [0, 1, 0], "fov": 20})
    scene = scene.replace(film={"size": [32, 24]}, render={"spp": 1})
    done, errors = threading.Event(), []
    BackgroundRenderer(lambda: scene, lambda _: done.set(), errors.append).request()
    assert done.wait(120)
    limit = time.monotonic() + 600
    while any(thread.name == "raytrace-viewer" for thread in threading.enumerate()):
        assert time.monotonic() < limit
        time.sleep(0.01)
    assert errors == []
    with pytest.warns(SceneWarning, match="show its back"):
        rt.render(rt.load("scenes/cornell-box.json"), camera=scene.camera, size=(32, 24), spp=1)
