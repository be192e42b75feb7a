"""Where machine code is kept: an edit is never missed, and whatever is wrong with a file costs time and no more."""

import errno
import io
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from raytrace import files, jit
from raytrace.native import private_files, store
from raytrace.native.link import Code

ROOT = Path(__file__).parent.parent
NAME, KINDS, CODE = "raytrace.passes.light.background", "float32[1C]", Code(("PyTuple_GetItem",), b"code\n\0with lines")
PROGRAM = """
import sys, numpy as np
from raytrace.jit import on_compile
from raytrace.passes.light import background
from raytrace.records import Hits
hits = Hits(np.zeros(16), np.full(16, -1, np.int32), np.zeros(16), np.zeros(16))
radiance = np.zeros(48)
with on_compile() as compiling:
    background(hits, radiance, np.ones(3))
print(radiance.sum(), compiling.count, "numba" in sys.modules)
"""
COMPILED, LOADED = ["48.0", "1", "True"], ["48.0", "0", "False"]
compiled = pytest.mark.skipif(jit.PLAIN, reason="kernels are plain functions")
nojit = pytest.mark.nojit


def start(program, cache, cwd=ROOT):
    environment = os.environ | {"RAYTRACE_CACHE": str(cache), "PYTHONPATH": str(cwd)}
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=cwd,
    )


def finish(process):
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err
    return out.split()


def run(program, cache, cwd=ROOT):
    return finish(start(program, cache, cwd))


def full_disk(monkeypatch):
    """Let no file be longer than 10 bytes."""

    class Stream(io.FileIO):
        def write(self, content):
            super().write(content[:10])
            raise OSError(errno.ENOSPC, "No space left on device")

    real = open
    written = {"xb": "x", "wb": "w"}

    def choose(file, mode="r", **more):
        return Stream(file, written[mode]) if mode in written else real(file, mode, **more)

    for module in (files, private_files):
        monkeypatch.setattr(module, "open", choose, raising=False)


def copied_package(folder):
    shutil.copytree(store.PACKAGE, folder / "raytrace", ignore=shutil.ignore_patterns("__pycache__"))
    return folder / "raytrace"


# The folder -----------------------------------------------------------------------------------------------------------


@nojit
@pytest.mark.parametrize(
    "edited", ["jit.py", "native/entry.py", "records.py", "accel/lanes.py", "accel/triangle.py", "passes/sampling.py"]
)
def test_an_edit_of_any_kernel_source_gives_a_new_folder(edited, tmp_path, fresh, monkeypatch):
    package = copied_package(tmp_path)
    monkeypatch.setattr(store, "PACKAGE", package)
    before = fresh()
    assert before == fresh()
    (package / "cli.py").write_text("# no kernel is in here\n")
    assert fresh() == before
    source = package / edited
    source.write_bytes(source.read_bytes() + b"\n# an edit\n")
    assert fresh() != before


@nojit
def test_a_new_file_and_a_file_under_another_name_give_new_folders(tmp_path, fresh, monkeypatch):
    package = copied_package(tmp_path)
    monkeypatch.setattr(store, "PACKAGE", package)
    folders = [fresh()]
    another = package / "passes" / "another.py"
    another.write_text("x = 1\n")
    folders.append(fresh())
    another.rename(package / "passes" / "others.py")
    folders.append(fresh())
    assert len(set(folders)) == 3


@nojit
def test_another_processor_other_versions_and_other_switches_have_folders_of_their_own(fresh, monkeypatch):
    folders = [fresh()]
    with monkeypatch.context() as patch:
        patch.setattr(store.llvm, "get_host_cpu_name", lambda: "another")
        folders.append(fresh())
    with monkeypatch.context() as patch:
        features = type("Features", (), {"flatten": lambda self: "+avx2,-avx512f"})
        patch.setattr(store.llvm, "get_host_cpu_features", features)
        folders.append(fresh())
    for package in ("numba", "llvmlite"):
        versions = {name: store._version(name) for name in ("numba", "llvmlite")} | {package: b"9"}
        with monkeypatch.context() as patch:
            patch.setattr(store, "_version", versions.get)
            folders.append(fresh())
    with monkeypatch.context() as patch:
        patch.setenv("NUMBA_BOUNDSCHECK", "1")
        folders.append(fresh())
    assert len(set(folders)) == 6
    assert fresh() == folders[0]


@nojit
def test_versions_are_found_without_an_import():
    program = (
        "import sys; from raytrace.native import store; print(store._version('numba')); print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600, cwd=ROOT)
    from importlib.metadata import version

    assert version("numba") in done.stdout
    assert done.stdout.endswith("False\n")
    assert store._version("pytest").decode() == version("pytest")  # which has no such file of its own


@nojit
def test_the_folder_can_be_chosen(fresh, monkeypatch, tmp_path):
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path / "mine"))
    assert fresh().parent == tmp_path / "mine"
    monkeypatch.delenv("RAYTRACE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform == "linux":
        assert fresh().parent == tmp_path / "raytrace"


# Files ----------------------------------------------------------------------------------------------------------------


@nojit
def test_what_is_kept_is_found(fresh):
    assert store.find(NAME, KINDS) is None
    assert store.keep(NAME, KINDS, CODE)
    assert store.find(NAME, KINDS) == CODE
    assert [path.suffix for path in fresh().iterdir()] == [store.SUFFIX]  # nothing half written


@nojit
def test_no_byte_of_a_file_can_be_wrong(fresh):
    store.keep(NAME, KINDS, CODE)
    path = store.path_of(NAME, KINDS)
    whole = path.read_bytes()
    for place in range(len(whole)):
        path.write_bytes(whole[:place])  # torn
        assert store.find(NAME, KINDS) is None
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert store.find(NAME, KINDS) is None
    for other in (b"", b"\n\n\n", whole + b"\0", bytes(1000)):
        path.write_bytes(other)
        assert store.find(NAME, KINDS) is None
    path.unlink()
    path.mkdir()
    assert store.find(NAME, KINDS) is None
    assert not store.keep(NAME, KINDS, CODE)


@nojit
def test_a_file_of_another_kernel_other_kinds_or_another_folder_is_not_taken(fresh, monkeypatch):
    store.keep(NAME, KINDS, CODE)
    whole = store.path_of(NAME, KINDS).read_bytes()
    for name, kinds in ((NAME, "float64[1C]"), ("raytrace.passes.light.other", KINDS)):
        store.path_of(name, kinds).write_bytes(whole)
        assert store.find(name, kinds) is None
    monkeypatch.setattr(store.llvm, "get_host_cpu_name", lambda: "another")  # a home that two processors share
    fresh().mkdir()
    store.path_of(NAME, KINDS).write_bytes(whole)
    assert store.find(NAME, KINDS) is None


@nojit
def test_code_that_calls_what_python_does_not_have_is_not_taken(fresh):
    store.keep(NAME, KINDS, CODE._replace(outside=("PyTuple_GetItem", "no_such_function")))
    assert store.find(NAME, KINDS) is None


@nojit
def test_kernels_of_others_are_not_kept(fresh):
    assert not store.keep("mine.background", KINDS, CODE)
    assert not fresh().exists()


@nojit
def test_whether_anything_can_be_kept_is_known_beforehand(fresh, monkeypatch, tmp_path):
    assert store.can_keep()
    assert list(fresh().iterdir()) == []
    (tmp_path / "file").touch()
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path / "file"))
    fresh()
    assert not store.can_keep()


@nojit
def test_a_full_disk_leaves_nothing_behind(fresh, monkeypatch):
    store.keep(NAME, "another", CODE)

    full_disk(monkeypatch)
    assert not store.keep(NAME, KINDS, CODE)
    assert not store.can_keep()
    assert len(list(fresh().iterdir())) == 1
    assert store.find(NAME, "another") == CODE


# Old folders ----------------------------------------------------------------------------------------------------------


def make_folder(root, number, days):
    folder = root / f"{number:016x}"
    folder.mkdir(parents=True)
    (folder / f"background-0{store.SUFFIX}").write_bytes(b"old")
    (folder / ".0123.tmp").write_bytes(b"of a process that was killed")
    os.utime(folder, (time.time() - days * store.DAY,) * 2)
    return folder


@nojit
def test_a_new_folder_drives_out_the_oldest_but_none_in_use(fresh):
    root = fresh().parent
    old = [make_folder(root, number, days=2 + number) for number in range(20)]
    used = [make_folder(root, 100 + number, days=0.5) for number in range(3)]
    store.keep(NAME, KINDS, CODE)
    left = {folder for folder in root.iterdir() if folder != fresh()}
    assert left == {*used, *old[: store.FOLDERS - 1 - len(used)]}
    many = [make_folder(root, 200 + number, days=0.1) for number in range(20)]
    store.keep(NAME, "another", CODE)  # into the same folder
    assert all(folder.exists() for folder in (*left, *many))


@nojit
def test_what_is_not_the_stores_is_never_deleted(fresh):
    root = fresh().parent
    for number in range(20):
        make_folder(root, number, days=9)
    mine = root / "pictures"
    mine.mkdir()
    (mine / f"a{store.SUFFIX}").touch()
    empty = root / "fedcba9876543210"  # no kernel is in it
    empty.mkdir()
    for folder in (mine, empty):
        os.utime(folder, (0, 0))
    store.keep(NAME, KINDS, CODE)
    assert mine.exists()
    assert empty.exists()
    assert len(list(root.iterdir())) == 2 + store.FOLDERS


@nojit
def test_looking_for_a_kernel_marks_the_folder_as_used(fresh):
    store.keep(NAME, KINDS, CODE)
    os.utime(fresh(), (0, 0))
    fresh()
    store.find(NAME, KINDS)
    assert store.cache_folder().stat().st_mtime > 1e9  # years after the epoch, where it was put above


# Whole processes ------------------------------------------------------------------------------------------------------


@compiled
def test_the_second_process_loads_what_the_first_compiled_without_numba(tmp_path):
    assert run(PROGRAM, tmp_path) == COMPILED
    (file,) = tmp_path.rglob(f"*{store.SUFFIX}")
    assert file.name.startswith("background-")
    assert run(PROGRAM, tmp_path) == LOADED


@compiled
def test_a_torn_file_is_compiled_anew_and_mended(tmp_path):
    run(PROGRAM, tmp_path)
    (file,) = tmp_path.rglob(f"*{store.SUFFIX}")
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    assert run(PROGRAM, tmp_path) == COMPILED
    assert run(PROGRAM, tmp_path) == LOADED


@compiled
def test_an_edit_of_a_callee_in_another_file_is_compiled(tmp_path):
    package = copied_package(tmp_path)
    assert run(PROGRAM, tmp_path / "cache", tmp_path) == COMPILED
    assert run(PROGRAM, tmp_path / "cache", tmp_path) == LOADED
    callee = package / "accel" / "lanes_jit.py"
    text = callee.read_text("utf-8")
    changed, count = re.subn(
        r"(def _emit_splat\(.*\n    return \w+\(builder, )args\[0\]", r"\1builder.fadd(args[0], args[0])", text
    )
    assert count == 1
    callee.write_text(changed, "utf-8")
    assert run(PROGRAM, tmp_path / "cache", tmp_path) == ["96.0", "1", "True"]
    assert run(PROGRAM, tmp_path / "cache", tmp_path) == ["96.0", "0", "False"]


@compiled
def test_without_a_place_to_write_everything_still_works(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder can be made in a file")
    assert run(PROGRAM, blocked / "below") == COMPILED


@compiled
def test_processes_that_write_at_once_all_come_right(tmp_path):
    processes = [start(PROGRAM, tmp_path) for _ in range(3)]
    for process in processes:
        assert finish(process)[0] == "48.0"
    assert len(list(tmp_path.rglob("*.*"))) == 1
    assert run(PROGRAM, tmp_path) == LOADED


@compiled
def test_equal_sources_give_equal_answers_from_the_compiler_and_from_the_store(tmp_path):
    program = """
import hashlib, raytrace as rt
image = rt.render("scenes/cornell-box-glass.json", size=(48, 48), spp=4)
print(hashlib.sha256(image.rgb.tobytes()).hexdigest())
"""
    assert run(program, tmp_path) == run(program, tmp_path)
