"""Scenes mutated by structure: drawn by hypothesis from the schema, then changed where it hurts."""

import copy
import json
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

ROOT = Path(__file__).parents[2]
SCHEMA = json.loads((ROOT / "raytrace/scene/scene.schema.json").read_text("utf-8"))
MESHES = ["triangle.obj", "cube.obj", "a.obj", "text.ply", "little.ply", "binary.stl", "a.glb", "a.obj.gz"]
STRANGE = ["", "..", "/", "a.txt", "no.obj", "/etc/passwd", "../cube.obj", "file:///etc/passwd", "a\0b.obj", "x" * 300]
STRANGE += ["\n.obj", "\ud800.obj", "é.obj", "~/a.obj", "$HOME/a.obj", "C:\\a.obj", "%2e%2e/a.obj", ".", "a.obj/"]
EDGE = [
    0,
    -0.0,
    1,
    -1,
    0.5,
    1e-320,
    1e-45,
    1e-20,
    1e20,
    1e38,
    3.5e38,
    1e75,
    1.1e75,
    1e154,
    1e300,
    2**53,
    2**64,
    10**299,
]
EDGE += [65536, 65537, 2**31, 179.99999, 180, -180, 360]
WRONG = [
    None,
    True,
    "",
    "1",
    [],
    {},
    [1],
    [1, 2],
    [0, 0, 0],
    [1, 2, 3, 4],
    "sobol",
    "diffuse",
    {"type": "point"},
    10**400,
]
RAW = [
    "NaN",
    "Infinity",
    "-Infinity",
    "1e999",
    "1" * 5000,
    "[" * 500 + "]" * 500,
    "01",
    "+1",
    ".5",
    "'a'",
    "{,}",
    "[1,]",
]
RAW += [
    '"\\ud800"',
    '"\\x"',
    "/**/1",
    "/*",
    "1 // a",
    "//",
    "undefined",
    '"\t"',
    "",
    "1 2",
    '{"a":1,"a":2}',
    "-",
    "1e",
    "true false",
]


VECTOR = st.lists(st.floats(-10, 10), min_size=3, max_size=3)


def numbers(schema: dict[str, Any]) -> st.SearchStrategy[float]:
    """Numbers that a schema allows, usual ones and ones at the edge of what floats hold."""
    low, high = (
        schema.get("minimum", schema.get("exclusiveMinimum")),
        schema.get("maximum", schema.get("exclusiveMaximum")),
    )
    inside = [x for x in EDGE if (low is None or x >= low) and (high is None or x <= high)]
    if schema["type"] == "integer":
        low, high = -10 if low is None else low, 10 if high is None else high
        whole = [x for x in inside if isinstance(x, int) and low <= x <= high]
        return st.one_of(st.integers(low, min(high, low + 20)), st.sampled_from(whole))
    usual = st.floats(-10 if low is None else low, 10 if high is None else high)
    return st.one_of(usual, usual, usual, st.sampled_from(inside))


def of(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Values that a schema allows."""
    if "$ref" in schema:
        return of(SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]])
    for kind in ("anyOf", "oneOf"):
        if kind in schema and all({"$ref", "type", "enum", "const"} & option.keys() for option in schema[kind]):
            return st.one_of(*map(of, schema[kind]))
    if "const" in schema:
        return st.just(schema["const"])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    match schema["type"]:
        case "integer" | "number":
            return numbers(schema)
        case "boolean":
            return st.booleans()
        case "null":
            return st.none()
        case "string":
            return st.sampled_from(["", "a", "white", "ß"])
        case "array" if schema.get("minItems", 0) == schema.get("maxItems"):
            return st.lists(of(schema["items"]), min_size=schema["minItems"], max_size=schema["minItems"])
        case "array":
            return st.lists(of(schema["items"]), min_size=schema.get("minItems", 0), max_size=3)
    if "properties" not in schema:
        return st.dictionaries(st.sampled_from(["white", "glass", "c"]), of(schema["additionalProperties"]), max_size=3)
    known, needed = schema["properties"], schema.get("required", [])
    return st.fixed_dictionaries(
        {key: of(known[key]) for key in needed}, optional={key: of(known[key]) for key in known if key not in needed}
    )


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values within a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, item in items for place in [(*path, key), *places(item, (*path, key))]]


@st.composite
def texts(draw: st.DrawFn) -> str:
    """The text of a scene: valid but for a few places, or all over."""
    scene = draw(of(SCHEMA))
    names = [*scene["materials"], "white"]
    for entry in scene["objects"]:
        mesh = draw(st.sampled_from([*MESHES, *MESHES, *MESHES, draw(st.sampled_from(STRANGE))]))
        ball = {"center": draw(VECTOR), "radius": draw(st.sampled_from([1, 0.1, 1e30]))}
        ball["tolerance"] = draw(st.sampled_from([1, 0.1, 1e-3, 1e-8]))
        shapes = {"mesh": mesh, "sphere": ball, "rectangle": {}, "box": {}}
        shape = draw(st.sampled_from(["mesh", "mesh", "mesh", *shapes]))
        for key in shapes:
            entry.pop(key, None)
        entry[shape] = shapes[shape]
        if draw(st.booleans()):
            entry.pop("matrix", None)
        elif "matrix" in entry:
            for key in ("scale", "rotate", "translate"):
                entry.pop(key, None)
            entry["matrix"][3:] = [[0, 0, 0, 1]]
        entry["material"] = draw(st.sampled_from(names))
    raw: list[str] = []
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 1, 2, 5]))):
        if not (paths := places(scene)):
            break
        *steps, last = draw(st.sampled_from(paths))
        holder = scene
        for step in steps:
            holder = holder[step]
        match draw(st.sampled_from(["edge", "wrong", "raw", "drop", "key", "copy", "repeat"])):
            case "edge":
                holder[last] = draw(st.sampled_from(EDGE))
            case "wrong":
                holder[last] = copy.deepcopy(draw(st.sampled_from(WRONG)))
            case "raw":
                holder[last] = f"@{len(raw)}@"
                raw.append(draw(st.sampled_from(RAW)))
            case "drop":
                del holder[last]
            case "key" if isinstance(holder, dict):
                holder[draw(st.sampled_from([f"{last}s", str(last)[1:], "", "é", "type", "$schema", "x" * 1000]))] = 1
            case "copy":
                holder[last] = copy.deepcopy(draw(st.sampled_from(list(scene.values()) or [0])))
            case "repeat" if isinstance(holder, list):
                holder.extend([copy.deepcopy(holder[last])] * draw(st.sampled_from([1, 3, 50])))
    text = json.dumps(scene, indent=draw(st.sampled_from([None, 1])), ensure_ascii=draw(st.booleans()))
    for k, piece in enumerate(raw):
        text = text.replace(f'"@{k}@"', piece)
    return text
