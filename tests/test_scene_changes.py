"""Scenes with other values: ``Scene.replace``, and ``--set`` on the command line."""

import dataclasses
import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.rendering.compiled_scene import compiled_of, plan_of
from raytrace.scene.changes import apply_change, load_changed, parse_change, parse_path

BOX = Path(__file__).parent.parent / "scenes" / "cornell-box.json"
TRIANGLE = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]


@pytest.fixture(scope="module")
def box():
    return rt.load(BOX)


def refused(call, *args, **options):
    with pytest.raises(rt.SceneError) as caught:
        call(*args, **options)
    return str(caught.value).replace(str(BOX), "box.json")


def tree(scene):
    return compiled_of(scene, plan_of(scene), "float32").bvh


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("camera.fov", ("camera", "fov")),
        ("lights[0].flux[2]", ("lights", 0, "flux", 2)),
        ('materials["a.b=c"].albedo', ("materials", "a.b=c", "albedo")),
        ("materials.red wall.albedo", ("materials", "red wall", "albedo")),
    ],
)
def test_paths(text, path):
    assert parse_path(text) == path
    assert parse_change(f"{text}=[1, 2]")[:2] == (path, [1, 2])


@pytest.mark.parametrize("text", ["", "[0].x", ".camera", "camera..fov", "camera.", "a[b]", "a[0", "a]"])
def test_what_is_no_path_is_refused(text):
    with pytest.raises(ValueError, match="no path of keys"):
        parse_path(text)


def test_values_are_json_or_words():
    values = {"30": 30, "path": "path", '"path"': "path", "null": None, "[1,[2]]": [1, [2]], "true": True, "a=b": "a=b"}
    assert {word: parse_change(f"camera.fov={word}").value for word in values} == values
    for wrong in ("", "[1", "{a}", '"'):
        with pytest.raises(ValueError, match="no JSON value"):
            parse_change(f"camera.fov={wrong}")
    with pytest.raises(ValueError, match="expected KEY=VALUE"):
        parse_change("camera.fov")


def test_null_removes_a_key_and_sections_may_be_added():
    data = {"camera": {"fov": 1}, "lights": [{"flux": [1, 1, 1]}]}
    for word in ("camera.fov=null", "camera.height=2", "render.spp=4", "lights[0].flux[1]=7"):
        apply_change(data, parse_change(word))
    assert data == {"camera": {"height": 2}, "lights": [{"flux": [1, 7, 1]}], "render": {"spp": 4}}


WRONG = {
    "camera.fow": 'camera.fow: unknown key "fow"; did you mean "fov"?',
    "lights[3].flux": "lights[3].flux: no lights[3]: there is lights[0]",
    "objects[9].scale": "objects[9].scale: no objects[9]: there is objects[0] to objects[6]",
    "materials.gray.albedo": 'materials.gray.albedo: unknown key in materials: "gray"; did you mean "grey"? '
    "(known: grey, red, green)",
    "camera.fov": "camera.fov: expected a number > 0, got -1",
    "objects.x": "objects.x: objects is a list; write an index, as in objects[0]",
    "camera[0]": "camera[0]: camera is an object; write one of its keys: position, look_at, up, fov",
    "cam.fov": 'cam.fov: unknown key "cam"; did you mean "camera"?',
    "camera.fov.x": "camera.fov.x: camera.fov is 19.5, which has no parts",
}


@pytest.mark.parametrize("path", WRONG)
def test_errors_name_the_key_and_those_that_there_are(box, path):
    assert refused(box.replace, {path: -1}) == f"box.json: {WRONG[path]}"
    expected = f"box.json: --set {path}=-1: {WRONG[path].removeprefix(path + ': ')}"
    line = refused(load_changed, BOX, [parse_change(f"{path}=-1")])
    assert line in (expected, f"box.json: --set {path}=-1: {WRONG[path]}")


def test_other_problems_keep_their_lines(tmp_path):
    file = tmp_path / "s.json"
    file.write_text(BOX.read_text().replace('"grey"}', '"gray"}', 1).replace("meshes/", f"{BOX.parent}/meshes/"))
    lines = refused(load_changed, file, [parse_change("camera.fov=0")], BOX.parent).splitlines()
    assert any(line.startswith(f"{file}: --set camera.fov=0: camera.fov: ") for line in lines)
    assert any(line.startswith(f"{file}:") and line.split(":")[1].isdigit() and "gray" in line for line in lines)


def test_sections_are_replaced_and_the_hash_follows(box):
    camera = {"position": np.array([0.0, 1, 4]), "look_at": (0, 1, 0), "fov": 30}
    lights = [{"type": "point", "position": [0, 1.5, 0], "flux": [1, 2, 3]}]
    other = box.replace(camera=camera, lights=lights, film={"size": [8, 6]}, render={"spp": 2}, background=[0.1, 0, 0])
    assert (other.camera.fov, other.settings.size, other.settings.spp) == (30.0, (8, 6), 2)
    assert other.lights.flux.tolist() == [[1, 2, 3]]
    assert other.background.tolist() == [0.1, 0, 0]
    data = json.loads(BOX.read_text()) | {"camera": camera, "lights": lights, "background": [0.1, 0, 0]}
    entries = [entry | {"mesh": BOX.parent / entry["mesh"]} for entry in data["objects"]]
    assert other.sha256 == rt.load(data | {"objects": entries}).sha256 != box.sha256
    assert box.replace().sha256 == box.sha256
    assert "unknown key" in refused(box.replace, light=[])


def test_changes_of_a_changed_scene_add_up(box):
    other = (
        box.replace({"lights[0].flux": np.array([1.0, 2, 3])}).replace({"camera.fov": 30}).replace({"render.seed": 7})
    )
    other = dataclasses.replace(other, camera=other.camera._replace(fov=31.0)).replace({"lights[0].flux[0]": 9})
    assert other.lights.flux.tolist() == [[9, 2, 3]]
    assert (other.camera.fov, other.settings.seed) == (31.0, 7)
    assert json.loads(BOX.read_text())["lights"][0]["flux"] == box.lights.flux[0].tolist()  # the first one is unchanged


def test_trees_are_shared_where_the_triangles_are_the_same(box):
    own = tree(box)
    for changes in (
        {"camera.fov": 30},
        {"render.max_depth": 3},
        {"lights[0].flux": [1, 1, 1]},
        {"background": [1, 1, 1]},
    ):
        assert tree(box.replace(changes)) is own
    assert tree(box.replace({"materials.grey.albedo": [1, 1, 1]}).replace({"camera.fov": 9})) is own
    assert tree(box.replace({"objects[0].scale": 2})) is not own
    other = rt.load(BOX).replace({"background": [1, 1, 1]})  # the first one is gone, and was never compiled
    assert tree(other.replace({"lights[0].flux": [1, 1, 1]})) is tree(other)


def test_an_image_is_that_of_a_scene_loaded_anew(box):
    rt.render(box, spp=1, size=(16, 16))
    words = ["camera.fov=25", "materials.red.albedo=[0.1,0.2,0.9]", "lights[0].position=[0.2,1.2,0.5]"]
    changed = load_changed(BOX, map(parse_change, words))
    replaced = box.replace({parse_change(word)[2].split("=")[0]: parse_change(word).value for word in words})
    one, two = (rt.render(each, spp=1, size=(16, 16)) for each in (changed, replaced))
    assert (one.rgb == two.rgb).all()
    assert one.provenance["scene_sha256"] == two.provenance["scene_sha256"] != box.sha256
    assert one.provenance["set"] == "; ".join(words)
    assert "set" not in two.provenance


def test_meshes_in_memory_stay_and_may_be_replaced():
    scene = rt.load(TRIANGLE)
    other = scene.replace({"camera.fov": 20})
    assert (other.mesh.vertices == scene.mesh.vertices).all()
    assert scene.replace({"materials": {"a": {"type": "mirror"}}, "objects[0].material": "a"}).materials.name == ("a",)
    moved = np.array(TRIANGLE[0]) + 1
    other = other.replace(objects=[{"mesh": (moved, TRIANGLE[1]), "material": "no material"}])
    assert (other.mesh.vertices == moved).all()
    assert other.camera.fov == 20.0


def test_a_scene_from_another_process_can_be_changed(box):
    sent = pickle.loads(pickle.dumps(load_changed(BOX, [parse_change("camera.fov=30")])))
    assert sent.replace({"render.spp": 3}).camera.fov == 30.0
    text = refused(pickle.loads(pickle.dumps(rt.load(TRIANGLE))).replace, {"camera.fov": 20})
    assert text == "scene: meshes that a program gave are not sent to other processes; load the scene here"


def test_records_of_the_wrong_kind_are_refused(box):
    assert refused(dataclasses.replace, box, camera={"fov": 30}) == (
        "camera: expected a Camera record, got dict; use scene.replace(camera=...)"
    )
    assert "no form as a file" in refused(dataclasses.replace(box, content=None).replace)


@pytest.mark.parametrize("command", ["check", "explain"])
def test_commands_take_changes(command, capsys):
    assert main.main([command, str(BOX), "--set", "render.integrator=path", "--set", "lights[0].flux=[1,1,1]"]) == 0
    assert main.main([command, str(BOX), "--set", "render.integrator=paths"]) == 3
    assert "--set render.integrator=paths: render.integrator: unknown integrator" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main.main([command, str(BOX), "--set", "camera"])


def test_meshes_and_the_dialect_take_changes(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = load_changed(tmp_path / "a.obj", [parse_change("camera.fov=20")])
    assert scene.camera.fov == 20.0
    assert "--set camera.fow=2" in refused(load_changed, tmp_path / "a.obj", [parse_change("camera.fow=2")])
    dialect = {
        "integrator": {"type": "path", "spp": 4},
        "film": {"resolution": [8, 8]},
        "camera": {"position": [0, 0, 5], "look_at": [0, 0, 0], "ref_up": [0, 1, 0], "fov": 40},
        "textures": {"t": {"type": "constant", "color": [0.5, 0.5, 0.5]}},
        "materials": {"m": {"type": "diffuse", "texture_name": "t"}},
        "objects": [{"type": "mesh", "path": "a.obj", "material_name": "m"}],
    }
    (tmp_path / "d.json").write_text(json.dumps(dialect))
    assert load_changed(tmp_path / "d.json", [parse_change("integrator.spp=9")]).settings.spp == 9
