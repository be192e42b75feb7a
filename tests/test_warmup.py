"""``warmup`` leaves nothing to compile."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_after_the_warm_up_no_kernel_of_a_shipped_scene_is_left_to_compile():
    program = """
import sys
import raytrace as rt
from raytrace.accel import build, flatten, grow
from raytrace.warmup import warmup
warmup()
sys.exit(" ".join(f.__name__ for f in (build.measure, grow.grow, flatten.flatten) if len(f.signatures) < 2))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.stderr.strip() == ""
