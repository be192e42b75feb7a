"""Reading a scene takes steps that are linear in its size, whatever it holds, and few lines tell what is wrong."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import raytrace as rt
from raytrace.errors import FileError, SceneError
from raytrace.scene.problems import LISTED, MOST, listed, nearest, unknown_name

ROOT = Path(__file__).parents[1]
WHITE = {"type": "diffuse", "albedo": [1, 1, 1]}
CAMERA = {"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 40}
LIGHT = {"type": "point", "position": [0, 0, 5], "flux": [1, 1, 1]}
BASE = {"camera": CAMERA, "lights": [LIGHT], "materials": {"w": WHITE}, "objects": [{"mesh": "a.obj", "material": "w"}]}
COURSE = {"integrator": {"type": "intersection_test"}, "camera": {}, "materials": {}, "objects": []}
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\n"


def objects(entry):
    """A scene of many objects."""

    def make(n):
        entries = [{"mesh": "a.obj", "material": "w", **entry(i)} for i in range(n)]
        return {**BASE, "objects": [{key: value for key, value in e.items() if value is not ...} for e in entries]}

    return make


def materials(name, entry=WHITE):
    """A scene of many materials; each object uses the next."""
    return lambda n: {**BASE, "materials": {"w": WHITE} | {name(i): entry for i in range(n)}}


DICTS = {  # name -> content, of n parts
    "materials that nothing uses": materials("m{}".format),
    "objects": objects(lambda i: {"translate": [i, 0, 0]}),
    "degenerate objects": objects(lambda i: {"mesh": "line.obj"}),
    "unknown materials": lambda n: (
        objects(lambda i: {"material": f"number {i}"})(n) | {"materials": {f"numbre {i}": WHITE for i in range(n)}}
    ),
    "the same unknown material": objects(lambda i: {"material": "x"}),
    "missing meshes": objects(lambda i: {"mesh": f"b{i}.obj"}),
    "the same missing mesh": objects(lambda i: {"mesh": "b.obj"}),
    "missing meshes beside another mistake": lambda n: objects(lambda i: {"mesh": f"b{i}.obj"})(n) | {"film": 1},
    "meshes elsewhere": objects(lambda i: {"mesh": f"../{i}.obj"}),
    "lights that are none": lambda n: {**BASE, "lights": [1] * n},
    "objects of wrong types": objects(lambda i: {"mesh": 1, "material": 2, "x": 3, "rotate": 4, "scale": "5"}),
    "wrong objects after right ones": lambda n: {**BASE, "objects": BASE["objects"] * n + [{"mesh": 1}] * n},
    "wrong materials": materials("m{}".format, {"type": "diffus"}),
    "unknown keys": lambda n: {**BASE, **{f"k{i}": 1 for i in range(n)}},
    "unknown keys of a material": materials(lambda i: "m", {"type": "diffuse", **{f"k{i}": 1 for i in range(3000)}}),
    "a long list": lambda n: {**BASE, "background": ["a"] * n},
    "a long description": lambda n: {**BASE, "about": "\x1b" * n, "film": 1},
    "a long key": lambda n: {**BASE, "k" * n: 1},
    "a long name with many mistakes": lambda n: {**BASE, "materials": {"k" * n: {f"q{i}": 1 for i in range(200)}}},
    "many axes without direction": lambda n: objects(lambda i: {"rotate": [{"axis": [0, 0, 0], "angle": 1}] * n})(1),
    "many rotations": lambda n: objects(lambda i: {"rotate": [{"axis": [0, 0, 1], "angle": 1}] * n})(1),
    "spheres": objects(lambda i: {"mesh": ..., "sphere": {"center": [i, 0, 0], "radius": 1, "tolerance": 1}}),
    "no shapes": objects(lambda i: {"mesh": ...}),
    "misspelt shapes": objects(lambda i: {"mesh": ..., f"spere{i}": {}}),
    "axes without direction": objects(lambda i: {"rotate": {"axis": [0, 0, 0], "angle": 1}}),
    "the course's objects": lambda n: COURSE | {"objects": [{"path": 1, "q": 2}] * n},
    "the course's textures": lambda n: (
        COURSE
        | {
            "textures": {f"number {i}": {"type": "constant", "color": [1, 1, 1]} for i in range(n)},
            "materials": {f"m{i}": {"type": "diffuse", "texture_name": f"numbre {i}"} for i in range(n)},
        }
    ),
}
TEXTS = {
    "blanks after the end": lambda n: '{"film": {"sise": 1}}' + " " * n,
    "blanks within": lambda n: '{"film": {' + " \n\t" * n + '"sise": 1}}',
    "lines": lambda n: '{"film": {"sise": 1}' + "\n" * n + "}",
    "a repeated key": lambda n: '{"a": 1' + ', "a": 1' * n + "}",
    "many repeated keys": lambda n: "{" + ",".join(f'"a{i % n}": 1' for i in range(2 * n)) + "}",
    "infinite numbers": lambda n: '{"a": [' + ",".join(["1e999"] * n) + "]}",
    "digits": lambda n: '{"a": ' + "1" * n + "}",
    "digits after the point": lambda n: '{"film": 0.' + "1" * n + "}",
    "digits of an exponent": lambda n: '{"film": 1e-' + "1" * n + "}",
    "brackets": lambda n: "[" * n,
    "objects in each other": lambda n: '{"a":' * n + "1" + "}" * n,
    "many entries deep within": lambda n: '{"film": ' + "[" * 90 + ",".join(["1"] * n) + "]" * 90 + "}",
    "comments": lambda n: '{"film": 1' + " /* a */ // b\n" * n + "}",
    "comments without an end": lambda n: '{"film": 1 ' + "/*/" * n,
    "slashes": lambda n: '{"film": ' + "/" * n,
    "quotes after a comment": lambda n: '// c\n{"a": "' + '\\"' * n,
    "quotes": lambda n: '{"a' + '"' * n,
    "backslashes": lambda n: '{"a": "' + "\\\\" * n + '", "film": 1}',
    "halves of characters": lambda n: '{"a": ["\\ud83d\\ude00"' + ', "\\ud83d\\ude00"' * n + "]}",
}
CASES = {name: lambda n, make=make: json.dumps(make(n)) for name, make in DICTS.items()} | TEXTS


def write(folder, text):
    (folder / "a.obj").write_text(OBJ + "f 1 2 3\n")
    (folder / "line.obj").write_text(OBJ + "f 1 2 4\n")
    path = folder / "scene.json"
    path.write_text(text)
    return path


def steps(path):
    """Calls of functions, Python's and C's, that loading takes; lines of its error, or warnings."""
    count = 0

    def note(_frame, event, _argument):
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        told = rt.load(path).warnings
    except (SceneError, FileError) as error:
        told = str(error).splitlines()
    finally:
        sys.setprofile(before)
    return count, told


@pytest.mark.parametrize("name", CASES)
def test_twice_the_size_takes_twice_the_steps_at_most(tmp_path, name):
    path = write(tmp_path, CASES[name](1000))
    steps(path)  # imports
    (few, _), (many, told) = steps(path), steps(write(tmp_path, CASES[name](2000)))
    assert many <= 2.5 * few + 2000  # a search among the first errors adds a logarithm
    assert len(told) <= MOST + 1
    assert max(map(len, told), default=0) < 1000


PROGRAM = """
import sys
import raytrace as rt
for path in sys.argv[1:]:
    try:
        rt.load(path)
    except (rt.SceneError, rt.FileError) as error:
        print(len(str(error)))
"""


def test_what_a_count_of_calls_does_not_see_ends_as_well(tmp_path):
    """A quadratic search takes hours on these, a linear one seconds: the limit is only a net."""
    paths = []
    for k, (name, make) in enumerate(TEXTS.items()):
        (tmp_path / str(k)).mkdir()
        paths.append(write(tmp_path / str(k), make(400_000 if "deep" not in name else 100_000)))
    words = [sys.executable, "-c", PROGRAM, *map(str, paths)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=1200, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]
    assert len(done.stdout.split()) == len(paths)
    assert max(map(int, done.stdout.split())) < 100_000


# Bounds ---------------------------------------------------------------------------------------------------------------


def test_few_of_many_names_are_compared(monkeypatch):
    seen = []
    monkeypatch.setattr("difflib.get_close_matches", lambda word, names, n: seen.append((word, list(names))) or [])
    assert nearest("x" * 10**6, ("y" * 10**6 + str(i) for i in range(10**9))) is None  # ends: it takes the first
    ((word, names),) = seen
    assert len(word) <= 100
    assert len(names) <= 1000
    assert max(map(len, names)) <= 100


def test_a_message_lists_few_of_many_names():
    names = [f"m{i}" for i in range(10**5)]
    assert listed(names) == ", ".join(names[:LISTED]) + " and 99,980 more"
    text = unknown_name("material", "m17x", dict.fromkeys(names))
    assert '; did you mean "m17"?' in text
    assert "did you mean" not in unknown_name("material", "m17x", names, hint=False)


def test_warnings_that_are_left_out_are_counted(tmp_path):
    scene = rt.load(write(tmp_path, json.dumps(DICTS["materials that nothing uses"](250) | {"lights": []})))
    assert len(scene.warnings) == MOST + 1
    assert scene.warnings[-1].endswith("scene.json: and 151 more warnings")
    assert any("no lights" in line for line in scene.warnings)
