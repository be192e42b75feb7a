"""Valid scenes, read by the shipped JSON Schema alone: importing pydantic takes 0.1 s, which only mistakes are worth.

Whatever does not clearly conform is left to the models, which know what is wrong and say so.
"""

import json
from types import SimpleNamespace
from typing import Any

from raytrace.scene import schema_text
from raytrace.scene.rules import check_film, check_scale, spread_number

TYPES = {"string": str, "integer": int, "boolean": bool, "null": type(None), "array": list, "object": dict}
COMMENTS = {"$schema", "$defs", "title", "description", "default", "discriminator", "maxItems"}  # say nothing more
UNDERSTOOD = COMMENTS | {"$ref", "anyOf", "oneOf", "type", "const", "enum", "prefixItems", "items", "minItems"}
UNDERSTOOD |= {"minLength", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"}
UNDERSTOOD |= {"properties", "required", "additionalProperties"}


class _DoubtError(ValueError):
    """A value does not clearly conform."""


def conform(data: dict[str, Any]) -> SimpleNamespace | None:
    """Read a scene that clearly conforms to the format.

    Parameters
    ----------
    data : dict
        A scene as JSON types.

    Returns
    -------
    types.SimpleNamespace or None
        The same attributes as ``SceneFile`` has; None: ask ``SceneFile``.

    Examples
    --------
    >>> conform({"camera": "none"}) is None
    True
    """
    whole = json.loads(schema_text())
    try:
        scene = _Reader(whole["$defs"]).read(whole, data)
        check_film(scene.film.size)
        for entry in scene.objects:
            entry.scale = check_scale(spread_number(entry.scale))
    except (ValueError, OverflowError):  # the second of a whole number beyond all floats
        return None
    return scene


def _require(true: bool) -> None:
    if not true:
        raise _DoubtError


class _Reader:
    """Reads values by their schemas."""

    def __init__(self, definitions: dict[str, Any]) -> None:
        self._definitions = definitions

    def read(self, schema: dict[str, Any], value: Any) -> Any:
        """The value as the models have it: numbers float, lists of fixed length tuples, defaults filled in."""
        _require(schema.keys() <= UNDERSTOOD)
        if "$ref" in schema:
            return self.read(self._definitions[schema["$ref"].rpartition("/")[2]], value)
        for option in schema.get("anyOf", schema.get("oneOf", ())):
            try:
                return self.read(option, value)
            except _DoubtError:
                continue
        kind = schema.get("type")
        if kind == "number":
            _require(type(value) in (int, float))
            value = float(value)
        else:
            _require(kind in TYPES and type(value) is TYPES[kind])
        self._compare(schema, value)
        if kind == "array":
            return self._list(schema, value)
        return self._object(schema, value) if kind == "object" else value

    def _compare(self, schema: dict[str, Any], value: Any) -> None:
        _require(value == schema.get("const", value) and value in schema.get("enum", (value,)))
        if "minLength" in schema:
            _require(len(value) >= schema["minLength"])
        if isinstance(value, int | float):
            _require(schema.get("minimum", value) <= value <= schema.get("maximum", value))
            _require("exclusiveMinimum" not in schema or value > schema["exclusiveMinimum"])
            _require("exclusiveMaximum" not in schema or value < schema["exclusiveMaximum"])

    def _list(self, schema: dict[str, Any], value: list[Any]) -> Any:
        if "prefixItems" not in schema:
            _require(len(value) >= schema.get("minItems", 0))
            return [self.read(schema["items"], item) for item in value]
        _require(len(value) == schema["minItems"] == schema["maxItems"] == len(schema["prefixItems"]))
        return tuple(self.read(kind, item) for kind, item in zip(schema["prefixItems"], value, strict=True))

    def _object(self, schema: dict[str, Any], value: dict[str, Any]) -> Any:
        if "properties" not in schema:
            return {name: self.read(schema["additionalProperties"], item) for name, item in value.items()}
        known = schema["properties"]
        _require(schema["additionalProperties"] is False and value.keys() <= known.keys())
        _require(set(schema.get("required", ())) <= value.keys())
        return SimpleNamespace(
            **{name: self.read(kind, value.get(name, kind.get("default"))) for name, kind in known.items()}
        )
