"""The reader of scenes accepts what the shipped JSON Schema accepts, by the judgement of the package jsonschema."""

import copy
import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raytrace.limits import MAX_PIXELS, MAX_SIDE
from raytrace.scene import schema_text
from raytrace.scene.format import read_format
from raytrace.scene.problems import MAX_PROBLEMS

pytestmark = pytest.mark.nojit
SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))
SCHEMA = json.loads(schema_text())
READ = {  # keywords of JSON Schema that the reader interprets, and those that change nothing for it
    *("$ref", "anyOf", "discriminator", "type", "const", "enum", "items", "minItems", "maxItems", "minLength"),
    *("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "properties", "required", "default"),
    *("additionalProperties", "oneOf", "allOf", "title", "description", "$schema", "$defs"),
}
WHOLE = {
    "$schema": "https://example.org",
    "about": "All that the format has.",
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "up": [0, 2, 0], "fov": 20},
    "film": {"size": [4, 3]},
    "render": {"spp": 2, "max_depth": 3, "sampler": "stratified", "precision": "float64", "seed": 7},
    "lights": [{"type": "point", "position": [0, 1, 2], "flux": [1, 0, 2.5]}],
    "materials": {
        "white": {"type": "diffuse", "albedo": [0, 1, 0.5], "two_sided": True},
        "glass": {"type": "refractive", "ior": 1.5, "shadows": "transparent"},
    },
    "objects": [
        {"mesh": "a.obj", "material": "white", "scale": 2, "normals": "smooth"},
        {"mesh": "b.obj", "material": "glass", "scale": [1, -1, 2], "rotate": {"axis": [0, 1, 0], "angle": 30}},
        {"mesh": "c.obj", "material": "glass", "rotate": None, "translate": [1, 2, 3]},
        {
            "sphere": {"center": [0, 1, 0], "radius": 2, "tolerance": 0.1},
            "material": "white",
            "rotate": [{"axis": [0, 1, 0], "angle": 30}, {"axis": [1, 0, 0], "angle": 5}],
        },
        {"box": {}, "material": "white", "flip": True},
        {
            "rectangle": {},
            "material": "white",
            "matrix": [[1, 0, 0, 2], [0, -3, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        },
    ],
    "background": [1, 2, 3],
}
VALUES = [None, True, False, 0, 1, -1, 2, 0.5, 1e300, 10**20, 10**299, 65537, "", "a", "diffuse", "sobol", "flat"]
VALUES += [[], {}, [0, 0, 0], [1, 2], [1, 2, 3, 4], [1, 2, "3"], [True, 1, 1], {"type": "point"}, {"type": "diffuse"}]


def keywords(schema: Any):
    """Names of all keywords of a schema."""
    if not isinstance(schema, dict):
        return
    yield from schema
    named = [*schema.get("properties", {}).values(), *schema.get("$defs", {}).values()]
    for part in [*named, *schema.get("anyOf", ()), schema.get("items"), schema.get("additionalProperties")]:
        yield from keywords(part)


def is_integer(_checker: Any, value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)  # JSON Schema takes 1.0 for a whole number as well


Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator,
    type_checker=jsonschema.Draft202012Validator.TYPE_CHECKER.redefine("integer", is_integer),
)
VALIDATOR = Validator(SCHEMA)


def allowed(data: Any) -> bool:
    """Whether a scene conforms: to the schema, and to the four rules that JSON Schema cannot express."""
    if not VALIDATOR.is_valid(data):
        return False
    width, height = data.get("film", {}).get("size", [1, 1])
    fits = width * height <= MAX_PIXELS
    for entry in data["objects"]:
        scale, matrix = entry.get("scale", 1), entry.get("matrix")
        fits = fits and 0 not in (scale if isinstance(scale, list) else [scale])
        if matrix is not None:
            (a, b, c, _), (d, e, f, _), (g, h, i, _), last = matrix
            determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
            fits = fits and last == [0, 0, 0, 1] and determinant != 0
    return fits


def judge(data: Any) -> None:
    scene, problems = read_format(data)
    assert (scene is not None) == allowed(data) == (not problems)


def places(value, path=()):
    """Paths of all values of a scene, the whole one included."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


def put(path, value):
    """The whole scene with another value at a place."""
    scene = copy.deepcopy(WHOLE)
    *steps, last = path
    place = scene
    for step in steps:
        place = place[step]
    place[last] = value
    return scene


def test_the_schema_is_valid_and_says_nothing_that_the_reader_does_not_understand():
    Validator.check_schema(SCHEMA)
    assert set(keywords(SCHEMA)) <= READ
    for model in SCHEMA["$defs"].values():
        for choice in model.get("oneOf", ()):
            assert choice.keys() == {"required"}
            assert len(choice["required"]) == 1
        for rule in model.get("allOf", ()):
            assert rule.keys() == {"not"}
            assert rule["not"].keys() == {"required"}
            assert len(rule["not"]["required"]) == 2


def test_a_key_has_one_type_for_each_type_of_json():
    """The reader selects an option by the JSON type of the value."""
    for model in (SCHEMA, *SCHEMA["$defs"].values()):
        for entry in model["properties"].values():
            kinds = [
                "object" if "$ref" in option else "number" if option["type"] == "integer" else option["type"]
                for option in entry.get("anyOf", ())
            ]
            assert len(kinds) == len(set(kinds))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scenes_are_valid(path):
    data = json.loads(path.read_text("utf-8"))
    assert allowed(data)
    judge(data)


def test_numbers_become_floats_and_lists_of_fixed_length_tuples():
    scene = read_format(WHOLE).scene
    assert scene.camera.fov == 20
    assert isinstance(scene.camera.fov, float)
    assert scene.camera.up == (0, 2, 0)
    assert all(isinstance(number, float) for number in scene.camera.up)
    assert isinstance(scene.render.spp, int)
    assert scene.objects[5].matrix[1] == (0, -3, 0, 0)


def test_the_least_scene_is_valid():
    judge({key: WHOLE[key] for key in ("camera", "materials", "objects")})


PLACES = [path for path in places(WHOLE) if path]


@settings(max_examples=600, deadline=None)
@given(st.sampled_from(PLACES), st.sampled_from(VALUES))
def test_any_change_is_judged_as_the_schema_judges_it(path, value):
    judge(put(path, value))


@pytest.mark.parametrize("path", [path for path in PLACES if isinstance(path[-1], str)])
def test_a_missing_and_an_unknown_key_are_judged_as_the_schema_judges_them(path):
    without, more = copy.deepcopy(WHOLE), copy.deepcopy(WHOLE)
    for scene, change in ((without, lambda place: place.pop(path[-1])), (more, lambda place: place.update(lense=1))):
        place = scene
        for step in path[:-1]:
            place = place[step]
        change(place)
        judge(scene)


@pytest.mark.parametrize("size", [[MAX_SIDE, MAX_PIXELS // MAX_SIDE], [MAX_SIDE, MAX_PIXELS // MAX_SIDE + 1]])
def test_a_film_has_its_limit(size):
    judge(put(("film", "size"), size))


def test_two_shapes_and_a_matrix_beside_another_transform_are_refused():
    for key, value in (("box", {}), ("matrix", WHOLE["objects"][5]["matrix"])):
        data = copy.deepcopy(WHOLE)
        data["objects"][0][key] = value
        assert not allowed(data)
        judge(data)


def test_of_very_many_problems_few_more_than_are_reported_are_found():
    data = {**WHOLE, "objects": [{"mesh": 1, **{f"k{i}": 0 for i in range(50)}}] * 5000}
    assert len(read_format(data).problems) == MAX_PROBLEMS + 1


@pytest.mark.parametrize(
    ("section", "entry", "told"),
    [
        (
            "materials",
            {"type": "mirror", "emission": [1, 1, 1]},
            'emission: unknown key "emission" .*; "diffuse" has it',
        ),
        ("materials", {"type": "mirror", "shadows": "opaque"}, '; "dielectric", .*"refractive" have it'),
        ("materials", {"type": "glass"}, 'type: unknown type "glass" .*; real glass is "dielectric"'),
        ("materials", {"type": "mirror", "reflectanc": 1}, r'did you mean "reflectance"\?$'),
        ("materials", {"type": "mirror", "shine": 1}, r'unknown key "shine" \(known: [a-z, ]*\)$'),
        ("lights", {"type": "area", "radiance": [1, 1, 1]}, "an area light is an object whose diffuse material has"),
    ],
)
def test_what_another_type_has_is_told(section, entry, told):
    data = {section: {"x": entry} if section == "materials" else [entry]}
    texts = [f"{problem.path[-1]}: {problem.text}" for problem in read_format(data).problems if len(problem.path) > 1]
    assert len(texts) == 1
    assert re.search(told, texts[0])


@pytest.mark.parametrize(
    ("section", "entry", "told"),
    [
        ("film", {"spp": 4}, r'unknown key "spp" \(known: size, filter\); "render" has it$'),
        ("film", {"height": 4}, r'unknown key "height"; did you mean "size"\?$'),
        ("materials", {"x": {"type": "diffuse", "colour": [1, 1, 1]}}, r'"colour"; did you mean "albedo"\?$'),
    ],
)
def test_keys_of_other_places_and_other_formats_are_told(section, entry, told):
    texts = [problem.text for problem in read_format({**WHOLE, section: entry}).problems if problem.path[0] == section]
    assert len(texts) == 1  # a key by another name is not lacking too
    assert re.search(told, texts[0])
