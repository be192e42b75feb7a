"""What callers may ask of a render: overrides, and options that can't be met."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from small_scenes import studio

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"


@pytest.fixture(scope="module")
def box():
    return rt.load(BOX)


def assert_same(picture, other):
    assert picture.rgb.tobytes() == other.rgb.tobytes()
    assert picture.stderr.tobytes() == other.stderr.tobytes()


def test_a_path_a_dict_and_a_scene_are_all_drawn(box, monkeypatch):
    monkeypatch.chdir(ROOT / "scenes")  # mesh paths of a dict are relative to the current folder
    ask = {"size": (24, 24), "spp": 2}
    pictures = [rt.render(scene, **ask) for scene in (box, BOX, str(BOX), json.loads(BOX.read_text("utf-8")))]
    for picture in pictures[1:]:
        assert_same(pictures[0], picture)
        assert picture.provenance["scene_sha256"] == pictures[0].provenance["scene_sha256"]


def test_without_options_the_scene_has_its_wish():
    scene = studio()
    wish = scene.settings._replace(size=(20, 10), spp=3, seed=5, sampler="stratified", precision="float64")
    picture = rt.render(dataclasses.replace(scene, settings=wish))
    got = picture.provenance
    assert (got["size"], got["spp"], got["seed"]) == ("20x10", 3, 5)
    assert (got["sampler"], got["precision"], got["max_depth"]) == ("stratified", "float64", wish.max_depth)
    ask = {"size": (20, 10), "spp": 3, "seed": 5, "sampler": "stratified", "precision": "float64"}
    assert_same(picture, rt.render(scene, **ask))


def test_options_outrank_the_scene_and_stand_in_the_provenance(box):
    picture = rt.render(box, 2, (12, 9), 77, "float64", "independent")
    got = picture.provenance
    assert (got["spp"], got["size"], got["seed"]) == (2, "12x9", 77)
    assert (got["precision"], got["sampler"]) == ("float64", "independent")
    assert got["version"] == rt.__version__
    assert got["scene_sha256"] == box.sha256
    assert got["complete"] == 1
    assert box.settings.spp == 32  # the scene itself is left alone


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spp": 0}, r"spp: expected a number from 1 to 65536, got 0"),
        ({"spp": 1 << 17}, r"spp: expected a number from 1 to 65536, got 131072"),
        ({"seed": -1}, r"seed: expected a number from 0 to 4294967295, got -1"),
        ({"seed": 1 << 32}, r"seed: expected a number from 0 to 4294967295, got 4294967296"),
        ({"size": (0, 4)}, r"size: expected 1x1 to 65,536 pixels per side and 268,435,456 in all, got 0x4"),
        ({"size": (10**6, 10**6)}, r"size: expected 1x1 to"),
        ({"size": (65536, 65536)}, r"size: expected 1x1 to"),
        ({"precision": "float16"}, r"precision: expected one of auto, float32, float64, got 'float16'"),
        ({"sampler": "sobl"}, r"sampler: expected one of sobol, stratified, independent, got 'sobl'"),
        ({"aov": ("depth", "hight")}, r"aov: 'hight': expected any of depth, normal, albedo, prim_id, position"),
        ({"size": (8, 8), "crop": (0, 0, 9, 8)}, r"crop: 0,0,9,8 is not inside the film of 8x8 pixels"),
        ({"size": (8, 8), "crop": (-1, 0, 2, 2)}, r"crop: -1,0,2,2 is not inside"),
        ({"size": (8, 8), "crop": (2, 2, 0, 2)}, r"crop: 2,2,0,2 is not inside"),
    ],
)
def test_an_option_that_can_not_be_met_is_told_before_anything_is_drawn(box, options, message):
    events = []
    with pytest.raises(rt.OptionError, match=message):
        rt.render(box, progress=events.append, **options)
    assert events == []


def test_a_number_may_come_from_numpy(box, tmp_path):
    picture = rt.render(box, spp=np.int64(2), size=(np.int32(8), np.int64(8)), seed=np.uint32(3))
    assert_same(picture, rt.render(box, spp=2, size=(8, 8), seed=3))
    assert picture.save(tmp_path / "a.png").exists()


@pytest.mark.parametrize("options", [{"seed": 1.5}, {"spp": 2.5}, {"spp": True}, {"spp": "4"}, {"size": 8}])
def test_an_option_of_the_wrong_kind_is_told_too(box, options):
    with pytest.raises(rt.OptionError):
        rt.render(box, **{"size": (8, 8), "spp": 1, **options})


@pytest.mark.parametrize("threads", [0, -1])
def test_a_number_of_threads_that_can_not_be_is_told(box, threads):
    with pytest.raises(rt.OptionError, match="threads: expected a number of at least 1"):
        rt.render(box, size=(8, 8), spp=1, threads=threads)


@pytest.mark.parametrize("seconds", [float("nan"), -1])
def test_a_time_limit_that_is_no_time_is_told(box, seconds):
    with pytest.raises(rt.OptionError, match="time_limit: expected seconds"):
        rt.render(box, size=(8, 8), spp=1, time_limit=seconds)


@pytest.mark.parametrize("error", [0, -1e-3, 1, float("nan")])
def test_a_target_error_that_no_picture_has_is_told(box, error):
    with pytest.raises(rt.OptionError, match="target_error: expected an RMSE in sRGB, above 0 and below 1"):
        rt.render(box, size=(8, 8), target_error=error)


def test_one_layer_may_be_asked_for_by_a_plain_string(box):
    assert list(rt.render(box, size=(8, 8), spp=1, aov="depth").aov.computed) == ["depth"]
