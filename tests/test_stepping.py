"""docs/stepping.md: kernels as plain Python, in which print and the debugger work; what the page shows is run."""

import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

import raytrace as rt
from kernels import a_kernel
from raytrace.accel.lanes import packet_width
from raytrace.jit import PLAIN
from test_docs import ROOT, blocks

FILE = "scenes/cornell-box-glass.json"
WIDE = pytest.mark.skipif(packet_width(np.zeros(1, np.float32)) < 4, reason="the page shows four lanes")


def python(*words, folder=ROOT, **more):
    here = {"PYTHONPATH": str(folder), "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=600, cwd=ROOT, env=os.environ | here, **more
    )
    return done.stdout + done.stderr


@pytest.mark.parametrize("size", [(4, 4), (5, 3)])
def test_the_picture_has_the_same_bits(size, tmp_path):
    if PLAIN:
        pytest.skip("there is nothing to compare with")
    script = f"import sys, raytrace as rt; rt.render({FILE!r}, spp=2, size={size}, aov=['depth']).save(sys.argv[1])"
    python("-c", script, str(tmp_path / "plain.npz"))
    with np.load(tmp_path / "plain.npz") as plain:
        compiled = rt.render(FILE, spp=2, size=size)
        np.testing.assert_array_equal(plain["rgb"], compiled.rgb)
        np.testing.assert_array_equal(plain["stderr"], compiled.stderr)
        np.testing.assert_array_equal(plain["depth"], compiled.aov["depth"])


@WIDE
def test_a_print_in_a_kernel_prints_what_the_page_shows(tmp_path):
    (line,), (script,), (shown,) = (blocks("stepping.md", mark) for mark in ("print", "script", "printed"))
    shutil.copytree(ROOT / "raytrace", tmp_path / "raytrace", ignore=shutil.ignore_patterns("__pycache__"))
    kernel = tmp_path / "raytrace" / "passes" / "refraction.py"
    above = "        eta = select(front, ior, 1.0 / ior)\n"
    text = kernel.read_text("utf-8")
    assert text.count(above) == 1
    kernel.write_text(text.replace(above, above + line), "utf-8")
    (tmp_path / "step.py").write_text(script, "utf-8")
    assert python(str(tmp_path / "step.py"), folder=tmp_path).splitlines() == shown.splitlines()[1:]


@WIDE
def test_the_debugger_shows_what_the_page_shows(tmp_path):
    (script,), (session,) = blocks("stepping.md", "script"), blocks("stepping.md", "pdb")
    (tmp_path / "step.py").write_text(script, "utf-8")
    lines = session.splitlines()[1:]
    commands = [line.removeprefix("(Pdb) ") for line in lines if line.startswith("(Pdb) ")]
    expected = [line for line in lines if not line.startswith("(Pdb) ")]
    found = python("-m", "pdb", str(tmp_path / "step.py"), input="\n".join(commands) + "\n")
    answers = [re.sub(r"^(\(Pdb\) )+", "", line) for line in found.splitlines()]
    kept = [line for line in answers if line in expected]
    assert kept == expected, found


def test_one_thread_is_the_caller_s():
    script = f"""
import threading, raytrace as rt
from raytrace.passes import refraction
snell, seen = refraction.refract_direction, set()
def watched(*lanes):
    seen.add(threading.current_thread() is threading.main_thread())
    return snell(*lanes)
refraction.refract_direction = watched
rt.render({FILE!r}, spp=1, size=(2, 2), threads=1)
print(seen)
"""
    assert python("-c", script) == "{True}\n"


@pytest.fixture(scope="module")
def kernel():
    with a_kernel() as cells:
        cells.run(blocks("stepping.md", "cell 1")[0])
        yield cells


def test_print_works_in_a_notebook(kernel):
    printed = kernel.run(blocks("stepping.md", "cell 2")[0]).splitlines()
    assert printed
    assert all(re.fullmatch(r"cos in \[.*\] total \[.*\]", line) for line in printed)
    kernel.run("print(image)")


def test_breakpoint_works_in_a_notebook(kernel):
    kernel.begin(
        "def watched(d, n, eta):\n"
        "    if not stopped:\n"
        "        stopped.append(True)\n"
        "        breakpoint()\n"
        "    return snell(d, n, eta)\n"
        "stopped, refraction.refract_direction = [], watched\n"
        f"image = rt.render({FILE!r}, spp=1, size=(2, 2), threads=1)\n"
        "print(image.rgb.shape)"
    )
    for command in ("p len(eta)", "continue"):
        asked = kernel.client.get_stdin_msg(timeout=600)
        assert asked["msg_type"] == "input_request"
        kernel.client.input(command)
    printed = kernel.finish()
    assert f"\n{packet_width(np.zeros(1, np.float32))}\n" in printed
    assert printed.endswith("(2, 2, 3)\n")
