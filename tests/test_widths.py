"""Hits and images have the same bits whatever the width of vector registers, 128, 256 or 512 bits, and why.

Functions of the C library may round differently on another platform. So kernels call none but those whose result is
exact, or correctly rounded by IEEE 754.
"""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from raytrace.jit import PLAIN
from raytrace.native.processor import register_bits

ROOT = Path(__file__).parents[1]
WIDTHS = [bits for bits in (128, 256, 512) if bits <= register_bits()]
EXACT = {"memcpy", "memmove", "memset", "fma", "fmaf"}  # fma: of a processor without the instruction

pytestmark = pytest.mark.skipif(PLAIN, reason="kernels are plain functions")


@cache
def hashes(bits: int) -> dict:
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "RAYTRACE_LANES": str(bits)}
    words = [sys.executable, "-W", "error", "tests/width_hashes.py"]
    finished = subprocess.run(words, env=environment, cwd=ROOT, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)


@pytest.mark.skipif(len(WIDTHS) < 2, reason="this processor has one width of registers, or RAYTRACE_LANES says so")
@pytest.mark.parametrize("bits", WIDTHS[:-1])
def test_hits_and_images_have_the_same_bits_at_every_lane_width(bits):
    found, widest = hashes(bits), hashes(WIDTHS[-1])
    assert (found["bits"], widest["bits"]) == (bits, WIDTHS[-1])
    for what, least in (("rays", 66), ("images", 34)):
        assert len(widest[what]) >= least
        assert found[what] == widest[what]


@pytest.mark.parametrize("bits", WIDTHS)
def test_kernels_call_no_function_that_rounds_differently_elsewhere(bits):
    calls = hashes(bits)["calls"]
    of_paths = {"scatter_diffuse", "sample_triangles", "sample_spots", "sample_environment", "reflect_conductors"}
    assert {"closest_hit", "any_hit", "closest_points", "camera_rays", "reflect_light", *of_paths} <= calls.keys()
    others = {kernel: [name for name in names if not name.startswith("Py")] for kernel, names in calls.items()}
    assert {kernel: names for kernel, names in others.items() if not EXACT.issuperset(names)} == {}
