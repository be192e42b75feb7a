"""Mistakes in lights, materials, shapes and matrices: one line each, with its place and what to do."""

import copy

import pytest

import raytrace as rt

SCENE = {
    "camera": {"position": [0, 1, 4], "look_at": [0, 0, 0], "fov": 45},
    "lights": [],
    "materials": {"x": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5], "emission": [1, 1, 1]}},
    "objects": [{"box": {}, "material": "x"}],
}
SPOT = {"type": "spot", "position": [0, 3, 0], "look_at": [0, 0, 0], "intensity": [9, 9, 9], "cutoff": 30}
SUN = {"type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1]}
SKY = {"type": "environment", "radiance": [1, 1, 1]}
UNIT = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
NAN = float("nan")

LIGHTS = [
    ([SPOT | {"cutoff": NAN}], "lights[0].cutoff: expected a finite number, got NaN"),
    ([SUN, SPOT | {"intensity": [-1, 1, 1]}], "lights[1].intensity[0]: expected a number >= 0, got -1"),
    ([SPOT | {"intensity": [1, 1]}], "lights[0].intensity: expected a list of 3 numbers, got a list of 2"),
    ([SPOT | {"cutoff": 0}], "lights[0].cutoff: expected a number > 0, got 0"),
    ([SPOT | {"cutoff": 91}], "lights[0].cutoff: expected a number <= 90, got 91"),
    ([SPOT | {"beam": 40}], "lights[0].beam: expected at most cutoff, 30, got 40"),
    ([SPOT | {"look_at": [0, 3, 0]}], "lights[0].look_at: the spot light looks at its own position; move one"),
    ([SUN | {"direction": [0, 0, -0.0]}], "lights[0].direction: the direction has no length; expected a vector"),
    ([SUN | {"radiance": [1, 1, 1]}], 'lights[0].radiance: unknown key "radiance"; did you mean "irradiance"?'),
    ([SKY, SUN, SKY], "lights[2]: a scene has at most one environment; remove this one, or the other"),
    ([SKY | {"radiance": [-1, 1, 1]}], "lights[0].radiance[0]: expected a number >= 0, got -1"),
    ([{"type": "area"}], 'lights[0].type: unknown type "area" (known: point, '),
]  # fmt: skip
MATERIALS = [
    ({"type": "mirror", "emission": [1, 1, 1]}, 'x.emission: unknown key "emission" (known: type, '),
    ({"type": "mirror", "reflectance": [2, 1, 1]}, "x.reflectance[0]: expected a number <= 1, got 2"),
    ({"type": "diffuse", "albedo": [0, 0, 0], "emission": [0, NAN, 0]}, "x.emission[1]: expected a finite number"),
    ({"type": "diffuse", "albedo": [0, 0, 0], "emission": [0, -1, 0]}, "x.emission[1]: expected a number >= 0, got -1"),
    ({"type": "dielectric"}, 'x: missing key "ior": Index of refraction'),
    ({"type": "dielectric", "ior": 0}, "x.ior: expected a number > 0, got 0"),
    ({"type": "dielectric", "ior": 1.5, "shadows": "none"}, 'x.shadows: unknown shadows "none" (known: opaque, '),
    ({"type": "conductor", "metal": "goold"}, 'x.metal: unknown metal "goold"; did you mean "gold"?'),
    ({"type": "conductor", "eta": [1, 1, 1]}, "x: a conductor needs one of metal, eta with k, or "),
    ({"type": "conductor", "metal": "gold", "reflectance": [1, 1, 1]}, "x: a conductor needs one of metal, eta"),
    ({"type": "conductor", "eta": [1, 1], "k": [1, 1, 1]}, "x.eta: expected a list of 3 numbers, got a list of 2"),
    ({"type": "glass", "ior": 1.5}, 'x.type: unknown type "glass" (known: '),
]  # fmt: skip
OBJECTS = [
    ({"sphere": {"center": [0, 0, 0]}}, 'sphere: missing key "radius": Radius'),
    ({"sphere": {"center": [0, 0, 0], "radius": -1}}, "sphere.radius: expected a number > 0, got -1"),
    ({"rectangle": {"width": 2}}, 'rectangle.width: unknown key "width" (known: '),
    ({"box": {}, "rectangle": {}}, 'box: "rectangle" and "box" exclude each other; keep one'),
    ({}, 'objects[0]: missing key "mesh", or one of sphere, rectangle, box instead'),
    ({"box": {}, "matrix": UNIT, "scale": 2}, 'scale: "matrix" and "scale" exclude each other; keep one'),
    ({"box": {}, "matrix": UNIT[:3]}, "matrix: expected a list of 4 lists of 4 numbers, got a list of 3"),
    ({"box": {}, "matrix": [UNIT[1], *UNIT[1:]]}, "matrix: the determinant of the matrix is 0, which "),
    ({"box": {}, "matrix": [*UNIT[:3], [0, 1, 0, 1]]}, "matrix: expected 0, 0, 0, 1 in the last row; a trans"),
    ({"box": {}, "matrix": [[NAN, 0, 0, 0], *UNIT[1:]]}, "matrix[0][0]: expected a finite number, got NaN"),
    ({"box": {}, "flip": 1}, "flip: expected true or false, got 1"),
    ({"box": {}, "rotate": [{"axis": [0, 0, 0], "angle": 3}]}, "rotate[0].axis: the axis has no direction"),
]  # fmt: skip


def told(**changes):
    with pytest.raises(rt.SceneError) as caught:
        rt.load(copy.deepcopy(SCENE | changes))
    assert caught.value.exit_code == 3
    (line,) = caught.value.problems
    assert "\n" not in line
    return line


@pytest.mark.parametrize(("lights", "text"), LIGHTS, ids=lambda value: value[:40] if isinstance(value, str) else "")
def test_of_lights(lights, text):
    assert text in told(lights=lights)


@pytest.mark.parametrize(
    ("material", "text"), MATERIALS, ids=lambda value: value[:40] if isinstance(value, str) else ""
)
def test_of_materials(material, text):
    assert f"materials.{text}" in told(materials={"x": material})


@pytest.mark.parametrize(("entry", "text"), OBJECTS, ids=lambda value: value[:40] if isinstance(value, str) else "")
def test_of_objects(entry, text):
    assert text in told(objects=[{"material": "x", **entry}])


def test_of_an_environment_beside_a_background():
    assert "background: a background beside an environment" in told(lights=[SKY], background=[0, 0, 0])


def test_the_scene_itself_is_valid():
    assert rt.load(SCENE | {"lights": [SPOT, SUN, SKY]}).warnings == ()
