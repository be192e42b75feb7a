"""``rt.save``: a scene as a file again, with the same hash and the same images."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.scene.content import same
from raytrace.scene.save import PARTS
from shipped_scenes import load

SCENES = sorted((Path(__file__).parent.parent / "scenes").rglob("*.json"))
BOX = next(path for path in SCENES if path.stem == "cornell-box")
TRIANGLE = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]


def saved_and_loaded(scene, path):
    again = rt.load(rt.save(scene, path))
    assert again.sha256 == scene.sha256
    assert [name for name in PARTS if not same(getattr(again, name), getattr(scene, name))] == []
    return again


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_shipped_scene_comes_back(path, tmp_path):
    scene = load(path)
    again = saved_and_loaded(scene, tmp_path / "s.json")
    assert (again.about, again.objects) == (scene.about, scene.objects)


def test_the_demo_and_a_changed_scene_give_the_same_image(tmp_path):
    scene = rt.load(BOX).replace({"camera.fov": 25.1, "lights[0].flux[0]": 1 / 3})
    for name, each in {"demo": rt.demo(), "box": scene}.items():
        again = saved_and_loaded(each, tmp_path / f"{name}.json")
        one, two = (rt.render(which, spp=1, size=(16, 16)) for which in (each, again))
        assert (one.rgb == two.rgb).all()


def test_files_below_the_folder_are_named_and_others_copied(tmp_path):
    below = tmp_path / "a" / "meshes"
    below.mkdir(parents=True)
    (below / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = rt.load(below / "t.obj")
    saved_and_loaded(scene, tmp_path / "a" / "s.json")
    assert json.loads((tmp_path / "a" / "s.json").read_text())["objects"][0]["mesh"] == "meshes/t.obj"
    assert not (tmp_path / "a" / "s-files").exists()
    (tmp_path / "b").mkdir()
    saved_and_loaded(scene, tmp_path / "b" / "s.json")
    assert (tmp_path / "b" / "s-files" / "t.obj").read_text() == (below / "t.obj").read_text()


def test_files_of_one_name_do_not_replace_each_other(tmp_path):
    meshes = []
    for k, name in enumerate("ab"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "t.obj").write_text(f"v 0 0 {k}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        meshes.append({"mesh": tmp_path / name / "t.obj", "material": "m"})
    scene = rt.load(_scene(meshes))
    (tmp_path / "out").mkdir()
    saved_and_loaded(scene, tmp_path / "out" / "s.json")
    assert sorted(path.name for path in (tmp_path / "out" / "s-files").iterdir()) == ["t-2.obj", "t.obj"]


def _scene(objects, **material):
    return {
        "camera": {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 40},
        "materials": {"m": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]} | material},
        "objects": objects,
    }


def test_meshes_in_memory_are_written_bit_for_bit(tmp_path):
    vertices = np.random.default_rng(3).normal(size=(12, 3)) / 3
    faces = np.arange(12).reshape(4, 3)
    mesh = vertices, faces
    entry = {"mesh": mesh, "material": "m", "rotate": {"axis": [1, 2, 3], "angle": 33}, "normals": "smooth"}
    scene = rt.load(_scene([entry, {"mesh": mesh, "material": "m", "scale": 2}, {"mesh": TRIANGLE, "material": "m"}]))
    saved_and_loaded(scene, tmp_path / "s.json")
    assert sorted(path.name for path in (tmp_path / "s-files").iterdir()) == ["mesh-2.ply", "mesh.ply"]
    saved_and_loaded(rt.load(TRIANGLE), tmp_path / "t.json")


def test_attributes_of_meshes_in_memory_are_written(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    rng = np.random.default_rng(4)
    mesh = trimesh.Trimesh(rng.normal(size=(4, 3)), [[0, 1, 2], [1, 2, 3]], process=False)
    mesh.visual.vertex_colors = rng.integers(0, 255, (4, 3))
    saved_and_loaded(
        rt.load(_scene([{"mesh": mesh, "material": "m"}], albedo={"attribute": "color"})), tmp_path / "c.json"
    )
    mesh.visual = trimesh.visual.TextureVisuals(uv=rng.random((4, 2)))
    board = {"checkerboard": [[1, 1, 1], [0, 0, 0]]}
    saved_and_loaded(rt.load(_scene([{"mesh": mesh, "material": "m"}], albedo=board)), tmp_path / "u.json")
    scene = rt.load(_scene([{"mesh": mesh, "material": "m"}]))
    assert (saved_and_loaded(scene, tmp_path / "l.json").corner_uv == scene.corner_uv).all()
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=[[255, 0, 0], [0, 255, 0]])
    scene = rt.load(_scene([{"mesh": mesh, "material": "m"}]))
    saved_and_loaded(scene, tmp_path / "f.json")  # nothing needs the colours


def test_what_is_not_as_in_the_files_is_refused(tmp_path):
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = rt.load(_scene([{"mesh": tmp_path / "t.obj", "material": "m"}]))
    lights = scene.lights._replace(environment=np.ones(3))
    with pytest.raises(rt.SceneError, match=r"save: lights: not as in the scene's files.*use scene.replace"):
        rt.save(dataclasses.replace(scene, lights=lights), tmp_path / "s.json")
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    with pytest.raises(rt.SceneError, match="save: mesh: not as in the scene's files: a file has changed"):
        rt.save(scene, tmp_path / "s.json")
    with pytest.raises(rt.SceneError, match="no form as a file"):
        rt.save(dataclasses.replace(scene, content=None), tmp_path / "s.json")
    with pytest.raises(rt.FileError, match=r"ends in \.json"):
        rt.save(scene, tmp_path / "s.txt")
    with pytest.raises(rt.FileError, match="there is no folder"):
        rt.save(scene, tmp_path / "no" / "s.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.obj"]


def test_another_camera_and_other_settings_are_written(tmp_path):
    scene = rt.load(BOX)
    settings = scene.settings._replace(size=(31, 17), filter="tent", integrator="path", seed=5)
    camera = scene.camera._replace(position=np.array([0.1, 1 / 3, 5]), height=2.5, fov=0.0, focus=1.0)
    scene = dataclasses.replace(scene, camera=camera, settings=settings, background=np.array([0.1, 0.2, 0.3]))
    again = rt.load(rt.save(scene, tmp_path / "s.json"))
    assert (again.sha256, again.settings, again.camera.height) == (scene.sha256, settings, 2.5)
