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
        {"sphere": {"center": [0, 1, 0], "radius": 0.5}, "material": "water", "normals": "smooth"},
    ],
}
AREA = {"type": "area", "radiance": [17, 12, 5]}


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
    assert dialect.warnings == ()
    np.testing.assert_array_equal(dialect.camera.up, [0, 2, 0])


def test_a_path_traced_dialect_means_the_same_as_its_translation(tmp_path):
    scene = json.loads(json.dumps(DIALECT))
    scene["integrator"] = {"type": "path", "profile": {"any": "thing"}, "max_depth": 7, "spp": 8}
    scene["materials"]["water"] = {"type": "glass", "eta": 1.5, "R": 1, "T": [1, 1, 1]}
    scene["objects"][0]["light"] = AREA
    scene["objects"].append({"type": "mesh", "path": "triangle.obj", "light": {"type": "area", "radiance": [1, 2, 3]}})
    dialect = load(write(tmp_path, scene, "a.json"))
    native = json.loads(json.dumps(NATIVE))
    native["render"] = {"spp": 8, "max_depth": 7, "integrator": "path"}
    native["lights"] = []
    native["materials"] = {
        "water": {"type": "dielectric", "ior": 1.5},
        "lit": {"type": "diffuse", "albedo": [0.7, 0.6, 0.5], "emission": [17, 12, 5]},
        "lamp": {"type": "diffuse", "albedo": [0, 0, 0], "emission": [1, 2, 3]},
    }
    native["objects"][0]["material"] = "lit"
    native["objects"].append({"mesh": "triangle.obj", "material": "lamp"})
    native = load(write(tmp_path, native, "b.json"))
    assert dialect.sha256 == native.sha256
    assert dialect.settings == native.settings
    assert dialect.warnings == ()


def test_a_material_that_a_lamp_shares_stays_what_it_is(tmp_path):
    scene = changed("objects", 0, "light", value=AREA)
    scene["objects"].append({"type": "mesh", "path": "triangle.obj", "material_name": "grey_diffuse"})
    loaded = load(write(tmp_path, scene))
    emission = dict(zip(loaded.materials.name, loaded.materials.emission.tolist(), strict=True))
    assert emission == {
        "grey_diffuse": [0, 0, 0],
        "water": [0, 0, 0],
        "grey_diffuse with the light of objects[0]": [17, 12, 5],
    }
    scene["textures"]["grey"]["color"] = [2, 0, 0]
    with pytest.raises(SceneError) as caught:
        load(write(tmp_path, scene))
    assert str(caught.value).count("\n") == 0  # told once


@pytest.mark.parametrize(
    "point",
    [
        {"point_light_position": [[0, 1, 0], [1, 1, 1]], "point_light_flux": [[1, 2, 3], [4, 5, 6]]},
        {"point_lights": [{"position": [0, 1, 0], "flux": [1, 2, 3]}, {"position": [1, 1, 1], "flux": [4, 5, 6]}]},
        {
            "point_light_position": [0, 1, 0],
            "point_light_flux": [1, 2, 3],
            "point_lights": [{"position": [1, 1, 1], "flux": [4, 5, 6]}],
        },
    ],
)
def test_there_may_be_several_point_lights(tmp_path, point):
    loaded = load(write(tmp_path, changed("integrator", value={"type": "intersection_test", **point})))
    assert loaded.lights.position.tolist() == [[0, 1, 0], [1, 1, 1]]
    assert loaded.lights.flux.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_with_a_lamp_no_point_light_is_needed(tmp_path):
    scene = changed("objects", 0, "light", value=AREA)
    scene["integrator"] = {"type": "intersection_test"}
    assert len(load(write(tmp_path, scene)).lights.flux) == 0


def test_dialect_is_known_by_its_keys():
    assert is_dialect({"integrator": 5})
    assert is_dialect({"textures": {}})
    assert is_dialect({"objects": [5, {"material_name": "x"}]})
    assert is_dialect({"objects": [{"light": {}}]})
    assert not is_dialect(NATIVE)
    assert not is_dialect({"objects": 5})


WRONG = [
    (
        ("integrator", "type"),
        "bdpt",
        'integrator.type: integrator "bdpt" is not supported (supported: intersection_test, path)',
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
    (("textures", "floor"), {"type": "checkerboard"}, 'textures.floor.type: texture "checkerboard" is not supported'),
    (("integrator", "profile"), True, 'integrator.profile: unknown key "profile" (known: '),  # only of "path"
    (("integrator", "point_light_position"), [[0, 1, 0]], "integrator.point_light_flux: expected as many positions as"),
    (("integrator", "point_lights"), 1, "integrator.point_lights: expected a list, got 1"),
    (("integrator", "point_lights"), [{"position": [0, 1, 0]}], 'integrator.point_lights[0]: missing key "flux"'),
    (
        ("integrator", "point_lights"),
        [{"position": [0, 1, 0], "flux": [1, 2]}],
        "integrator.point_lights[0].flux: expected a list of 3 numbers, got a list of 2",
    ),
    (("materials", "water"), {"type": "glass"}, 'materials.water: missing key "eta"'),
    (("materials", "water"), {"type": "glass", "eta": -1}, "materials.water.eta: expected a number > 0, got -1"),
    (
        ("materials", "water"),
        {"type": "glass", "eta": 1.5, "R": 0.5},
        "materials.water.R: R other than 1 is not supported, got 0.5",
    ),
    (
        ("materials", "water"),
        {"type": "glass", "eta": 1.5, "T": [1, 1, 0]},
        "materials.water.T: T other than 1 is not supported, got a list of 3",
    ),
    (("objects", 0, "light"), 5, "objects[0].light: expected an object, got 5"),
    (("objects", 0, "light"), {"type": "area"}, 'objects[0].light: missing key "radiance"'),
    (("objects", 0, "light"), AREA | {"scale": 2}, 'objects[0].light.scale: unknown key "scale" (known: '),
    (("objects", 0, "light"), AREA | {"type": "sun"}, 'objects[0].light.type: light "sun" is not supported'),
    (
        ("objects", 0, "light"),
        AREA | {"radiance": [1, -1, 1]},
        "objects[0].light.radiance[1]: expected a number >= 0, got -1",
    ),
    (
        ("objects", 1, "light"),
        AREA,
        'objects[1].light: only a diffuse material can have a light; "water" is "refraction"',
    ),
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
