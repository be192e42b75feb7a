"""What pydantic found wrong with a scene, said the way people say it."""

import re
from typing import Any

from pydantic import BaseModel, ValidationError

from raytrace.scene import schema
from raytrace.scene.first_errors import first_errors
from raytrace.scene.positions import Path
from raytrace.scene.problems import MOST, Problem, at, nearest, quote, unknown_key, unknown_name

MODELS: dict[Path, type[BaseModel]] = {  # "*" stands for any name or index
    (): schema.SceneFile,
    ("camera",): schema.Camera,
    ("film",): schema.Film,
    ("render",): schema.Render,
    ("lights", "*", "point"): schema.PointLight,
    ("lights", "*", "spot"): schema.SpotLight,
    ("lights", "*", "directional"): schema.DirectionalLight,
    ("lights", "*", "environment"): schema.EnvironmentLight,
    ("materials", "*", "diffuse"): schema.Diffuse,
    ("materials", "*", "mirror"): schema.Mirror,
    ("materials", "*", "dielectric"): schema.Dielectric,
    ("materials", "*", "conductor"): schema.Conductor,
    ("materials", "*", "refractive"): schema.Refractive,
    ("objects", "*"): schema.Object,
    ("objects", "*", "rotate"): schema.Rotation,
}
EXPECTED = {  # pydantic's error type -> what should stand there
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a string",
    "string_too_short": "a string that is not empty",
    "tuple_type": "a list of numbers",
    "list_type": "a list",
    "dict_type": "an object",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "greater_than": "a number > {gt:g}",
    "greater_than_equal": "a number >= {ge:.12g}",
    "less_than": "a number < {lt:g}",
    "less_than_equal": "a number <= {le:.12g}",
}


def _keys(place: Path) -> dict[str, str]:
    """Return the keys that an object may have, with their descriptions."""
    named = len(place) > 1 and place[0] in ("lights", "materials", "objects")
    model = MODELS[(place[0], "*", *place[2:]) if named else place]
    return {entry.alias or name: entry.description or "" for name, entry in model.model_fields.items()}


def _tell(error: Any, path: Path, data: Any) -> Problem:
    """Word one error of pydantic's that lies at a path of the data."""
    kind, place, context = error["type"], error["loc"], error.get("ctx", {})
    if kind == "extra_forbidden":
        return Problem(path, unknown_key(place[-1], _keys(place[:-1])), at_key=True)
    if kind == "missing" and isinstance(place[-1], str):
        return Problem(path[:-1], f'missing key "{place[-1]}": {_keys(place[:-1])[place[-1]]}')
    if kind == "union_tag_not_found":
        types = [str(key[2]) for key in MODELS if len(key) == 3 and key[0] == place[0]]
        return Problem(path, f'missing key "type": one of {", ".join(types)}')
    if kind == "union_tag_invalid":
        known = re.findall(r"'([^']*)'", context["expected_tags"])
        return Problem((*path, "type"), unknown_name("type", context["tag"], known))
    if kind == "missing":  # several may be, and the last one tells the length
        path, context = path[:-1], {"max_length": place[-1] + 1}
    value = at(data, path)
    if kind in ("missing", "too_long"):
        return Problem(path, f"expected a list of {context['max_length']} numbers, got {quote(value)}")
    if kind == "too_short":
        return Problem(path, "the list is empty; add at least one entry")
    if kind == "literal_error":
        return Problem(path, unknown_name(str(path[-1]), value, re.findall(r"'([^']*)'", context["expected"])))
    if kind == "value_error":
        return Problem(path, str(context["error"]))
    expected = EXPECTED[kind].format(**context)
    if path[-1:] == ("scale",):
        expected = "a number or a list of 3 numbers"
    return Problem(path, f"expected {expected}, got {quote(value)}")


def tell(error: ValidationError, data: Any) -> list[Problem]:
    """Word all that pydantic found wrong with a scene.

    Parameters
    ----------
    error : pydantic.ValidationError
        Of ``SceneFile.model_validate(data)``.
    data : object
        The scene as JSON types.

    Returns
    -------
    list of Problem
        In pydantic's order; several numbers that lack in one list are one problem, and so are a misspelt key and the
        lack of the right one.
    """
    errors = first_errors(error, data).errors(include_url=False)[: MOST + 1]
    # a number that lacks is an error each; the last one of a list stands for all
    lacking = {entry["loc"][:-1]: entry for entry in errors if entry["type"] == "missing"}
    unknown = [entry["loc"] for entry in errors if entry["type"] == "extra_forbidden"]
    misspelt = {(*loc[:-1], nearest(loc[-1], _keys(loc[:-1]))) for loc in unknown}
    told = []
    for entry in errors:
        path = entry["loc"]
        is_other_number = isinstance(path[-1], int) and lacking.get(path[:-1]) is not entry
        if entry["type"] == "missing" and (path in misspelt or is_other_number):
            continue
        if path[0] in ("materials", "lights") and len(path) > 2:
            path = path[:2] + path[3:]  # pydantic puts the type there, which is no step in the file
        told.append(_tell(entry, path, data))
    return told
