"""Where goldens lie: any name of a test is a name of a file, and no two names are the same file."""

import os
from pathlib import Path

import numpy as np
import pytest

from raytrace.golden import locations as module
from raytrace.golden.check import Golden
from raytrace.golden.locations import GoldenLocation, relative

GREY = np.full((16, 16, 3), 0.5)
NAMES = [
    "test_word[\\xe9]",
    "test_word[a\\b]",
    "test_word[%5C]",
    "test_word[\\]",
    "test_word[100%]",
    "test_word[a:b]",
    'test_word[<x>|"?*]',
    "test_word[a/b]",
    "test_word[]",
    "test_word[..]",
    "test_word[\\u2603]",
    "test_word[é]",
    "test_word[a b]",
    "test_word[\x01]",
]


@pytest.fixture
def location(tmp_path):
    return GoldenLocation(
        tmp_path / "tests" / "golden", tmp_path, tmp_path / "left", tmp_path, "tests/test_a.py::test_a"
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_name_of_any_test_is_the_name_of_a_golden(location, name):
    Golden(location, {}, update=True).check(GREY, name)
    assert Golden(location, {}, update=False).check(GREY, name)
    with pytest.raises(AssertionError, match=r"see left/.*\.html"):
        Golden(location, {}, update=False).check(2 * GREY, name)
    written = [path for path in location.root.rglob("*") if path.is_file()]
    assert len(written) == 4
    assert not any(set('\\<>:"|?*\x01') & set(str(path.relative_to(location.root))) for path in written)


def test_names_stay_apart(location):
    files = [location.golden(name) for name in NAMES] + [location.failure_file(name, ".html") for name in NAMES]
    assert len(set(files)) == len(files)


def test_plain_names_are_as_they_are(location):
    assert location.golden("shapes/box-1 %5") == location.folder / "shapes" / "box-1 %5.npz"
    assert location.golden("a:b") == location.folder / "a%3Ab.npz"


@pytest.mark.skipif(os.name == "nt", reason="no such file there")
def test_a_golden_that_was_named_otherwise_before_is_found(location):
    location.folder.mkdir(parents=True)
    (location.folder / "a:b.npz").touch()
    assert location.golden("a:b") == location.folder / "a:b.npz"


@pytest.mark.parametrize("name", ["x" * 300, "é" * 120, "shapes/" + "x" * 300])
def test_a_name_too_long_says_so(location, name):
    with pytest.raises(ValueError, match=r"name: longer than 180 bytes: '") as failure:
        Golden(location, {}, update=True).check(GREY, name)
    assert len(str(failure.value)) < 200


def another_drive(path, start):
    raise ValueError("path is on mount 'D:', start on mount 'C:'")


def test_files_on_another_drive_have_whole_paths(location, monkeypatch):
    monkeypatch.setattr(os.path, "relpath", another_drive)
    assert relative(Path("a/b"), Path("c")) == str(Path("a/b"))
    with pytest.raises(AssertionError) as failure:
        Golden(location, {}, update=False).check(GREY, "box")
    assert f"there is no {location.folder / 'box.npz'}: " in str(failure.value)
    assert str(failure.value).endswith(str(location.root / "left" / "tests" / "golden" / "box.html"))


def test_the_command_is_quoted_for_the_shell_of_the_system(location, monkeypatch):
    assert location._replace(test="a.py::b[1]").command == "pytest --update-goldens 'a.py::b[1]'"
    monkeypatch.setattr(module, "os", type("Windows", (), {"name": "nt"}))
    assert location._replace(test="a.py::b[1]").command == 'pytest --update-goldens "a.py::b[1]"'
    assert location._replace(test="a.py::b").command == "pytest --update-goldens a.py::b"
