"""What a hand changes of a scene: the same picture as a scene file that says so, on trees built once."""

import copy
import json

import numpy as np
import pytest

import raytrace as rt
from raytrace.scene.fingerprint import fingerprint
from raytrace.show.prepared_scene import prepare_scene
from raytrace.show.scene_edits import SceneEdits, edited, indices_of_refraction, number_of_lights

FILE = "scenes/cornell-box-glass.json"
SIZE = (40, 30)


@pytest.fixture(scope="module")
def prepared():
    return prepare_scene(rt.load(FILE), SIZE)


def written(**changes):
    """The scene file with other values, loaded."""
    with open(FILE, encoding="utf-8") as stream:
        content = json.load(stream)
    content["materials"]["pane"]["ior"] = changes.get("ior", content["materials"]["pane"]["ior"])
    content["lights"][0]["flux"] = [changes.get("power", 1.0) * flux for flux in content["lights"][0]["flux"]]
    content["camera"]["position"] = changes.get("position", content["camera"]["position"])
    for entry in content["objects"]:
        entry["mesh"] = "scenes/" + entry["mesh"]
    return rt.load(content)


@pytest.mark.parametrize(
    ("edits", "changes"),
    [
        (SceneEdits(), {}),
        (SceneEdits(ior={"pane": 0.8}), {"ior": 0.8}),
        (SceneEdits(power=0.25), {"power": 0.25}),
        (SceneEdits(distance=0.5), {"position": [0, 1, 3.4]}),
        (SceneEdits(ior={"pane": 1.2}, power=3.0), {"ior": 1.2, "power": 3.0}),
    ],
)
def test_it_is_the_scene_that_a_file_would_give(prepared, edits, changes):
    scene, file = edited(prepared, edits._replace(spp=4)), written(**changes)
    assert fingerprint(scene) == file.sha256
    drawn = rt.render(scene)
    np.testing.assert_array_equal(drawn.rgb, rt.render(file, spp=4, size=SIZE).rgb)
    assert drawn.provenance["spp"] == 4


def test_the_scene_itself_is_left_alone(prepared):
    before = copy.deepcopy(prepared.scene)
    edited(prepared, SceneEdits(30, 10, 2, 5, {"pane": 0.9}, 16))
    assert fingerprint(prepared.scene) == before.sha256 == fingerprint(before)
    np.testing.assert_array_equal(prepared.scene.materials.ior, before.materials.ior)


@pytest.mark.filterwarnings("ignore::raytrace.errors.SceneWarning")  # of walls seen from behind
def test_no_tree_is_built_and_no_plan_made_again(prepared, monkeypatch):
    def forbidden(*_arguments):
        raise AssertionError("built again")

    monkeypatch.setattr("raytrace.rendering.compiled_scene.BVH", forbidden)
    monkeypatch.setattr("raytrace.rendering.compiled_scene.compile_scene", forbidden)
    monkeypatch.setattr("raytrace.rendering.compiled_scene.make_plan", forbidden)
    scene = edited(prepared, SceneEdits(30, 10, 0.7, 5, {"pane": 0.9}, 1))
    assert rt.render(scene).complete


def test_only_glass_has_an_index(prepared):
    assert indices_of_refraction(prepared.scene) == {"pane": 0.5}
    assert indices_of_refraction(rt.load("scenes/cornell-box.json")) == {}


ALL_LIGHTS = {
    "camera": {"position": [0, 1, 4], "look_at": [0, 0, 0], "fov": 45},
    "film": {"size": SIZE},
    "render": {"integrator": "path", "spp": 2, "precision": "float32"},
    "lights": [
        {"type": "environment", "radiance": [0.2, 0.3, 0.4]},
        {"type": "spot", "position": [1, 3, 1], "look_at": [0, 0, 0], "intensity": [3, 3, 3], "cutoff": 60},
        {"type": "directional", "direction": [0.2, -1, -0.1], "irradiance": [1, 0.8, 0.6]},
        {"type": "point", "position": [-1, 2, 1], "flux": [20, 20, 20]},
    ],
    "materials": {
        "lamp": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5], "emission": [0.4, 0.3, 0.2]},
        "glass": {"type": "dielectric", "ior": 1.5},
    },
    "objects": [
        {"box": {}, "material": "lamp", "scale": [3, 0.1, 3], "translate": [0, -0.6, 0]},
        {"sphere": {"center": [0, 0, 0], "radius": 0.5, "tolerance": 0.1}, "material": "glass"},
    ],
}


def test_all_lights_and_real_glass_can_be_changed():
    prepared = prepare_scene(rt.load(ALL_LIGHTS))
    assert indices_of_refraction(prepared.scene) == {"glass": 1.5}
    assert number_of_lights(prepared.scene) == 5
    assert number_of_lights(rt.load(FILE)) == 1
    content = copy.deepcopy(ALL_LIGHTS)
    for light in content["lights"]:
        for key in {"flux", "intensity", "irradiance", "radiance"} & light.keys():
            light[key] = [0.5 * number for number in light[key]]
    content["materials"]["lamp"]["emission"] = [0.2, 0.15, 0.1]
    content["materials"]["glass"]["ior"] = 1.25
    scene, file = edited(prepared, SceneEdits(power=0.5, ior={"glass": 1.25}, spp=2)), rt.load(content)
    assert fingerprint(scene) == file.sha256
    drawn = rt.render(scene)
    np.testing.assert_array_equal(drawn.rgb, rt.render(file).rgb)
    np.testing.assert_allclose(rt.render(prepared.scene).rgb.mean(), 2 * drawn.rgb.mean(), rtol=0.1)


def appearance(ior=1.5, scale=1.0, distance=1.0, **camera):
    """An environment image, rough glass and plastic."""
    content = copy.deepcopy(ALL_LIGHTS)
    content["camera"] |= {"position": [0, distance, 4 * distance]} | camera
    if "height" in camera:
        del content["camera"]["fov"]
    content["lights"] = [{"type": "environment", "image": "scenes/textures/sky.png", "scale": scale}]
    content["materials"] |= {"glass": {"type": "dielectric", "ior": ior, "alpha": 0.2}}
    content["materials"]["lamp"] = {"type": "plastic", "albedo": [0.5, 0.2, 0.1], "ior": ior}
    return rt.load(content)


@pytest.mark.parametrize("orthographic", [False, True])
def test_environment_images_rough_glass_plastic_and_lenses_can_be_changed(orthographic):
    def made(distance, **values):
        camera = {"type": "orthographic", "height": 3 * distance} if orthographic else {"aperture": 0.2}
        return appearance(distance=distance, **values, **camera)

    prepared = prepare_scene(made(1.0))
    assert indices_of_refraction(prepared.scene) == {"lamp": 1.5, "glass": 1.5}
    edits = SceneEdits(power=0.5, ior={"glass": 1.25, "lamp": 1.25}, distance=0.5, spp=2)
    scene, file = edited(prepared, edits), made(0.5, ior=1.25, scale=0.5)
    np.testing.assert_allclose(rt.render(scene).rgb, rt.render(file).rgb, rtol=1e-3)
