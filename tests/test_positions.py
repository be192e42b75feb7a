"""Lines and columns of the parts of a JSON text."""

import json

import numpy as np
import pytest

from raytrace.scene.comments import without_comments
from raytrace.scene.positions import Positions, doubtful, find, show, too_deep

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
        (("camera", "fov", "deeper"), (2, 21)),
        (("objects", "0"), (5, 14)),
        (("camera", 0), (2, 13)),
    ],
)
def test_value_is_found_or_the_nearest_container(path, line_column):
    assert place(find(TEXT, [path]), path) == line_column


def test_key_is_found_where_there_is_one():
    found = find(TEXT, [("objects", 1, "mesh")])
    assert found.line_column(found.key(("objects", 1, "mesh"))) == (5, 35)
    assert found.line_column(found.key(("objects", 1))) == (5, 34)


def test_only_what_is_asked_for_is_kept():
    found = find(TEXT, [("objects", 1, "mesh"), ("camera", "missing")])
    assert set(found.values) == {(), ("camera",), ("objects",), ("objects", 1), ("objects", 1, "mesh")}
    assert set(found.keys) == {("camera",), ("objects",), ("objects", 1, "mesh")}


def test_columns_count_characters():
    path = ("käse 🧀",)
    assert place(find('{"käse 🧀": 1}', [path]), path) == (1, 12)


def test_windows_line_ends_count_once():
    assert place(find('{\r\n "a": 1}', [("a",)]), ("a",)) == (2, 7)


def test_white_space_may_stand_anywhere():
    text = ' \t{ \r\n"a" : [ 1 , [ ] , { } , 2 ] , "b" : 3 } \n'
    found = find(text, [("a", 3), ("b",)])
    assert (text[found.value(("a", 3))], text[found.value(("b",))]) == ("2", "3")


def test_repeated_keys_are_told_at_the_second():
    text = '{"a": {"x": 1, "y": 2, "x": 3}, "b": [{"x": 1}, {"x": 1}], "\\u0061": 1}'
    assert list(doubtful(text)) == [(23, ("a", "x"), ""), (text.index('"\\u'), ("a",), "")]


def test_numbers_that_are_not_finite_are_told():
    found = list(doubtful('[NaN, 1, 1e999, -Infinity, true, null, "NaN", 1e308, -1e-999]'))
    assert found == [(1, (0,), "NaN"), (9, (2,), "1e999"), (16, (3,), "-Infinity")]


def test_a_number_of_many_digits_is_skipped():
    text = f"[{'1' * 10_000}, 0.{'1' * 10_000}, 5]"
    assert text[find(text, [(2,)]).value((2,))] == "5"


def test_what_lies_too_deep_is_found_without_recursion():
    assert too_deep("[" * 3_000 + "]" * 3_000, 3_000) == -1
    assert too_deep("[" * 1_000_000, 5) == 5
    assert too_deep('{"[[[": {"\\"{": [0]}}', 3) == -1
    assert too_deep('[[], [], [[]], "["]', 2) == 10


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
    found = find(text, [path for path, _ in walk(data)])
    assert set(found.values) == {path for path, _ in walk(data)}
    assert list(doubtful(text)) == []
    for path, value in walk(data):
        assert json.JSONDecoder().raw_decode(text, found.values[path])[0] == value


def test_paths_are_written_the_way_people_do():
    assert show(()) == ""
    assert show(("objects", 1, "mesh")) == "objects[1].mesh"
    assert show(("materials", "red wall", "albedo", 0)) == 'materials["red wall"].albedo[0]'
    assert show(("$schema",)) == '["$schema"]'
    assert show(("line\nbreak",)) == '["line\\nbreak"]'
    assert len(show(("k" * 10**6,))) == 200
    assert len(show((" k" * 10**6,) * 1000)) < 500


# Comments -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "bare"),
    [
        ('{"a": 1}', '{"a": 1}'),
        ('{"a": 1} // b', '{"a": 1}     '),
        ('// "\n{"a": 1}', '    \n{"a": 1}'),
        ('{/* " */"a":/**/1}', '{       "a":    1}'),
        ("[1/* /* */,2]", "[1        ,2]"),
        ("[1, // a */ b\r\n2] /* c\nd */", "[1,          \r\n2]     \n    "),
        ('["//", "/*", "*/", "\\"//", 1]', '["//", "/*", "*/", "\\"//", 1]'),
        ('["\\\\"] // b', '["\\\\"]     '),
        ('{"a": "http://b/*"}/**/', '{"a": "http://b/*"}    '),
        ("[1, /*/ 2 */ 3]", "[1,          3]"),
        ("[1, / 2]//", "[1, / 2]  "),
        ('["// no end', '["// no end'),
    ],
)
def test_comments_become_blanks_and_strings_stay(text, bare):
    assert without_comments(text) == (bare, -1)
    assert len(bare) == len(text)


@pytest.mark.parametrize(("text", "offset"), [("[1] /* a", 4), ("/*", 0), ("/*/", 0), ("[/* a */ /*\n* /", 9)])
def test_a_comment_without_an_end_is_found(text, offset):
    assert without_comments(text).unclosed == offset


@pytest.mark.parametrize("seed", range(20))
def test_any_text_means_the_same_with_comments(seed):
    rng = np.random.default_rng(seed)
    text = json.dumps({"root": [random_json(rng, 5), "/* // */", "//"]}, indent=2)
    lines = [
        f"{line} // {line}" if rng.integers(2) else f"/*{line.replace('*/', '')}\n*/{line}" for line in text.split("\n")
    ]
    commented = "\n".join(lines)
    bare = without_comments(commented).text
    assert json.loads(bare) == json.loads(text)
    assert [len(line) for line in bare.split("\n")] == [len(line) for line in commented.split("\n")]
