"""The scene format: its JSON Schema, its messages, and the document that describes it."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from raytrace.limits import MAX_DEPTH, MAX_PIXELS, MAX_SEED, MAX_SIDE, MAX_SPP
from raytrace.scene import schema_text
from raytrace.scene.format import EXPECTED, JSON_TYPES, RULES, read_format

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs/scene-format.md"
START, END = "<!-- tables -->\n", "<!-- end of tables -->"
SCHEMA = json.loads(schema_text())
TITLES = {
    "": "The scene",
    "Camera": "`camera`",
    "Film": "`film`",
    "Render": "`render`",
    "PointLight": "A light of type `point`",
    "SpotLight": "A light of type `spot`",
    "DirectionalLight": "A light of type `directional`",
    "EnvironmentLight": "A light of type `environment`",
    "Diffuse": "A material of type `diffuse`",
    "Mirror": "A material of type `mirror`",
    "Dielectric": "A material of type `dielectric`",
    "Conductor": "A material of type `conductor`",
    "Plastic": "A material of type `plastic`",
    "Refractive": "A material of type `refractive`",
    "Texture": "A texture",
    "Object": "An entry of `objects`",
    "FromFile": "`material` of an object, from its file",
    "Rotation": "`rotate` of an object",
    "Sphere": "`sphere` of an object",
    "Rectangle": "`rectangle` of an object",
    "Box": "`box` of an object",
}
EXAMPLE: dict[str, Any] = {
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "fov": 19.5},
    "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}, "glass": {"type": "refractive", "ior": 1.5}},
    "objects": [{"mesh": "floor.obj", "material": "white"}],
}


def type_words(entry: dict[str, Any]) -> str:
    """Say in a few words what a part of the JSON Schema allows."""
    if "enum" in entry or "const" in entry:
        return " or ".join(f"`{json.dumps(word)}`" for word in entry.get("enum", [entry.get("const")]))
    for key in ("anyOf", "oneOf"):
        if key in entry:
            return " or ".join(type_words(option) for option in entry[key])
    if "$ref" in entry:
        return TITLES[entry["$ref"].rpartition("/")[2]].lower()
    if entry.get("type") == "array":
        length = entry.get("minItems", 0) if entry.get("minItems") == entry.get("maxItems") else 0
        least = ", at least one" if entry.get("minItems") else ""
        limits = {key: value for rule in entry.get("allOf", ()) for key, value in rule["items"].items()}
        return f"list{f' of {length}' if length else least}: {type_words(entry['items'] | limits)}"
    if "additionalProperties" in entry:
        return f"object by name: {type_words(entry['additionalProperties'])}"
    signs = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    bounds = " and ".join(f"{sign} {entry[key]}" for key, sign in signs.items() if key in entry)
    name = {"integer": "whole number", "boolean": "`true` or `false`", "null": "`null`"}.get(
        entry["type"], entry["type"]
    )
    return f"{name} {bounds}".strip()


def tables() -> str:
    """Write one Markdown table per model."""
    lines = []
    for model, title in TITLES.items():
        part = SCHEMA["$defs"][model] if model else SCHEMA
        lines += [f"### {title}", ""]
        if not part["properties"]:
            lines += [part["description"], ""]
            continue
        lines += ["| key | holds | default | meaning |", "|---|---|---|---|"]
        for key, entry in part["properties"].items():
            default = f"`{json.dumps(entry['default'])}`" if "default" in entry else "none"
            default = "required" if key in part.get("required", []) else default
            lines.append(f"| `{key}` | {type_words(entry)} | {default} | {entry['description']} |")
        lines.append("")
    return "\n".join(lines) + "\n"


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return the example with one value changed, at a path such as ``objects.0.scale``."""
    scene = json.loads(json.dumps(EXAMPLE))
    *steps, last = path.split(".")
    place = scene
    for step in steps:
        place = place[int(step)] if step.isdigit() else place.setdefault(step, {})
    place[int(last) if last.isdigit() else last] = value
    return scene


def test_document_lists_every_key_as_the_schema_has_it():
    _, _, rest = DOCUMENT.read_text("utf-8").partition(START)
    assert rest.partition(END)[0].strip() == tables().strip()


def test_document_examples_and_limits_are_valid():
    text = DOCUMENT.read_text("utf-8")
    examples = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    assert examples
    for example in examples:
        assert not read_format(json.loads(example)).problems
    for limit in (MAX_SIDE, MAX_PIXELS, MAX_SPP, MAX_DEPTH, MAX_SEED):
        assert f"{limit:,}" in text


def test_the_schema_has_the_limits_of_the_package():
    models = SCHEMA["$defs"]
    assert models["Render"]["properties"]["spp"]["maximum"] == MAX_SPP
    assert models["Render"]["properties"]["max_depth"]["maximum"] == MAX_DEPTH
    assert models["Render"]["properties"]["seed"]["maximum"] == MAX_SEED
    assert models["Film"]["properties"]["size"]["allOf"] == [{"items": {"maximum": MAX_SIDE}}]
    assert f"at most {MAX_PIXELS} pixels" in models["Film"]["properties"]["size"]["description"]


def test_every_key_has_a_description():
    for part in (SCHEMA, *SCHEMA["$defs"].values()):
        assert part["additionalProperties"] is False
        assert part["description"]
        for entry in part["properties"].values():
            assert entry["description"].endswith(".")


def test_the_document_has_every_model():
    assert {"", *SCHEMA["$defs"]} == set(TITLES)
    assert all(model["title"] == name for name, model in SCHEMA["$defs"].items())


def test_every_rule_belongs_to_a_key():
    assert all(key in SCHEMA["$defs"][model]["properties"] for model, key in RULES)


def test_defaults_are_those_of_the_format():
    scene = read_format(EXAMPLE).scene
    assert scene.film.size == (512, 512)
    assert vars(scene.render) == {
        "spp": 16, "max_depth": 16, "sampler": "sobol", "precision": "auto", "seed": 0,
        "integrator": "direct",
    }  # fmt: skip
    assert scene.camera.up == (0, 1, 0)
    assert scene.background == (0, 0, 0)
    assert vars(scene.objects[0]) == {
        "mesh": "floor.obj", "sphere": None, "rectangle": None, "box": None, "material": "white", "scale": (1, 1, 1),
        "rotate": [], "translate": (0, 0, 0), "matrix": None, "flip": False, "normals": "flat",
    }  # fmt: skip
    assert scene.materials["glass"].shadows == "opaque"
    assert scene.materials["white"].two_sided is False


BALL = {"center": [0, 0, 0], "radius": 1}
SPHERE = {"material": "white", "sphere": BALL}
UNIT = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
ROTATION = 'expected {"axis": [x, y, z], "angle": degrees}, or a list of them'
WRONG = [
    ("camera.fov", -1.5, "expected a number > 0, got -1.5"),
    ("camera.fov", 180, "expected a number < 180, got 180"),
    ("camera.fov", True, "expected a number, got true"),
    ("camera.fov", None, "expected a number, got null"),
    ("camera.position", [0, 1], "expected a list of 3 numbers, got a list of 2"),
    ("camera.position", [], "expected a list of 3 numbers, got a list of 0"),
    ("camera.position", [0, 1, 2, 3], "expected a list of 3 numbers, got a list of 4"),
    ("camera.position", "0 1 2", 'expected a list of numbers, got "0 1 2"'),
    ("camera.position", [0, "1", 2], 'expected a number, got "1"'),
    ("camera", 5, "expected an object, got 5"),
    ("film.size", [512], "expected a list of 2 numbers, got a list of 1"),
    ("film.size", [0, 512], "expected a number >= 1, got 0"),
    ("film.size", [512.0, 512], "expected a whole number, got 512.0"),
    ("film.size", [65_536, 4_097], "a film of 65536 x 4097 pixels is too large; "),
    ("film.size", [10**6, 10**6], "a film of 1000000 x 1000000 pixels is too large; "),
    ("render.spp", 0, "expected a number >= 1, got 0"),
    ("render.spp", 65_537, "expected a number <= 65536, got 65537"),
    ("render.max_depth", 1e3, "expected a whole number, got 1000.0"),
    ("render.seed", 2**32, "expected a number <= 4294967295, got 4294967296"),
    ("render.sampler", "sobl", 'unknown sampler "sobl"; did you mean "sobol"? (known: sobol, stratified, independent)'),
    ("render.precision", 32, "unknown precision 32 (known: auto, float32, float64)"),
    ("lights", {}, "expected a list, got an object"),
    (
        "lights",
        [{"type": "pont", "position": [0, 0, 0], "flux": [1, 1, 1]}],
        'unknown type "pont"; did you mean "point"?',
    ),
    ("lights", [{"type": "point", "position": [0, 0, 0], "flux": [1, -1, 1]}], "expected a number >= 0, got -1"),
    ("lights", [{"type": "point", "position": [0, 0, 0]}], 'missing key "flux": Power emitted'),
    ("materials", [], "expected an object, got a list of 0"),
    ("materials.white.albedo", [0, 0, 1.5], "expected a number <= 1, got 1.5"),
    ("materials.white.two_sided", 1, "expected true or false, got 1"),
    (
        "materials.white.type",
        "difuse",
        'unknown type "difuse"; did you mean "diffuse"? '
        "(known: diffuse, mirror, dielectric, conductor, plastic, refractive)",
    ),
    ("materials.white.albeedo", [0, 0, 0], 'unknown key "albeedo"; did you mean "albedo"?'),
    ("materials.white.ior", 1.5, 'unknown key "ior" (known: type, albedo, two_sided, emission)'),
    ("materials.glass.ior", 0, "expected a number > 0, got 0"),
    ("materials.glass.shadows", "none", 'unknown shadows "none" (known: opaque, transparent)'),
    (
        "materials.glass",
        {"ior": 1.5},
        'missing key "type": one of diffuse, mirror, dielectric, conductor, plastic, refractive',
    ),
    ("materials.glass", None, "expected an object, got null"),
    ("objects", [], "the list is empty; add at least one entry"),
    ("objects.0.mesh", "", 'expected a string that is not empty, got ""'),
    ("objects.0.mesh", 7, "expected a string, got 7"),
    ("objects.0.scale", 0, "a scale of 0 leaves no surface; "),
    ("objects.0.scale", "2", 'expected a number or a list of 3 numbers, got "2"'),
    ("objects.0.scale", True, "expected a number or a list of 3 numbers, got true"),
    ("objects.0.rotate", {"axis": [0, 1, 0], "angle": "90"}, 'expected a number, got "90"'),
    ("objects.0.rotate", {"axis": [0, 1, 0], "angel": 90}, 'unknown key "angel"; did you mean "angle"?'),
    ("objects.0.rotate", 4, f"{ROTATION}, got 4"),
    ("objects.0.rotate", [0, 9.5, 0], f'{ROTATION}, got 3 numbers; here {{"axis": [0, 1, 0], "angle": 9.5}}'),
    ("objects.0.rotate", [90, 0, 45], f"{ROTATION}, got 3 numbers"),
    ("objects.0.rotate", [{"axis": [0, 1, 0], "angle": 1}, 90], f"{ROTATION}, got a list of 2"),
    ("objects.0.rotate", [{"axis": [0, 1, 0], "angle": 1}, {"axis": [0, 1, 0]}], 'missing key "angle": '),
    ("objects.0.matrix", None, "expected a list of 4 lists of 4 numbers, got null"),
    ("objects.0.matrix", [[1, 0, 0, 0]] * 3, "expected a list of 4 lists of 4 numbers, got a list of 3"),
    ("objects.0.matrix", [[1, 0, 0], *[[0, 0, 0, 1]] * 3], "expected a list of 4 numbers, got a list of 3"),
    ("objects.0.matrix", [[1, 0, 0, 0]] * 4, "expected 0, 0, 0, 1 in the last row; "),
    ("objects.0.matrix", [*[[1, 0, 0, 0]] * 3, [0, 0, 0, 1]], "the determinant of the matrix is 0, "),
    ("objects.0.flip", 1, "expected true or false, got 1"),
    ("objects.0.mesh", None, "expected a string, got null"),
    ("objects.0", {"material": "white"}, 'missing key "mesh", or one of sphere, rectangle, box instead'),
    ("objects.0", {"material": "white", "spere": {}}, 'unknown key "spere"; did you mean "sphere"?'),
    ("objects.0.box", {}, '"mesh" and "box" exclude each other; keep one'),
    ("objects.0", SPHERE | {"matrix": UNIT, "scale": 2}, '"matrix" and "scale" exclude each other; keep one'),
    ("objects.0", SPHERE | {"matrix": UNIT, "rotate": None}, '"matrix" and "rotate" exclude each other; keep one'),
    ("objects.0", SPHERE | {"matrix": UNIT, "translate": [0, 0, 0]}, '"matrix" and "translate" exclude each other'),
    ("objects.0", {"material": "white", "box": {"size": 1}}, 'unknown key "size" (known: none)'),
    ("objects.0", {"material": "white", "rectangle": None}, "expected an object, got null"),
    ("objects.0", {"material": "white", "sphere": {"center": [0, 0, 0]}}, 'missing key "radius": '),
    ("objects.0", SPHERE | {"sphere": {"center": [0, 0, 0], "radius": 0}}, "expected a number > 0, got 0"),
    ("objects.0", SPHERE | {"sphere": {**BALL, "tolerance": 0}}, "expected a number >= 1e-08, got 0"),
    ("objects.0", SPHERE | {"sphere": {**BALL, "tolerance": 2}}, "expected a number <= 1, got 2"),
    ("objects.0.normals", "smoth", 'unknown normals "smoth"; did you mean "smooth"? (known: flat, smooth)'),
    ("background", 1, "expected a list of numbers, got 1"),
    ("abuot", "x", 'unknown key "abuot"; did you mean "about"?'),
    ("about", ["x"], "expected a string, got a list of 1"),
]


@pytest.mark.parametrize(("path", "value", "text"), WRONG, ids=lambda value: str(value)[:40])
def test_one_wrong_value_is_one_problem_in_plain_words(path, value, text):
    scene, problems = read_format(changed(path, value))
    assert scene is None
    assert len(problems) == 1
    assert problems[0].text.startswith(text)


def test_every_wording_is_used():
    told = " ".join(text for _, _, text in WRONG)
    assert all(words in told for words in EXPECTED.values())
    assert set(EXPECTED) == set(JSON_TYPES) - {"null"}


def test_number_scale_is_spread_over_the_axes():
    assert read_format(changed("objects.0.scale", -2)).scene.objects[0].scale == (-2, -2, -2)


def test_one_rotation_is_a_list_of_one():
    rotate = {"axis": [0, 1, 0], "angle": 30}
    for value, angles in ((rotate, [30]), ([rotate, rotate], [30, 30]), ([], []), (None, [])):
        found = read_format(changed("objects.0.rotate", value)).scene.objects[0].rotate
        assert [turn.angle for turn in found] == angles


def write() -> None:
    """Write the tables of the document again after a change of the schema."""
    head, _, rest = DOCUMENT.read_text("utf-8").partition(START)
    DOCUMENT.write_text(f"{head}{START}\n{tables()}{END}{rest.partition(END)[2]}", "utf-8")


if __name__ == "__main__":
    write()
