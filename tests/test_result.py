"""``Render``: its layers against every triangle of the scene, its files, and how it shows itself."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import naive
import raytrace as rt
from raytrace.image import files
from raytrace.rendering import result
from raytrace.rendering.result import LAYERS
from small_scenes import Part, look, make_scene, quad, studio

BOX = Path(__file__).parents[1] / "scenes" / "cornell-box.json"
SHAPES = {"depth": (), "normal": (3,), "albedo": (3,), "prim_id": (), "position": (3,), "samples": ()}
WHOLE = ("prim_id", "samples")


@pytest.fixture
def drawn():
    return rt.render(BOX, spp=3, size=(20, 14), seed=6)


def truth(scene, size):
    """Layers of the film by trying every triangle on the rays through the pixels' centres."""
    width, height = size
    y, x = np.mgrid[0:height, 0:width] + 0.5
    o, d = naive.camera_rays(scene.camera, size, np.stack([x, y], axis=-1).reshape(-1, 2))
    hits = naive.closest_hit(scene.mesh.vertices, scene.mesh.faces, o, d)
    missed = hits.prim_id < 0
    _, _, _, normal = naive.surface(scene.mesh, hits._replace(prim_id=np.maximum(hits.prim_id, 0)))
    albedo = scene.materials.albedo[scene.mesh.material_id[np.maximum(hits.prim_id, 0)]]
    position = o + np.where(missed, np.nan, hits.t)[:, None] * d
    normal[missed], albedo[missed] = 0, 0
    layers = {"depth": hits.t, "normal": normal, "albedo": albedo, "prim_id": hits.prim_id, "position": position}
    return {name: layer.reshape(height, width, *layer.shape[1:]) for name, layer in layers.items()}, missed


# Layers ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_layers_are_those_of_the_rays_through_the_pixels_centres(precision):
    scene, size = studio(), (70, 50)
    expected, missed = truth(scene, size)
    aov = rt.render(scene, size=size, spp=1, precision=precision).aov
    assert 0.05 < missed.mean() < 0.95
    same = aov["prim_id"] == expected["prim_id"]
    assert same.all() if precision == "float64" else same.mean() > 0.995
    scale = {"float32": 1e-5, "float64": 2e-7}[precision]  # the layers themselves are float32: 6e-8 of up to 7
    for name in ("depth", "normal", "albedo", "position"):
        np.testing.assert_allclose(aov[name][same], expected[name][same], rtol=scale, atol=scale, err_msg=name)
    glass = scene.mesh.material_id[np.maximum(expected["prim_id"], 0)] >= 5
    assert (glass & (expected["prim_id"] >= 0)).any()  # the first surface, refractive ones included
    np.testing.assert_allclose(np.linalg.norm(aov["normal"][aov["prim_id"] >= 0], axis=-1), 1, atol=1e-6)


def test_flat_meshes_have_the_normals_of_their_triangles(drawn):
    expected, _ = truth(rt.load(BOX), (20, 14))
    np.testing.assert_allclose(drawn.aov["normal"], expected["normal"], atol=1e-6)
    np.testing.assert_allclose(drawn.aov["depth"], expected["depth"], rtol=1e-6)


def test_a_miss_looks_as_the_conventions_say():
    tiny = Part(quad((-0.1, -0.1, 0), (0.1, -0.1, 0), (0.1, 0.1, 0), (-0.1, 0.1, 0)), albedo=(0.5, 0.25, 0.125))
    aov = rt.render(make_scene([tiny], camera=look((0, 0, 5), (0, 0, 0))), size=(9, 7), spp=1).aov
    corner, centre = (0, 0), (3, 4)
    assert aov["depth"][corner] == np.inf
    assert aov["prim_id"][corner] == -1
    assert np.isnan(aov["position"][corner]).all()
    assert not aov["normal"][corner].any()
    assert not aov["albedo"][corner].any()
    assert aov["depth"][centre] == 5
    assert aov["prim_id"][centre] in (0, 1)
    assert aov["position"][centre].tolist() == [0, 0, 0]
    assert aov["normal"][centre].tolist() == [0, 0, 1]
    assert aov["albedo"][centre].tolist() == [0.5, 0.25, 0.125]


def test_there_are_all_layers_of_the_documented_kinds(drawn):
    assert tuple(drawn.aov) == LAYERS == tuple(SHAPES)
    assert len(drawn.aov) == 6
    for name, layer in drawn.aov.items():
        assert layer.shape == (14, 20, *SHAPES[name])
        assert layer.dtype == (np.int32 if name in WHOLE else np.float32)


def test_layers_are_computed_when_asked_for_and_once(monkeypatch):
    calls, trace_layers = [], result.trace_layers
    monkeypatch.setattr("raytrace.rendering.run.trace_layers", lambda *args: calls.append(args) or trace_layers(*args))
    drawn = rt.render(BOX, spp=1, size=(12, 8))
    assert (drawn.aov["samples"] == 1).all()
    assert (calls, len(drawn.aov), list(drawn.aov)) == ([], 6, list(LAYERS))
    assert list(drawn.aov.computed) == ["samples"]
    assert drawn.aov["depth"] is drawn.aov["depth"]
    assert drawn.aov["normal"].shape == (8, 12, 3)
    assert len(calls) == 1
    assert list(drawn.aov.computed) == ["samples", "depth", "normal"]


def test_to_ask_whether_there_is_a_layer_computes_nothing(drawn):
    assert "depth" in drawn.aov
    assert drawn.aov.computed == {}


def test_layers_asked_for_in_the_call_are_there():
    drawn = rt.render(BOX, spp=1, size=(8, 8), aov=("depth", "prim_id"))
    assert list(drawn.aov.computed) == ["depth", "prim_id"]


def test_an_unknown_layer_is_told(drawn):
    with pytest.raises(KeyError, match=r"'deep': expected one of depth, normal, albedo, prim_id, position, samples"):
        drawn.aov["deep"]
    assert "deep" not in drawn.aov


def test_layers_do_not_depend_on_how_many_rows_are_traced_at_a_time(monkeypatch):
    scene = studio()
    before = rt.render(scene, spp=1, size=(33, 21)).aov
    monkeypatch.setattr(result, "ROWS", 2)
    after = rt.render(scene, spp=1, size=(33, 21)).aov
    for name in LAYERS:
        np.testing.assert_array_equal(before[name], after[name])


# Files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["exr", "npz"])
def test_a_file_holds_the_picture_its_error_and_the_layers_asked_for(drawn, ending, tmp_path):
    if ending == "exr":
        pytest.importorskip("OpenEXR")
    for name in ("depth", "position", "prim_id", "samples"):
        drawn.aov[name]
    path = drawn.save(tmp_path / f"box.{ending}")
    assert path == tmp_path / f"box.{ending}"
    kept = files.load(path)
    np.testing.assert_array_equal(kept.rgb, drawn.rgb)
    np.testing.assert_array_equal(kept.stderr, drawn.stderr)
    np.testing.assert_array_equal(kept.var, drawn.var)
    assert set(kept.aov) == {"depth", "position", "prim_id", "samples"}
    for name, layer in kept.aov.items():
        np.testing.assert_array_equal(layer, drawn.aov[name])
        assert layer.dtype == drawn.aov[name].dtype
    assert kept.provenance == drawn.provenance


@pytest.mark.parametrize("ending", ["exr", "npz"])
def test_layers_that_nobody_asked_for_are_not_stored(drawn, ending, tmp_path):
    if ending == "exr":
        pytest.importorskip("OpenEXR")
    assert files.load(drawn.save(tmp_path / f"box.{ending}")).aov == {}


def test_a_png_holds_srgb_and_provenance(drawn, tmp_path):
    path = drawn.save(tmp_path / "box.png", exposure=1.0)
    pixels = np.asarray(Image.open(path))
    np.testing.assert_array_equal(pixels, files.srgb8(drawn.rgb, 1.0))
    kept = files.load(path)
    assert kept.provenance == drawn.provenance
    assert np.abs(kept.rgb - drawn.rgb)[drawn.rgb < 0.5].max() < 0.005  # half of one step of 8 bits


def test_a_wrong_ending_is_told(drawn, tmp_path):
    with pytest.raises(rt.FileError, match=r"box\.jpg"):
        drawn.save(tmp_path / "box.jpg")
    assert list(tmp_path.iterdir()) == []


def test_the_provenance_tells_how_to_draw_it_again(drawn, tmp_path):
    kept = files.load(drawn.save(tmp_path / "box.npz")).provenance
    width, height = map(int, kept["size"].split("x"))
    ask = {"spp": kept["spp"], "size": (width, height), "seed": kept["seed"]}
    again = rt.render(BOX, precision=kept["precision"], sampler=kept["sampler"], **ask)
    assert again.provenance["scene_sha256"] == kept["scene_sha256"]
    assert again.rgb.tobytes() == drawn.rgb.tobytes()


# What it shows --------------------------------------------------------------------------------------------------------


def test_numpy_sees_the_radiance(drawn):
    np.testing.assert_array_equal(np.asarray(drawn), drawn.rgb)
    assert np.asarray(drawn).dtype == np.float32
    assert np.shares_memory(np.asarray(drawn), drawn.rgb)
    assert not np.shares_memory(np.array(drawn, copy=True), drawn.rgb)
    assert np.asarray(drawn, np.float64).dtype == np.float64
    assert np.mean(drawn) == drawn.rgb.mean()


def test_a_notebook_shows_a_lossless_png(drawn):
    shown = Image.open(io.BytesIO(drawn._repr_png_()))
    assert (shown.format, shown.size, shown.mode) == ("PNG", (20, 14), "RGB")
    np.testing.assert_array_equal(np.asarray(shown), files.srgb8(drawn.rgb))


def test_it_says_what_it_is_in_one_line(drawn):
    text = repr(drawn)
    assert "\n" not in text
    assert len(text) < 80
    assert text.startswith("<Render 20x14, 3 spp, ")
    assert "incomplete" not in text


def test_it_can_not_be_changed_by_accident(drawn):
    with pytest.raises(AttributeError):
        drawn.rgb = drawn.rgb * 2


def test_two_pictures_are_equal_only_if_they_are_one(drawn):
    assert drawn == drawn
    assert drawn != rt.render(BOX, spp=3, size=(20, 14), seed=6)
    assert len({drawn, drawn}) == 1
