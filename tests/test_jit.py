"""Where compiled kernels are kept, and that an edit is never missed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from raytrace import jit

ROOT = Path(__file__).parent.parent
PROGRAM = """
import numpy as np
from raytrace.jit import on_compile
from raytrace.passes.light import background
from raytrace.records import Hits
hits = Hits(np.zeros(16), np.full(16, -1, np.int32), np.zeros(16), np.zeros(16))
radiance = np.zeros(48)
with on_compile() as compiling:
    background(hits, radiance, np.ones(3))
print(radiance.sum(), compiling.count)
"""


def run(program, cache, cwd=ROOT):
    environment = os.environ | {"RAYTRACE_CACHE": str(cache), "PYTHONPATH": str(cwd)}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        timeout=300,
        env=environment,
        cwd=cwd,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture
def folder_name(monkeypatch):
    """Name of the cache folder of a package, computed anew."""

    def name(package):
        monkeypatch.setattr(jit, "PACKAGE", package)
        jit.cache_folder.cache_clear()
        return jit.cache_folder().name

    yield name
    monkeypatch.undo()
    jit.cache_folder.cache_clear()


@pytest.mark.nojit
@pytest.mark.parametrize(
    "edited", ["jit.py", "records.py", "accel/lanes.py", "accel/triangle.py", "passes/sampling.py"]
)
def test_an_edit_of_any_kernel_source_gives_a_new_folder(edited, tmp_path, folder_name):
    package = tmp_path / "raytrace"
    shutil.copytree(jit.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = folder_name(package)
    assert before == folder_name(package)
    (package / "cli.py").write_text("# no kernel is in here\n")
    assert folder_name(package) == before
    source = package / edited
    source.write_bytes(source.read_bytes() + b"\n# an edit\n")
    assert folder_name(package) != before


@pytest.mark.nojit
def test_a_new_file_gives_a_new_folder(tmp_path, folder_name):
    package = tmp_path / "raytrace"
    shutil.copytree(jit.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = folder_name(package)
    (package / "passes" / "another.py").write_text("x = 1\n")
    assert folder_name(package) != before


@pytest.mark.nojit
def test_code_with_checked_bounds_has_a_folder_of_its_own(monkeypatch, folder_name):
    before = folder_name(jit.PACKAGE)
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    assert folder_name(jit.PACKAGE) != before


@pytest.mark.nojit
def test_the_folder_can_be_chosen(monkeypatch, tmp_path, folder_name):
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path / "mine"))
    folder_name(jit.PACKAGE)
    assert jit.cache_folder().parent == tmp_path / "mine"


def test_kernels_are_kept_and_then_loaded(tmp_path):
    first, second = run(PROGRAM, tmp_path), run(PROGRAM, tmp_path)
    assert first[0] == second[0] == "48.0"
    assert int(first[1]) > 0
    assert second[1] == "0"
    assert any(path.suffix == ".nbi" for path in tmp_path.rglob("*"))


def test_an_edit_of_a_callee_in_another_file_is_compiled(tmp_path):
    """What Numba's own cache does not see."""
    shutil.copytree(jit.PACKAGE, tmp_path / "raytrace", ignore=shutil.ignore_patterns("__pycache__"))
    assert run(PROGRAM, tmp_path / "cache", tmp_path)[0] == "48.0"
    callee = tmp_path / "raytrace" / "accel" / "lanes_jit.py"
    text = callee.read_text("utf-8")
    changed, count = re.subn(
        r"(def _emit_splat\(.*\n    return \w+\(builder, )args\[0\]", r"\1builder.fadd(args[0], args[0])", text
    )
    assert count == 1
    callee.write_text(changed, "utf-8")
    assert run(PROGRAM, tmp_path / "cache", tmp_path)[0] == "96.0"


def test_without_a_place_to_write_everything_still_works(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder can be made in a file")
    total, compiled = run(PROGRAM, blocked / "below")
    assert total == "48.0"
    assert int(compiled) > 0


def test_compiling_is_counted_and_announced_once():
    announced = []

    @numba.njit
    def add(a, b):
        return a + b

    with jit.on_compile(lambda: announced.append(True)) as compiling:
        add(1, 2)
        assert compiling.count > 0
        count, seconds = compiling.count, compiling.seconds
        assert seconds > 0
        add(3, 4)
        assert compiling.count == count
        add(1.0, 2.0)
        assert compiling.count > count
        assert compiling.seconds > seconds
    assert announced == [True]
    count = compiling.count
    add(1j, 2j)  # after the end nothing is counted
    assert compiling.count == count


def test_kernels_let_go_of_the_interpreter():
    @jit.kernel
    def double(a):
        for i in range(len(a)):
            a[i] *= 2

    assert double.targetoptions["nogil"]
    assert double.targetoptions["error_model"] == "numpy"
    assert not double.targetoptions.get("fastmath")
