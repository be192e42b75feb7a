"""The scene format: reads JSON data by the shipped JSON Schema, and reports everything that does not conform.

The schema is the one definition of the format. This module interprets the part of JSON Schema that it uses (the tests
check that it uses no more). ``rules.py`` holds what JSON Schema cannot express about single values, ``checks.py`` what
several keys must agree on.
"""

import contextlib
import json
from collections.abc import Callable, Iterator
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

from raytrace.scene import schema_text
from raytrace.scene.positions import Path
from raytrace.scene.problems import MAX_PROBLEMS, Problem, listed, meant_key, quote, unknown_key, unknown_name
from raytrace.scene.rules import (
    MEANT,
    check_film,
    check_matrix,
    list_rotations,
    material_name,
    rotation_fault,
    scale_factors,
)

Schema = dict[str, Any]

JSON_TYPES: dict[str, tuple[type, ...]] = {
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "string": (str,),
    "array": (list,),
    "object": (dict,),
    "null": (type(None),),
}
EXPECTED = {  # what a message calls each type
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "string": "a string",
    "array": "a list",
    "object": "an object",
}
RULES: dict[tuple[str, str], Callable[[Any], Any]] = {  # (title of a model, key): raises ValueError, or converts
    ("Film", "size"): check_film,
    ("Object", "material"): material_name,
    ("Object", "scale"): scale_factors,
    ("Object", "rotate"): list_rotations,
    ("EnvironmentLight", "rotate"): list_rotations,
    ("Object", "matrix"): check_matrix,
}


class Reading(NamedTuple):
    """A scene, or its camera, as attributes, or what is wrong with it."""

    scene: SimpleNamespace | None  # numbers as float, lists of fixed length as tuples, defaults filled in
    problems: list[Problem]  # empty if there is a scene; at most ``MAX_PROBLEMS`` + 1


class _EnoughError(Exception):
    """There are more problems than are reported."""


def read_format(data: Any) -> Reading:
    """Read a scene, and check every key of it by itself.

    Parameters
    ----------
    data : object
        A scene as JSON types; numbers are finite.

    Returns
    -------
    Reading
        Several missing numbers of one list are one problem, and so are a misspelt key and the lack of the right one.

    Examples
    --------
    >>> [problem.text for problem in read_format({"camera": 5, "objects": [], "materials": {}}).problems]
    ['expected an object, got 5', 'the list is empty; add at least one entry']
    """
    schema = json.loads(schema_text())
    reader = _Reader(schema["$defs"])
    scene = None
    with contextlib.suppress(_EnoughError):
        scene = reader.read(schema, data, ())
    return Reading(None if reader.problems else scene, reader.problems)


@cache
def _schema() -> Schema:
    schema: Schema = json.loads(schema_text())
    return schema


def read_material(data: dict[str, Any]) -> SimpleNamespace:
    """Return a material that a program made, with all defaults, as ``read_format`` returns those of a scene.

    Examples
    --------
    >>> read_material({"type": "diffuse", "albedo": [1, 0, 0]}).two_sided
    False
    """
    schema = _schema()
    reader = _Reader(schema["$defs"])
    material: SimpleNamespace = reader.read(schema["properties"]["materials"]["additionalProperties"], data, ("",))
    assert not reader.problems, reader.problems[0].text
    return material


def read_camera(data: Any) -> Reading:
    """Read a camera that a program gives, as ``read_format`` reads that of a scene."""
    schema = _schema()
    reader = _Reader(schema["$defs"])
    camera = None
    with contextlib.suppress(_EnoughError):
        camera = reader.read(schema["properties"]["camera"], data, ("camera",))
    return Reading(camera, reader.problems)


class _Reader:
    """Reads values by their schemas, and collects problems."""

    def __init__(self, definitions: dict[str, Schema]) -> None:
        self.problems: list[Problem] = []
        self._definitions = definitions

    def _report(self, path: Path, text: str, at_key: bool = False) -> None:
        self.problems.append(Problem(path, text, at_key))
        if len(self.problems) > MAX_PROBLEMS:
            raise _EnoughError

    def _resolve(self, schema: Schema) -> Schema:
        while "$ref" in schema:
            schema = self._definitions[schema["$ref"].rpartition("/")[2]]
        return schema

    def read(self, schema: Schema, value: Any, path: Path) -> Any:
        """Return the converted value; None if it is wrong, which is then reported."""
        schema = self._resolve(schema)
        if "discriminator" in schema:
            return self._by_type(schema, value, path)
        if "anyOf" in schema:
            return self._by_json_type(schema, value, path)
        known = schema.get("enum", [schema["const"]] if "const" in schema else None)
        if known is not None:
            if value not in known:
                self._report(path, unknown_name(str(path[-1]), value, known))
            return value
        if not _has_type(schema, value):
            self._report(path, f"expected {_expected(schema)}, got {quote(value)}")
            return None
        if schema["type"] == "array":
            return self._list(schema, value, path)
        if schema["type"] == "object":
            return self._object(schema, value, path)
        if fault := _range_fault(schema, value):
            self._report(path, f"expected {fault}, got {quote(value)}")
        return float(value) if schema["type"] == "number" else value

    def _by_type(self, schema: Schema, value: Any, path: Path) -> Any:
        """Read an object whose key ``type`` selects its model."""
        models = {name: {"$ref": reference} for name, reference in schema["discriminator"]["mapping"].items()}
        if not isinstance(value, dict):
            self._report(path, f"expected an object, got {quote(value)}")
        elif "type" not in value:
            self._report(path, f'missing key "type": one of {listed(models)}')
        elif not isinstance(value["type"], str) or value["type"] not in models:
            known = unknown_name("type", value["type"], models)
            self._report((*path, "type"), known + MEANT.get(str(value["type"]), ""))
        else:
            return self._object(self._resolve(models[value["type"]]), value, path, models)
        return None

    def _by_json_type(self, schema: Schema, value: Any, path: Path) -> Any:
        """Read a value that may have one of several JSON types."""
        options = [self._resolve(option) for option in schema["anyOf"]]
        if path[-1:] == ("rotate",) and (fault := rotation_fault(value)):
            self._report(path, fault)
            return None
        for option in options:
            if _has_type(option, value):
                return self.read(option, value, path)
        words = " or ".join(_several(option) for option in options if option["type"] != "null")
        self._report(path, f"expected {words}, got {quote(value)}")
        return None

    def _list(self, schema: Schema, value: list[Any], path: Path) -> Any:
        length = _fixed_length(schema)
        if length and len(value) != length:
            self._report(path, f"expected {_several(schema)}, got {quote(value)}")
            return None
        if len(value) < schema.get("minItems", 0):
            self._report(path, "the list is empty; add at least one entry")
        items = [self.read(schema["items"], item, (*path, i)) for i, item in enumerate(value)]
        return tuple(items) if length else items

    def _object(self, schema: Schema, value: dict[str, Any], path: Path, models: Schema | None = None) -> Any:
        """Read an object; models: by name, those of which it is one."""
        if "properties" not in schema:
            return {
                name: self.read(schema["additionalProperties"], item, (*path, name)) for name, item in value.items()
            }
        known: dict[str, Schema] = schema["properties"]
        read = {key: self._property(schema, key, value, path) for key in known}
        unknown = [key for key in value if key not in known]
        lacking = [key for key in schema.get("required", ()) if key not in value]
        choice = [option["required"][0] for option in schema.get("oneOf", ())]
        present = [key for key in choice if key in value]
        if unknown and (lacking or (choice and not present)):  # a misspelt key is one problem, not two
            misspelt = {meant_key(key, known) for key in unknown[: MAX_PROBLEMS + 1]}
            lacking = [key for key in lacking if key not in misspelt]
            choice = [] if misspelt & set(choice) else choice
        for key in lacking:
            self._report(path, f'missing key "{key}": {known[key]["description"]}')
        if choice and not present:
            others = f"one of {listed(choice[1:])}" if len(choice) > 2 else f'"{choice[1]}"'
            self._report(path, f'missing key "{choice[0]}", or {others} instead')
        for pair in [present[:2], *(rule["not"]["required"] for rule in schema.get("allOf", ()))]:
            if len(pair) == 2 and all(key in value for key in pair):
                self._report((*path, pair[1]), f'"{pair[0]}" and "{pair[1]}" exclude each other; keep one', at_key=True)
        for key in unknown:
            self._report((*path, key), unknown_key(key, known) + self._elsewhere(key, known, models), at_key=True)
        return SimpleNamespace(**read)

    def _elsewhere(self, key: str, known: Schema, models: Schema | None) -> str:
        """Say which other models, or parts of a scene, have a key, if no known one is similar."""
        if meant_key(key, known) is not None:
            return ""
        models = models or {name: part for name, part in _schema()["properties"].items() if "$ref" in part}
        able = [quote(name) for name, model in models.items() if key in self._resolve(model)["properties"]]
        return f"; {', '.join(able)} {'has' if len(able) == 1 else 'have'} it" if able else ""

    def _property(self, model: Schema, key: str, value: dict[str, Any], path: Path) -> Any:
        """Read one key of a model, or its default; None for a key that is absent and has no default."""
        schema = model["properties"][key]
        if key not in value and "default" not in schema:
            return None
        before = len(self.problems)
        read = self.read(schema, value.get(key, schema.get("default")), (*path, key))
        rule = RULES.get((model["title"], key))
        if rule is None or len(self.problems) > before:
            return read
        try:
            return rule(read)
        except ValueError as error:
            self._report((*path, key), str(error))
            return None


def _has_type(schema: Schema, value: Any) -> bool:
    return type(value) in JSON_TYPES[schema["type"]]


def _fixed_length(schema: Schema) -> int:
    """Return the length of a list of fixed length, else 0."""
    length = schema.get("minItems", 0)
    return int(length) if length == schema.get("maxItems") else 0


def _expected(schema: Schema) -> str:
    """Return what a message says of a value of another type."""
    if not _fixed_length(schema):
        return EXPECTED[schema["type"]]
    return "a list of numbers" if schema["items"].get("type") in ("number", "integer") else _several(schema)


def _several(schema: Schema) -> str:
    """Return what a message says of a value, with the length and entries of a list."""
    if schema["type"] != "array":
        return EXPECTED[schema["type"]]
    length, items = _fixed_length(schema), schema["items"]
    entries = "objects" if "$ref" in items else f"lists of {_fixed_length(items)} numbers"
    entries = "numbers" if items.get("type") in ("number", "integer") else entries
    return f"a list of {length} {entries}" if length else f"a list of {entries}"


def _range_fault(schema: Schema, value: Any) -> str:
    """Return what was expected of a string or number that is out of its range, else ""."""
    return next(_range_faults(schema, value), "")


def _range_faults(schema: Schema, value: Any) -> Iterator[str]:
    if "minLength" in schema and len(value) < schema["minLength"]:
        yield "a string that is not empty"
    if "exclusiveMinimum" in schema and not value > schema["exclusiveMinimum"]:
        yield f"a number > {schema['exclusiveMinimum']:g}"
    if "minimum" in schema and not value >= schema["minimum"]:
        yield f"a number >= {schema['minimum']:.12g}"
    if "exclusiveMaximum" in schema and not value < schema["exclusiveMaximum"]:
        yield f"a number < {schema['exclusiveMaximum']:g}"
    if "maximum" in schema and not value <= schema["maximum"]:
        yield f"a number <= {schema['maximum']:.12g}"
