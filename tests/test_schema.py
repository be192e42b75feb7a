"""The format: its JSON Schema, its ranges, and the document that describes it."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from raytrace.scene import schema, schema_text
from raytrace.scene.messages import EXPECTED, MODELS, tell

ROOT = Path(__file__).parents[1]
SHIPPED = ROOT / "raytrace/scene/scene.schema.json"
DOCUMENT = ROOT / "docs/scene-format.md"
START, END = "<!-- tables -->\n", "<!-- end of tables -->"
TITLES = {
    "SceneFile": "The scene",
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
    "Refractive": "A material of type `refractive`",
    "Object": "An entry of `objects`",
    "Rotation": "`rotate` of an object",
}
EXAMPLE: dict[str, Any] = {
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "fov": 19.5},
    "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}, "glass": {"type": "refractive", "ior": 1.5}},
    "objects": [{"mesh": "floor.obj", "material": "white"}],
}


def generated() -> str:
    return json.dumps(schema.json_schema(), indent=2) + "\n"


def type_words(entry: dict[str, Any]) -> str:
    """Say in a few words what a part of the JSON Schema allows."""
    if "enum" in entry or "const" in entry:
        return " or ".join(f"`{json.dumps(word)}`" for word in entry.get("enum", [entry.get("const")]))
    for key in ("anyOf", "oneOf"):
        if key in entry:
            return " or ".join(type_words(option) for option in entry[key])
    if "$ref" in entry:
        return TITLES[entry["$ref"].rpartition("/")[2]].lower()
    if "prefixItems" in entry:
        return f"list of {len(entry['prefixItems'])}: {type_words(entry['prefixItems'][0])}"
    if entry.get("type") == "array":
        least = ", at least one" if entry.get("minItems") else ""
        return f"list{least}: {type_words(entry['items'])}"
    if "additionalProperties" in entry:
        return f"object by name: {type_words(entry['additionalProperties'])}"
    signs = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    bounds = " and ".join(f"{sign} {entry[key]}" for key, sign in signs.items() if key in entry)
    name = {"integer": "whole number", "boolean": "`true` or `false`", "null": "`null`"}.get(
        entry["type"], entry["type"]
    )
    return f"{name} {bounds}".strip()


def tables() -> str:
    """Write a Markdown table a model."""
    whole = schema.json_schema()
    lines = []
    for model, title in TITLES.items():
        part = whole if model == "SceneFile" else whole["$defs"][model]
        lines += [f"### {title}", "", "| key | holds | default | meaning |", "|---|---|---|---|"]
        for key, entry in part["properties"].items():
            default = "required" if key in part.get("required", []) else f"`{json.dumps(entry['default'])}`"
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
    place[last] = value
    return scene


def test_shipped_schema_equals_the_generated_one():
    assert SHIPPED.read_text("utf-8") == generated()
    assert schema_text() == generated()


def test_document_lists_every_key_as_the_schema_has_it():
    _, _, rest = DOCUMENT.read_text("utf-8").partition(START)
    assert rest.partition(END)[0].strip() == tables().strip()


def test_document_examples_and_limits_are_valid():
    text = DOCUMENT.read_text("utf-8")
    for example in re.findall(r"```json\n(.*?)```", text, re.DOTALL):
        schema.SceneFile.model_validate(json.loads(example))
    for limit in (schema.MAX_SIDE, schema.MAX_PIXELS, schema.MAX_SPP, schema.MAX_DEPTH, schema.MAX_SEED):
        assert f"{limit:,}" in text


def test_every_key_has_a_description():
    whole = schema.json_schema()
    for part in (whole, *whole["$defs"].values()):
        assert part["additionalProperties"] is False
        assert part["description"]
        for entry in part["properties"].values():
            assert entry["description"].endswith(".")


def test_every_model_can_name_its_keys():
    assert {model.__name__ for model in MODELS.values()} == set(TITLES)


def test_defaults_are_those_of_the_format():
    scene = schema.SceneFile.model_validate(EXAMPLE)
    assert scene.film.size == (512, 512)
    assert scene.render.model_dump() == {
        "spp": 16, "max_depth": 16, "sampler": "sobol", "precision": "auto", "seed": 0,
    }  # fmt: skip
    assert scene.camera.up == (0, 1, 0)
    assert scene.background == (0, 0, 0)
    assert scene.objects[0].scale == (1, 1, 1)
    assert scene.objects[0].normals == "flat"
    assert scene.materials["glass"].shadows == "opaque"
    assert scene.materials["white"].two_sided is False


def test_schema_and_models_agree_on_what_is_valid():
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(schema.json_schema())
    validator.check_schema(schema.json_schema())
    validator.validate(EXAMPLE)
    validator.validate(changed("objects.0.scale", 2))
    for path, value, _ in WRONG:
        # beyond JSON Schema: the product of two sides, a scale of 0, and whole numbers written with a point
        if path not in ("film.size", "objects.0.scale", "render.max_depth"):
            assert not validator.is_valid(changed(path, value)), path


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
    ("lights", [{"type": "point", "position": [0, 0, 0]}], 'missing key "flux": Power sent out'),
    ("materials", [], "expected an object, got a list of 0"),
    ("materials.white.albedo", [0, 0, 1.5], "expected a number <= 1, got 1.5"),
    ("materials.white.two_sided", 1, "expected true or false, got 1"),
    ("materials.white.type", "difuse", 'unknown type "difuse"; did you mean "diffuse"? (known: diffuse, refractive)'),
    ("materials.white.albeedo", [0, 0, 0], 'unknown key "albeedo"; did you mean "albedo"?'),
    ("materials.white.ior", 1.5, 'unknown key "ior" (known: type, albedo, two_sided)'),
    ("materials.glass.ior", 0, "expected a number > 0, got 0"),
    ("materials.glass.shadows", "none", 'unknown shadows "none" (known: opaque, transparent)'),
    ("materials.glass", {"ior": 1.5}, 'missing key "type": one of diffuse, refractive'),
    ("materials.glass", None, "expected an object, got null"),
    ("objects", [], "the list is empty; add at least one entry"),
    ("objects.0.mesh", "", 'expected a string that is not empty, got ""'),
    ("objects.0.mesh", 7, "expected a string, got 7"),
    ("objects.0.scale", 0, "a scale of 0 leaves no surface; "),
    ("objects.0.scale", "2", 'expected a number or a list of 3 numbers, got "2"'),
    ("objects.0.scale", True, "expected a number or a list of 3 numbers, got true"),
    ("objects.0.rotate", {"axis": [0, 1, 0], "angle": "90"}, 'expected a number, got "90"'),
    ("objects.0.rotate", {"axis": [0, 1, 0], "angel": 90}, 'unknown key "angel"; did you mean "angle"?'),
    ("objects.0.normals", "smoth", 'unknown normals "smoth"; did you mean "smooth"? (known: flat, smooth)'),
    ("background", 1, "expected a list of numbers, got 1"),
    ("abuot", "x", 'unknown key "abuot"; did you mean "about"?'),
    ("about", ["x"], "expected a string, got a list of 1"),
]


@pytest.mark.parametrize(("path", "value", "text"), WRONG, ids=lambda value: str(value)[:40])
def test_one_wrong_value_is_one_problem_in_plain_words(path, value, text):
    scene = changed(path, value)
    with pytest.raises(ValidationError) as caught:
        schema.SceneFile.model_validate(scene)
    problems = tell(caught.value, scene)
    assert len(problems) == 1
    assert problems[0].text.startswith(text)
    assert "nput should" not in problems[0].text


def test_every_wording_is_used():
    kinds = set()
    for path, value, _ in WRONG:
        try:
            schema.SceneFile.model_validate(changed(path, value))
        except ValidationError as error:
            kinds |= {entry["type"] for entry in error.errors()}
    nan = changed("camera.fov", float("nan"))
    with pytest.raises(ValidationError) as caught:
        schema.SceneFile.model_validate(nan)
    assert tell(caught.value, nan)[0].text == "expected a finite number, got NaN"
    unused = set(EXPECTED) - kinds - {"finite_number"}
    assert not unused, unused


def test_number_scale_is_spread_over_the_axes():
    assert schema.SceneFile.model_validate(changed("objects.0.scale", -2)).objects[0].scale == (-2, -2, -2)


def test_models_do_not_change_after_loading():
    scene = schema.SceneFile.model_validate(EXAMPLE)
    with pytest.raises(ValidationError, match="frozen"):
        scene.camera.fov = 20.0


def write() -> None:
    """Write the schema and the tables again after a change of the models."""
    SHIPPED.write_text(generated(), "utf-8")
    head, _, rest = DOCUMENT.read_text("utf-8").partition(START)
    DOCUMENT.write_text(f"{head}{START}\n{tables()}{END}{rest.partition(END)[2]}", "utf-8")


if __name__ == "__main__":
    write()
