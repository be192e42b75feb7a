"""Lines and columns of the parts of a JSON text."""

import json

import numpy as np
import pytest

from raytrace.scene.positions import Positions, scan, show

TEXT = """{
  "camera": {"fov": 19.5, "up": [0, 1,
    -2e3]},
  "a \\"b\\"": [],
  "objects": [{"mesh": "x,y]}"}, {"mesh": null}]
}
"""


def place(found: Positions, path: tuple) -> tuple[int, int]:
    return found.line_column(found.value(path))


@pytest.mark.parametrize(
    ("path", "line_column"),
    [
        ((), (1, 1)),
        (("camera",), (2, 13)),
        (("camera", "fov"), (2, 21)),
        (("camera", "up", 0), (2, 34)),
        (("camera", "up", 2), (3, 5)),
        (('a "b"',), (4, 14)),
        (("objects", 0, "mesh"), (5, 24)),
        (("objects", 1, "mesh"), (5, 43)),
        (("objects", 1, "missing"), (5, 34)),
        (("objects", 7, "mesh"), (5, 14)),
    ],
)
def test_value_is_found_or_the_nearest_container(path, line_column):
    assert place(scan(TEXT), path) == line_column


def test_key_is_found_where_there_is_one():
    found = scan(TEXT)
    assert found.line_column(found.key(("objects", 1, "mesh"))) == (5, 35)
    assert found.line_column(found.key(("objects", 1))) == (5, 34)


def test_columns_count_characters():
    found = scan('{"käse 🧀": 1}')
    assert place(found, ("käse 🧀",)) == (1, 12)


def test_windows_line_ends_count_once():
    assert place(scan('{\r\n "a": 1}'), ("a",)) == (2, 7)


def test_repeated_keys_are_told_at_the_second():
    found = scan('{"a": {"x": 1, "y": 2, "x": 3}, "b": [{"x": 1}, {"x": 1}]}')
    assert found.repeated == [(("a", "x"), 23)]


def test_numbers_that_are_not_finite_are_told():
    found = scan('[NaN, 1, 1e999, -Infinity, true, null, "NaN", 1e308, -1e-999]')
    assert found.infinite == [((0,), "NaN"), ((2,), "1e999"), ((3,), "-Infinity")]


def test_deeper_than_the_recursion_limit_is_walked():
    depth = 3_000
    found = scan("[" * depth + "]" * depth, max_depth=10**6)
    assert found.value((0,) * (depth - 1)) == depth - 1


def test_what_lies_too_deep_is_not_looked_at():
    found = scan("[" * 1_000_000, max_depth=5)
    assert max(found.values.values()) == 5


def random_json(rng: np.random.Generator, depth: int) -> object:
    kind = rng.integers(6 if depth else 4)
    if kind == 4:
        return [random_json(rng, depth - 1) for _ in range(rng.integers(4))]
    if kind == 5:
        return {f"k{i}\n\\": random_json(rng, depth - 1) for i in range(rng.integers(4))}
    return [None, -1.5e3, 'a"[{,:\\', True][kind]


def walk(value: object, path: tuple = ()):
    yield path, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for step, part in items:
        yield from walk(part, (*path, step))


@pytest.mark.parametrize("seed", range(20))
def test_every_path_of_any_text_leads_to_its_value(seed):
    rng = np.random.default_rng(seed)
    data = {"root": random_json(rng, 5)}
    text = json.dumps(data, indent=int(rng.integers(4)) or None)
    found = scan(text)
    assert set(found.values) == {path for path, _ in walk(data)}
    for path, value in walk(data):
        assert json.JSONDecoder().raw_decode(text, found.values[path])[0] == value


def test_paths_are_written_the_way_people_do():
    assert show(()) == ""
    assert show(("objects", 1, "mesh")) == "objects[1].mesh"
    assert show(("materials", "red wall", "albedo", 0)) == 'materials["red wall"].albedo[0]'
    assert show(("$schema",)) == '["$schema"]'
    assert show(("line\nbreak",)) == '["line\\nbreak"]'
