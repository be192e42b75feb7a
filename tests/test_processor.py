"""What kernels are compiled for: environment variables, and the machine code that they lead to."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from raytrace.errors import OptionError
from raytrace.jit import PLAIN
from raytrace.native import processor, store

ROOT = Path(__file__).parents[1]
HOST = "+sse2,+avx,+avx2,+fma,+avx512f"
PROGRAM = """
import numba, re, sys
from raytrace.native import compiler
from raytrace.accel.lanes import BITS, fma, load, packet, store
import numpy as np

@numba.njit
def kernel(a, out):
    for i in range(0, len(a), 16):
        x = load(a, i, 16)
        store(out, i, fma(x, x, x))

kernel(np.ones(64, "f4"), np.ones(64, "f4"))
code = "".join(kernel.inspect_asm().values())
print(BITS, *(len(re.findall(word, code)) > 0 for word in ("zmm", "ymm")))
"""


class Host:
    """A processor's features as LLVM gives them."""

    def __init__(self, features):
        self.features = features

    def flatten(self):
        return self.features


@pytest.fixture
def host(monkeypatch):
    """A processor with AVX-512, and none of the variables."""
    for name in ("RAYTRACE_LANES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_ENABLE_AVX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(processor.llvm, "get_host_cpu_features", lambda: Host(HOST))
    monkeypatch.setattr(processor.llvm, "get_host_cpu_name", lambda: "znver4")
    return monkeypatch


@pytest.mark.parametrize(
    ("features", "bits"),
    [
        (HOST, 512),
        ("+avx512f,+avx2", 512),
        ("+avx2,+avx,-avx512f", 256),
        (f"{HOST},-avx512f", 256),
        (f"{HOST},-avx2", 128),
        (f"{HOST},-avx", 128),
        ("+avx", 128),
        ("+sse4.2", 128),
        ("+neon,+fullfp16", 128),
        ("", 128),
    ],
)
def test_a_register_is_as_wide_as_the_features_say(features, bits, host):
    host.setattr(processor.llvm, "get_host_cpu_features", lambda: Host(features))
    assert processor.register_bits() == bits
    assert processor.cpu_features() == features  # nothing is left out
    assert not processor.narrowed()


@pytest.mark.parametrize(
    ("variables", "bits"),
    [
        ({"NUMBA_CPU_NAME": "haswell"}, 512),  # for Numba the features are still those of the host
        ({"NUMBA_CPU_NAME": "generic"}, 128),
        ({"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "+avx2"}, 256),
        ({"NUMBA_CPU_FEATURES": "+avx2,+fma"}, 256),
        ({"NUMBA_CPU_FEATURES": ""}, 128),
        ({"NUMBA_ENABLE_AVX": "0"}, 128),
        ({"NUMBA_CPU_NAME": "nocona"}, 128),  # Numba mistrusts virtual machines of that name
        ({"NUMBA_CPU_NAME": "nocona", "NUMBA_ENABLE_AVX": "1"}, 512),
    ],
)
def test_variables_of_numba_decide_the_width_too(variables, bits, host):
    for name, value in variables.items():
        host.setenv(name, value)
    assert processor.register_bits() == bits
    assert not processor.narrowed()
    host.setenv("RAYTRACE_LANES", "128")
    assert processor.register_bits() == 128


def test_features_are_those_that_numba_uses(host):
    """Whatever the variables say. Numba reads them when it is imported: so once in a process."""
    host.undo()
    program = "from raytrace.native import compiler, processor as p; t = compiler.cpu_target\n"
    program += "c = t.target_context.codegen(); print(c._get_host_cpu_name() == p.cpu_name(), end=' ')\n"
    program += "print(c._get_host_cpu_features() == p.cpu_features())"
    for variables in ({}, {"NUMBA_CPU_NAME": "generic"}, {"NUMBA_CPU_FEATURES": "+sse2"}, {"NUMBA_ENABLE_AVX": "0"}):
        assert run(program, **variables).split() == ["True", "True"], variables


@pytest.mark.parametrize(("bits", "left_out"), [("512", ""), ("256", ",-avx512f"), ("128", ",-avx")])
def test_fewer_bits_than_there_are_leave_out_what_needs_more(bits, left_out, host):
    host.setenv("RAYTRACE_LANES", bits)
    assert processor.register_bits() == int(bits)
    assert processor.cpu_features() == HOST + left_out
    assert processor.width_of(processor.cpu_features()) == int(bits)
    assert processor.narrowed() == (bits != "512")


@pytest.mark.parametrize("value", ["64", "1024", "0", "-128", "128.0", "wide", "512 256", "x" * 500, "1\n2"])
def test_other_values_are_refused_in_one_line(value, host):
    host.setenv("RAYTRACE_LANES", value)
    with pytest.raises(OptionError, match=r"^RAYTRACE_LANES=.*set it to 128 or 256 or 512, or unset it") as caught:
        processor.register_bits()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_more_bits_than_the_processor_has_are_refused(host):
    host.setattr(processor.llvm, "get_host_cpu_features", lambda: Host("+avx2,-avx512f"))
    host.setenv("RAYTRACE_LANES", "512")
    with pytest.raises(OptionError, match=r"RAYTRACE_LANES=512: .*set it to 128 or 256, or unset it \(256 bits"):
        processor.register_bits()


def test_an_empty_value_is_none(host):
    host.setenv("RAYTRACE_LANES", "")
    assert processor.register_bits() == 512


def test_each_width_has_a_folder_of_kernels(host, tmp_path):
    host.setenv("RAYTRACE_CACHE", str(tmp_path))
    folders = set()
    for bits in ("128", "256", "512"):
        host.setenv("RAYTRACE_LANES", bits)
        store.cache_folder.cache_clear()
        folders.add(store.cache_folder())
    store.cache_folder.cache_clear()
    assert len(folders) == 3


def run(program, *options, **variables):
    words = [sys.executable, "-W", "error", *options, "-c", program]
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | variables
    finished = subprocess.run(words, env=environment, capture_output=True, text=True, cwd=ROOT, timeout=300)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


@pytest.mark.skipif(PLAIN, reason="kernels are plain functions")
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="looks at x86-64 code")
@pytest.mark.parametrize("bits", [bits for bits in (128, 256, 512) if bits <= processor.register_bits()])
def test_machine_code_has_no_wider_registers(bits):
    width, *found = run(PROGRAM, RAYTRACE_LANES=str(bits)).split()
    assert int(width) == bits
    assert found == [str(bits == 512), str(bits >= 256)]


def test_the_command_line_refuses_another_value_with_its_exit_code(tmp_path):
    words = [sys.executable, "-m", "raytrace", "render", "scenes/cornell-box.json", "-o", str(tmp_path / "image.png")]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "RAYTRACE_LANES": "13"}
    finished = subprocess.run(words, env=environment, capture_output=True, text=True, cwd=ROOT, timeout=300)
    assert finished.returncode == 2
    assert "RAYTRACE_LANES=13: not a width" in finished.stderr
    assert finished.stderr.count("\n") == 1
