import platform
import sys

import pytest

import raytrace
from raytrace import doctor


def test_versions_processor_and_cache_are_named():
    found = dict(doctor.findings())
    assert found["raytrace"] == raytrace.__version__
    assert platform.python_version() in found["python"]
    assert {*doctor.REQUIRED, *doctor.OPTIONAL, "processor", "lanes", "cores", "cache"} <= found.keys()


def test_a_missing_extra_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(doctor, "OPTIONAL", {"no-such-package": "EXR files"})
    assert dict(doctor.findings())["no-such-package"] == "not installed (for EXR files: pip install no-such-package)"


def test_a_machine_without_a_working_compiler_is_described_all_the_same(monkeypatch):
    monkeypatch.setitem(sys.modules, "raytrace.native.store", None)  # importing it raises ImportError
    found = dict(doctor.findings())
    assert found["kernels"].startswith("cannot be run: ")
    assert "cores" in found


@pytest.mark.parametrize("depth", [0, 3])
def test_a_folder_is_writable_where_it_can_be_made(tmp_path, depth):
    assert doctor._writable(tmp_path.joinpath(*"abc"[:depth]))


def test_a_folder_below_a_file_is_not_writable(tmp_path):
    (tmp_path / "file").touch()
    assert not doctor._writable(tmp_path / "file" / "folder")
