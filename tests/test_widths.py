"""Hits and images have the same bits whatever the width of vector registers: 128, 256 or 512 bits."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from raytrace.jit import PLAIN
from raytrace.native.processor import register_bits

ROOT = Path(__file__).parents[1]
WIDTHS = [bits for bits in (128, 256, 512) if bits <= register_bits()]

pytestmark = [
    pytest.mark.skipif(PLAIN, reason="kernels are plain functions"),
    pytest.mark.skipif(len(WIDTHS) < 2, reason="this processor has one width of registers, or RAYTRACE_LANES says so"),
]


def hashes(bits: int) -> dict:
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "RAYTRACE_LANES": str(bits)}
    words = [sys.executable, "-W", "error", "tests/width_hashes.py"]
    finished = subprocess.run(words, env=environment, cwd=ROOT, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)


@pytest.fixture(scope="module")
def widest() -> dict:
    return hashes(WIDTHS[-1])


@pytest.mark.parametrize("bits", WIDTHS[:-1])
def test_hits_and_images_have_the_same_bits_at_every_lane_width(bits, widest):
    found = hashes(bits)
    assert (found["bits"], widest["bits"]) == (bits, WIDTHS[-1])
    for what, least in (("rays", 60), ("images", 20)):
        assert len(widest[what]) >= least
        assert found[what] == widest[what]
