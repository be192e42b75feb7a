"""The course dialect."""

import json

import numpy as np
import pytest

from raytrace.errors import SceneError
from raytrace.records import DIFFUSE, REFRACTIVE
from raytrace.scene.load import load
from raytrace.scene.rdr import is_dialect
from scene_files import write

DIALECT = {
    "integrator": {
        "type": "intersection_test",
        "point_light_position": [0, 1.5, 0.5],
        "point_light_flux": [17, 12, 5],
        "max_depth": 9,
        "spp": 32,
    },
    "film": {"resolution": [64, 48]},
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "ref_up": [0, 2, 0], "fov": 19.5, "focal_length": 1.0},
    "textures": {"grey": {"type": "constant", "color": [0.7, 0.6, 0.5]}},
    "materials": {
        "grey_diffuse": {"type": "diffuse", "texture_name": "grey"},
        "water": {"type": "refraction", "eta": 2.0},
    },
    "objects": [
        {"type": "mesh", "path": "triangle.obj", "material_name": "grey_diffuse"},
        {"type": "mesh", "path": "triangle.obj", "material_name": "water", "translate": [1, 2, 3], "scale": 2},
        {"type": "sphere", "center": [0, 1, 0], "radius": 0.5, "material_name": "water"},
    ],
}
NATIVE = {
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "up": [0, 2, 0], "fov": 19.5},
    "film": {"size": [64, 48]},
    "render": {"spp": 32, "max_depth": 9},
    "lights": [{"type": "point", "position": [0, 1.5, 0.5], "flux": [17, 12, 5]}],
    "materials": {
        "grey_diffuse": {"type": "diffuse", "albedo": [0.7, 0.6, 0.5]},
        "water": {"type": "refractive", "ior": 0.5},
    },
    "objects": [
        {"mesh": "triangle.obj", "material": "grey_diffuse"},
        {"mesh": "triangle.obj", "material": "water", "translate": [1, 2, 3], "scale": 2},
        {"sphere": {"center": [0, 1, 0], "radius": 0.5}, "material": "water"},
    ],
}


def changed(*path, value=...):
    scene = json.loads(json.dumps(DIALECT))
    place = scene
    for step in path[:-1]:
        place = place[step]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return scene


def test_dialect_means_the_same_as_its_translation(tmp_path):
    dialect = load(write(tmp_path, DIALECT, "a.json"))
    native = load(write(tmp_path, NATIVE, "b.json"))
    assert dialect.sha256 == native.sha256
    assert dialect.settings == native.settings
    assert dialect.materials.kind.tolist() == [DIFFUSE, REFRACTIVE]
    assert dialect.materials.ior.tolist() == [1, 0.5]
    assert dialect.materials.name == native.materials.name
    assert dialect.mesh.normals is None
    assert dialect.warnings == ()
    np.testing.assert_array_equal(dialect.camera.up, [0, 2, 0])


def test_dialect_is_known_by_its_keys():
    assert is_dialect({"integrator": 5})
    assert is_dialect({"textures": {}})
    assert is_dialect({"objects": [5, {"material_name": "x"}]})
    assert not is_dialect(NATIVE)
    assert not is_dialect({"objects": 5})


WRONG = [
    (
        ("integrator", "type"),
        "path",
        'integrator.type: integrator "path" is not supported (supported: intersection_test)',
    ),
    (("integrator", "spp"), 0, "integrator.spp: expected a number >= 1, got 0"),
    (("integrator", "point_light_flux"), [1, -1, 1], "integrator.point_light_flux[1]: expected a number >= 0, got -1"),
    (("integrator", "point_light_flux"), ..., 'integrator: missing key "point_light_flux"'),
    (("integrator", "rr"), 0.5, 'integrator.rr: unknown key "rr" (known: '),
    (("integrator",), 5, "integrator: expected an object, got 5"),
    (("integrator",), ..., 'missing key "integrator"'),
    (("camera", "ref_up"), [0, 1], "camera.ref_up: expected a list of 3 numbers, got a list of 2"),
    (("camera", "ref_up"), [0, 0, 1], "camera.ref_up: up is parallel to the view direction"),
    (("camera", "fov"), 200, "camera.fov: expected a number < 180, got 200"),
    (("camera", "fov"), ..., 'camera: missing key "fov"'),
    (("camera", "lens"), 1, 'camera.lens: unknown key "lens" (known: '),
    (("camera",), None, "camera: expected an object, got null"),
    (("film", "resolution"), [10**6, 10**6], "film.resolution: a film of 1000000 x 1000000 pixels is too large"),
    (("film",), [1], "film: expected an object, got a list of 1"),
    (("textures", "grey", "color", 0), 2, "textures.grey.color[0]: expected a number <= 1, got 2"),
    (("textures", "grey", "color"), ..., 'textures.grey: missing key "color"'),
    (
        ("textures", "wood"),
        {"type": "image"},
        'textures.wood.type: texture "image" is not supported (supported: constant)',
    ),
    (("textures",), 1, "textures: expected an object, got 1"),
    (("materials", "water", "eta"), 0, "materials.water.eta: expected a number > 0, got 0"),
    (("materials", "water", "eta"), True, "materials.water.eta: expected a number > 0, got true"),
    (("materials", "water", "eta"), ..., 'materials.water: missing key "eta"'),
    (("materials", "water", "type"), "mirror", 'materials.water.type: material "mirror" is not supported (supported: '),
    (("materials", "water", "type"), ..., 'materials.water: missing key "type"'),
    (("materials", "water"), 1, "materials.water: expected an object, got 1"),
    (
        ("materials", "grey_diffuse", "texture_name"),
        "gray",
        'materials.grey_diffuse.texture_name: unknown texture "gray"',
    ),
    (("materials", "grey_diffuse", "texture_name"), ..., 'materials.grey_diffuse: missing key "texture_name"'),
    (("objects", 0, "type"), "cone", 'objects[0].type: object "cone" is not supported (supported: mesh, sphere)'),
    (
        ("objects", 0, "type"),
        ["mesh"],
        "objects[0].type: object a list of 1 is not supported (supported: mesh, sphere)",
    ),
    (("objects", 2, "radius"), 0, "objects[2].radius: expected a number > 0, got 0"),
    (("objects", 2, "center"), [1, 2], "objects[2].center: expected a list of 3 numbers, got a list of 2"),
    (("objects", 2, "radius"), ..., 'objects[2]: missing key "radius"'),
    (("objects", 2, "path"), "a.obj", 'objects[2].path: unknown key "path" (known: '),
    (("objects", 0, "path"), 5, "objects[0].path: expected a string, got 5"),
    (("objects", 0, "path"), "none.obj", "objects[0].path: "),
    (("objects", 0, "path"), ..., 'objects[0]: missing key "path"'),
    (
        ("objects", 1, "material_name"),
        "watr",
        'objects[1].material_name: unknown material "watr"; did you mean "water"?',
    ),
    (("objects", 1, "rotate"), [0, 1, 0], 'objects[1].rotate: unknown key "rotate" (known: '),
    (("objects", 1, "scale"), 0, "objects[1].scale: a scale of 0 leaves no surface"),
    (("objects",), [], "objects: the list is empty"),
    (("objects",), {}, "objects: expected a list, got an object"),
    (("lights",), [], 'lights: unknown key "lights" (known: '),
]


@pytest.mark.parametrize(("path", "value", "told"), WRONG, ids=lambda value: str(value)[:40])
def test_problem_is_told_at_its_place_in_the_dialect(tmp_path, path, value, told):
    scene = write(tmp_path, changed(*path, value=value))
    with pytest.raises((SceneError, OSError)) as caught:
        load(scene)
    lines = str(caught.value).split("\n")
    assert len([line for line in lines if told in line]) == 1
    name, line, column, _ = lines[0].removeprefix(str(tmp_path)).split(":", 3)
    assert name == "/scene.json"
    text = scene.read_text().split("\n")[int(line) - 1][int(column) - 1 :]
    key = told.partition(":")[0].rpartition(".")[2]
    if "unknown key" in told:
        assert text.startswith(json.dumps(key))
    elif value is not ... and key == path[-1]:
        assert text.startswith(json.dumps(value)[:1])


def test_one_mistake_is_one_problem(tmp_path):
    for path, value, _ in WRONG:
        if path in (("materials",), ("textures",), ("film",), ("camera",)):
            continue  # what refers to a section that is none is told too
        with pytest.raises((SceneError, OSError)) as caught:
            load(write(tmp_path, changed(*path, value=value)))
        assert "\n" not in str(caught.value), path
