"""The layer (AOV) ``uv``, for scenes whose materials need uv and for those whose materials do not."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import raytrace as rt
from raytrace.image import files
from raytrace.records import Window
from raytrace.rendering.result import trace_layers
from scene_files import scene, write

QUAD = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 2 0\nvt 2 3\nvt 0 3\nf 1/1 2/2 3/3 4/4\n"
CAMERA = {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 60}
SIZE = (8, 6)


def quad(folder, *more, **changes):
    (folder / "quad.obj").write_text(QUAD)
    objects = [{"mesh": "quad.obj", "material": "white"}, *more]
    return rt.load(write(folder, scene(camera=CAMERA, objects=objects, **changes)))


def layers(made, name=""):
    """Layers without an image: only the kernels that trace rays are compiled."""
    return trace_layers(made, rt.BVH(made.mesh.vertices, made.mesh.faces), SIZE, Window(0, 0, *SIZE), name)


def uv_layer(made):
    return layers(made, "uv")["uv"]


def expected(made):
    """uv of the quad at the centres of the pixels, where rays meet it at z = 0."""
    position = layers(made)["position"]
    return np.stack([position[..., 0] + 1, (position[..., 1] + 1) * 1.5], axis=-1)


def test_uv_of_a_mesh_whose_material_needs_none_are_read_when_they_are_asked_for(tmp_path):
    made = quad(tmp_path)
    assert made.mesh.uv is None
    layer = uv_layer(made)
    assert layer.shape == (6, 8, 2)
    assert layer.dtype == np.float32
    np.testing.assert_allclose(layer, expected(made), atol=2e-6)
    assert np.isnan(layer[:, 0]).all()
    assert np.isfinite(layer[1:5, 3]).all()
    assert made.mesh.uv is None  # nor has the scene another hash now
    assert made.sha256 == rt.load(tmp_path / "scene.json").sha256


def test_other_layers_read_no_uv(tmp_path, monkeypatch):
    made = quad(tmp_path)
    (tmp_path / "quad.obj").unlink()
    image = rt.render(made, size=SIZE, spp=1)
    assert image.aov["depth"].shape == (6, 8)
    with pytest.raises(rt.FileError, match=r"uv: .*quad.obj: no such file"):
        image.aov["uv"]
    monkeypatch.setattr("raytrace.rendering.rendering.Run", None)  # it is an error before anything is rendered
    with pytest.raises(rt.FileError, match=r"uv: .*quad.obj: no such file"):
        rt.render(made, size=SIZE, spp=1, aov=["uv"])


def test_a_file_that_has_changed_is_an_error(tmp_path):
    made = quad(tmp_path)
    (tmp_path / "quad.obj").write_text(QUAD.replace("v 1 1 0", "v 1 2 0"))
    with pytest.raises(rt.FileError, match="has changed since the scene was loaded"):
        uv_layer(made)
    (tmp_path / "quad.obj").write_text(QUAD.replace("vt 2 3", "vt 2 x"))
    with pytest.raises(rt.SceneError, match=r"uv: .*quad.obj:7: expected a number, got 'x'"):
        uv_layer(rt.load(tmp_path / "scene.json"))
    (tmp_path / "quad.obj").write_text(QUAD + "f 1 2 3\n")
    with pytest.raises(rt.FileError, match="has changed since the scene was loaded"):
        uv_layer(made)


def test_objects_without_uv_have_nan_and_all_others_have_theirs(tmp_path):
    board = {"type": "diffuse", "albedo": {"checkerboard": [[1, 1, 1], [0, 0, 0]]}}
    white = {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}
    near = {"mesh": "triangle.obj", "material": "white", "translate": [-0.2, -0.2, 1]}
    far = {"rectangle": {}, "material": "board", "scale": 9, "translate": [0, 0, -1]}
    made = quad(tmp_path, near, far, materials={"white": white, "board": board})
    assert made.mesh.uv is not None
    others, uv = layers(made), uv_layer(made)
    found = others["prim_id"]
    assert np.isnan(uv[found == 2]).all()
    assert (found == 2).any()
    np.testing.assert_allclose(uv[found < 2], expected(made)[found < 2], atol=2e-6)
    position = others["position"][found > 2]
    np.testing.assert_allclose(uv[found > 2], (position[:, :2] / 9 + 1) / 2, atol=2e-6)
    flat = quad(tmp_path, near)
    assert np.isnan(uv_layer(replace(flat, mesh=flat.mesh, uv_source=None))).all()


def test_files_keep_the_layer(tmp_path):
    image = rt.render(quad(tmp_path), size=SIZE, spp=1, aov=["uv"])
    for suffix in ("npz", "exr"):
        image.save(tmp_path / f"a.{suffix}")
        np.testing.assert_array_equal(files.load(tmp_path / f"a.{suffix}").aov["uv"], image.aov["uv"])


def test_meshes_of_programs_and_scenes_that_were_sent_to_another_process(tmp_path):
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(uv=box.vertices[:, :2] + 0.5)
    made = rt.load(scene(camera=CAMERA, objects=[{"mesh": box, "material": "white"}]))
    layer = uv_layer(made)
    position = layers(made)["position"]
    np.testing.assert_allclose(layer, position[..., :2] + 0.5, atol=2e-6)
    plain = {"mesh": (box.vertices + [0, 0, 1], box.faces), "material": "white"}
    both = rt.load(scene(camera=CAMERA, objects=[plain, {"mesh": box, "material": "white", "translate": [1.2, 0, 0]}]))
    assert list(both.uv_source.given.values()) == [box]  # the other one has no uv, and is not kept
    found, layer = layers(both)["prim_id"], uv_layer(both)
    assert np.isnan(layer[found < 12]).all()
    assert np.isfinite(layer[found >= 12]).all()
    assert (found >= 12).any()
    sent = pickle.loads(pickle.dumps(quad(tmp_path)))
    np.testing.assert_array_equal(uv_layer(sent), uv_layer(quad(tmp_path)))
    sent = pickle.loads(pickle.dumps(rt.load(scene(camera=CAMERA, objects=[{"mesh": box, "material": "white"}]))))
    with pytest.raises(rt.FileError, match="uv: a mesh that a program gave"):
        uv_layer(sent)
