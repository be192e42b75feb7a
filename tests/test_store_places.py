"""Where kernels are kept: every odd place works, or one line says why it does not."""

import logging
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import platformdirs
import pytest

from raytrace import doctor, jit
from raytrace.errors import FileError
from raytrace.native import location, private_files, store
from raytrace.native.link import Code

ROOT = Path(__file__).parent.parent
NAME, KINDS, CODE = "raytrace.passes.light.background", "float32[1C]", Code(("PyTuple_GetItem",), b"code")
VARIABLES = "RAYTRACE_CACHE", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"
PROGRAM = """
import sys, numpy as np
from raytrace.jit import on_compile
from raytrace.passes.light import background
from raytrace.records import Hits
hits = Hits(np.zeros(16), np.full(16, -1, np.int32), np.zeros(16), np.zeros(16))
radiance = np.zeros(48)
with on_compile() as compiling:
    background(hits, radiance, np.ones(3))
print(radiance.sum(), compiling.count)
"""
compiled = pytest.mark.skipif(jit.PLAIN, reason="kernels are plain functions")
posix = pytest.mark.skipif(not private_files.POSIX, reason="owners and modes are POSIX")
linux = pytest.mark.skipif(sys.platform != "linux", reason="places as on Linux")


def run(program, **environment):
    known = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=300, cwd=ROOT,
        env=known | {"PYTHONPATH": str(ROOT)} | {name: str(value) for name, value in environment.items()},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr


# What the folder depends on -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["NUM_THREADS", "CACHE_DIR", "DEBUG_CACHE", "THREADING_LAYER", "WARNINGS", "ANY"])
def test_variables_that_do_not_change_machine_code_do_not_change_the_folder(fresh, monkeypatch, name):
    before = fresh()
    monkeypatch.setenv(f"NUMBA_{name}", "3")
    assert fresh() == before


@pytest.mark.parametrize("name", ["OPT", "BOUNDSCHECK", "SLP_VECTORIZE", "LOOP_VECTORIZE", "CPU_NAME", "CPU_FEATURES"])
def test_variables_that_change_machine_code_change_the_folder(fresh, monkeypatch, name):
    monkeypatch.delenv(f"NUMBA_{name}", raising=False)
    before = fresh()
    monkeypatch.setenv(f"NUMBA_{name}", "1")
    assert fresh() != before


def test_numbas_file_of_settings_counts_as_its_variables_do(fresh, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = fresh()
    (tmp_path / store.CONFIG).write_text("opt: 1\n")
    assert fresh() != before


def test_kernels_for_a_named_processor_are_shared_by_unlike_ones(fresh, monkeypatch):
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    before = fresh()
    monkeypatch.setattr(store.llvm, "get_host_cpu_name", lambda: "another")
    assert fresh() == before
    monkeypatch.setattr(store, "register_bits", lambda: 64)  # but they must have registers of one width
    assert fresh() != before


# Where it lies --------------------------------------------------------------------------------------------------------


def test_a_home_folder_and_relative_paths_are_made_absolute(fresh, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.setenv("RAYTRACE_CACHE", "~/mine")
    assert fresh().parent == tmp_path / "mine"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RAYTRACE_CACHE", "mine")
    folder = fresh()
    assert folder.parent == tmp_path / "mine"
    monkeypatch.chdir("/")
    assert store.cache_folder() == folder


@linux
def test_without_a_usable_home_numbas_folder_is_used(fresh, monkeypatch, tmp_path):
    monkeypatch.delenv("RAYTRACE_CACHE")
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "below"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert fresh().parent == tmp_path / "numba" / "raytrace"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "good"))
    assert fresh().parent == tmp_path / "good" / "raytrace"


def test_without_any_place_a_line_says_what_to_do(fresh, monkeypatch, caplog):
    def homeless(*_, **__):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("RAYTRACE_CACHE")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_dir", homeless)
    with pytest.raises(FileError, match=r"no home folder .*; set RAYTRACE_CACHE"):
        fresh()
    with caplog.at_level(logging.WARNING, "raytrace"):
        for kinds in (KINDS, "another"):
            assert store.find(NAME, kinds) is None
            assert not store.keep(NAME, kinds, CODE)
    (line,) = caplog.messages
    assert line.startswith("every process compiles its kernels: there is no home folder to keep them in; set RAYTRACE")
    assert not store.can_keep()
    assert dict(doctor.findings())["cache"].startswith("none: there is no home folder")
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda *_, **__: "~/.cache/raytrace")  # as older releases do
    with pytest.raises(FileError, match="no home folder"):
        fresh()
    monkeypatch.setenv("RAYTRACE_CACHE", "~no-such-user/kernels")
    with pytest.raises(FileError, match="RAYTRACE_CACHE=~no-such-user/kernels: there is no such home folder"):
        fresh()
    monkeypatch.setenv("RAYTRACE_CACHE", "/")  # for what comes after the test


@posix
def test_root_leaves_nothing_in_the_home_folder_of_a_user(fresh, monkeypatch, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setattr(private_files.os, "geteuid", lambda: 0)
    real = os.stat

    def foreign(path, *rest, **more):
        status = real(path, *rest, **more)
        return os.stat_result((*status[:4], 1234, *status[5:10])) if path == home else status

    monkeypatch.setattr(os, "stat", foreign)
    reason = location._problem(home / "raytrace", "0" * 16)
    assert reason == f"this process runs as root, {home} belongs to another user (uid 1234)"


@pytest.mark.parametrize("name", ["x" * 300, "file/below", "file"])
def test_a_folder_that_cannot_be_made_is_told_once(fresh, monkeypatch, caplog, tmp_path, name):
    (tmp_path / "file").touch()
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path / name))
    fresh()
    with caplog.at_level(logging.WARNING, "raytrace"):
        for _ in range(2):
            assert store.find(NAME, KINDS) is None
            assert not store.keep(NAME, KINDS, CODE)
    (line,) = caplog.messages
    assert line.startswith(f"every process compiles its kernels: {tmp_path / name}")
    assert line.endswith("; set RAYTRACE_CACHE to a folder that can be written to")
    assert "NOT writable" in dict(doctor.findings())["cache"]


# Zip files and frozen programs ----------------------------------------------------------------------------------------


def zipped(path, changed=""):
    with zipfile.ZipFile(path, "w") as archive:
        for source in sorted((ROOT / "raytrace").rglob("*")):
            if source.is_file() and source.suffix != ".pyc":
                text = source.read_bytes()
                if source.name == "light.py":
                    text += changed.encode()
                archive.writestr(source.relative_to(ROOT).as_posix(), text)
    return path


@compiled
def test_two_versions_in_zip_files_do_not_share_machine_code(tmp_path):
    double = "\n\n@kernel\ndef background(hits, radiance, colour):\n    for i in range(len(radiance)):\n"
    double += "        radiance[i] = 2.0 * colour[0]\n"
    program = PROGRAM.replace("import sys,", "import sys; sys.path.insert(0, sys.argv[1]); import")
    for name, changed, expected in (("one", "", "48.0"), ("two", double, "96.0")):
        archive = zipped(tmp_path / f"{name}.zip", changed)
        for count in ("1", "0"):
            done = subprocess.run(
                [sys.executable, "-I", "-c", program, str(archive)], capture_output=True, text=True, timeout=300,
                cwd=tmp_path, env=os.environ | {"RAYTRACE_CACHE": str(tmp_path / "cache")},
            )  # fmt: skip
            assert done.stdout.split() == [expected, count], done.stderr


def test_without_sources_nothing_is_kept_and_a_line_says_so(fresh, monkeypatch, caplog, tmp_path):
    monkeypatch.setattr(store, "PACKAGE", tmp_path)
    monkeypatch.setattr(store.sources, "_source", lambda name: None)
    with caplog.at_level(logging.WARNING, "raytrace"):
        with pytest.raises(FileError, match="sources"):
            fresh()
        assert store.find(NAME, KINDS) is None
        assert not store.keep(NAME, KINDS, CODE)
    assert len(caplog.messages) == 1
    monkeypatch.undo()


def test_loaders_give_the_sources_that_folders_have():
    """In a process of its own: pytest puts another loader in the place of Python's."""
    program = """
from raytrace.native import sources, store
names = {name.removesuffix(".py").removesuffix("/__init__"): content for name, content in sources.read(store.PACKAGE)}
loaded = {name.removeprefix("raytrace.").replace(".", "/"): content for name, content in sources._from_loaders()}
print(len(names), loaded == names)
"""
    (count, equal), _ = run(program)
    assert int(count) > 30
    assert equal == "True"


# Whole processes ------------------------------------------------------------------------------------------------------


@compiled
@linux
def test_without_a_home_the_second_process_is_quick_or_a_line_says_why_not(tmp_path):
    nowhere = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/x"}
    for count in ("1", "0"):
        found, said = run(PROGRAM, NUMBA_CACHE_DIR=tmp_path, **nowhere)
        assert (found, said) == (["48.0", count], "")
    found, said = run(PROGRAM, **nowhere)
    assert found == ["48.0", "1"]
    assert said.startswith(
        "every process compiles its kernels: /dev/null/x/raytrace: /dev/null is not a folder; set RAY"
    )
    assert said.count("\n") == 1
