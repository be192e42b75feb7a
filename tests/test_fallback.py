"""Kernels where a private part of Numba or llvmlite is missing, or the process lacks what machine code calls."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from raytrace import jit
from raytrace.native import symbols

ROOT = Path(__file__).parent.parent
compiled = pytest.mark.skipif(jit.PLAIN, reason="kernels are plain functions")

# Products of lanes with a single rounding, a callee, a chosen form, a record, None, and results.
PROGRAM = """
import hashlib, sys, warnings
from typing import NamedTuple
import llvmlite.binding as llvm
import numpy as np
{breakage}
from raytrace import jit
from raytrace.accel.lanes import fma, load, store

class Rows(NamedTuple):
    a: np.ndarray
    n: int

def chosen(a):
    return 1

@jit.specialised(chosen)
def choose(a):
    return lambda a: 1  # the same, as it must be

@jit.subroutine
def square_root(x):
    return np.sqrt(x)

@jit.kernel
def work(rows, nothing, out):
    for i in range(0, rows.n, 4):
        x = load(rows.a, i, 4)
        store(out, i, fma(x, x, x))
    for i in range(rows.n):
        out[i] = square_root(out[i]) / rows.a[0]
    return rows.n, chosen(rows.a)

with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    digest = hashlib.sha256()
    for dtype in ("f4", "f8", "f4"):
        a = (np.arange(64) / 7).astype(dtype)
        out = np.zeros_like(a)
        result = work(Rows(a, 64), None, out)
        digest.update(out.tobytes())
    try:
        work(Rows(a, 64), None)
        raise SystemExit("too few arguments were taken")
    except TypeError:
        pass
print(digest.hexdigest(), *result)
print(len([w for w in caught if w.category is RuntimeWarning]), *[str(w.message) for w in caught])
"""
BREAKAGES = {
    "a part of the compiler": "del llvm.TargetMachine.emit_object",
    "the linker": "import numba; numba.njit(lambda: 0)(); del llvm.create_mcjit_compiler",
    "the compiler": "sys.modules['raytrace.native.compiler'] = None",
    "the layout of arrays": """
import raytrace.native.compiler as part
def differs(): raise RuntimeError("another layout")
part.check_layout = differs""",
    "symbols": "import raytrace.native.link as part; part.unknown = lambda data: ['no_such']",
    "the format of objects": "import raytrace.native.symbols as part; part.ELF = part.MACH_O = b'no such format'",
}


def run(breakage, cache, **environment):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("{breakage}", breakage)], capture_output=True, text=True, timeout=300,
        cwd=ROOT, env=os.environ | {"RAYTRACE_CACHE": str(cache), "PYTHONPATH": str(ROOT)} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    results, warned = run("", tmp_path_factory.mktemp("kernels"))
    assert warned == "0"
    return results


@compiled
@pytest.mark.parametrize("breakage", BREAKAGES)
def test_without_a_private_part_the_results_are_the_same_and_one_warning_says_so(breakage, expected, tmp_path):
    results, warned = run(BREAKAGES[breakage], tmp_path)
    assert results == expected
    assert warned.startswith("1 plain numba.njit compiles kernels in every process, for the same results, because ")


@compiled
def test_what_llvm_could_not_find_is_seen_before_it_is_linked(expected, tmp_path):
    """Without FMA the machine code calls ``fmaf``; LLVM ends a process that links it and has none."""
    hide = "import raytrace.native.symbols as part; known = part._found\n"
    hide += "part._found = lambda name: name not in ('fma', 'fmaf') and known(name)"
    results, warned = run(hide, tmp_path, NUMBA_CPU_NAME="generic")
    assert results == expected
    assert "machine code calls fma" in warned


@compiled
def test_a_kernel_that_calls_what_nobody_has_does_not_end_the_process(tmp_path):
    program = """
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from raytrace import jit

@intrinsic
def nowhere(context, x):
    def emit(context, builder, signature, args):
        shape = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()])
        return builder.call(ir.Function(builder.module, shape, "no_such_function"), args)
    return types.float64(types.float64), emit

@jit.kernel
def call(a):
    a[0] = nowhere(a[0])

@jit.kernel
def harmless(a):
    return len(a)

try:
    call(np.zeros(1))
except NotImplementedError as error:
    print(error)
print(harmless(np.zeros(3)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.stdout == "call calls no_such_function: kernels call only each other\n3\n", done.stderr


# Symbols of object files ----------------------------------------------------------------------------------------------

MODULE = """
target triple = "{triple}"
declare float @fmaf(float, float, float)
declare void @elsewhere(ptr)
@table = internal constant [4 x i32] [i32 1, i32 2, i32 3, i32 4]
define internal float @mine(float %x) noinline {{
  %y = fadd float %x, 1.0
  ret float %y
}}
define float @entry(float %x) {{
  %large = alloca [9000 x i8]
  call void @elsewhere(ptr %large)
  %y = call float @mine(float %x)
  %z = call float @fmaf(float %y, float %x, float %x)
  ret float %z
}}
"""
PROBED = {  # Windows probes large frames
    "x86_64-unknown-linux-gnu": set(),
    "aarch64-unknown-linux-gnu": set(),
    "x86_64-pc-windows-msvc-elf": {"__chkstk"},
    "arm64-apple-darwin": set(),
}


def object_file(triple):
    llvm = pytest.importorskip("llvmlite.binding")
    try:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        machine = llvm.Target.from_triple(triple).create_target_machine(codemodel="jitdefault", jit=True)
    except RuntimeError as error:
        pytest.skip(f"this LLVM has no such target: {error}")
    return machine.emit_object(llvm.parse_assembly(MODULE.format(triple=triple)))


@pytest.mark.parametrize("triple", PROBED)
def test_names_that_an_object_leaves_open_are_found_in_each_format(triple):
    assert {"elsewhere", "fmaf"} | PROBED[triple] == set(symbols.undefined(object_file(triple)))


def test_functions_that_llvm_does_not_see_are_looked_for_in_the_systems_libraries(monkeypatch):
    monkeypatch.setattr(symbols.ctypes, "pythonapi", None)
    monkeypatch.setattr(symbols.llvm, "address_of_symbol", lambda name: None)
    monkeypatch.setattr(symbols.llvm, "add_symbol", lambda name, address: None)
    assert not symbols._found("no_such_function")
    if sys.platform == "linux":
        if platform.libc_ver()[0] != "glibc":
            pytest.skip("needs glibc")
        assert symbols._found("fmaf")


def test_what_is_no_object_is_refused_in_words():
    whole = object_file("x86_64-unknown-linux-gnu")
    for wrong in (b"", b"text", bytes(100), b"MZ" + bytes(100), b"\x7fELF\x01\x01" + bytes(100)):
        with pytest.raises(ValueError, match="unknown format"):
            symbols.undefined(wrong)
    for length in (6, 20, 63):
        with pytest.raises(ValueError, match="a corrupt object file"):
            symbols.undefined(whole[:length])
