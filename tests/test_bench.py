"""The benchmark programs: each one starts. What they measure is not tested."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROGRAMS = sorted(path for path in (ROOT / "tests" / "bench").glob("*.py") if "__main__" in path.read_text("utf-8"))
NEEDS = {
    "curves": "matplotlib",
    "cluster": "distributed",
    "adapter": "embreex",
}  # optional packages that a program imports at once


def test_there_are_programs():
    assert len(PROGRAMS) > 15


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_a_program_prints_its_help(path):
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, path, "--help"],
        capture_output=True,
        text=True,
        timeout=600,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stderr
    assert "usage:" in done.stdout
