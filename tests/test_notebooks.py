"""The course: every notebook runs, every check rejects the unsolved exercise and a mistake, and accepts the solution."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from notebook_cells import FOLDER, NOTEBOOKS, answers_of, cells_of, exercise_of

ROOT = FOLDER.parents[1]


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_checks_tell_solutions_from_mistakes(notebook):
    program = Path(__file__).parent / "run_notebook.py"
    done = subprocess.run(
        [sys.executable, program, notebook],
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=600,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"},
    )
    assert done.returncode == 0, done.stderr
    for exercise, (unsolved, mistaken, solved) in json.loads(done.stdout).items():
        assert unsolved == "yours to do", f"{exercise} as it stands: {unsolved}"
        assert mistaken.startswith("not yet: "), f"{exercise} with a mistake: {mistaken}"
        assert "Error" not in mistaken, f"{exercise}: a check says what is wrong in its own words, not {mistaken}"
        assert solved == "solved", f"{exercise} with its solution: {solved}"
