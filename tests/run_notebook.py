"""``python run_notebook.py NAME``: a notebook as a student works through it, in a plain interpreter.

Writes, as JSON, what each check found: of the exercise as it stands, of its mistakes, and of the solution.
"""

import contextlib
import json
import os
import sys
from typing import Any

from notebook_cells import FOLDER, answers_of, cells_of, exercise_of


def results_of(notebook: str) -> dict[str, list[str]]:
    """Run all cells; where one checks an exercise, run it again for each answer."""
    import course

    answers = answers_of(notebook)
    found: dict[str, list[str]] = {}
    namespace: dict[str, Any] = {"__name__": "__main__", "display": lambda *things: None}
    for number, cell in enumerate(cells_of(notebook)):
        code = compile(cell, f"<{notebook}, cell {number}>", "exec")
        exec(code, namespace)
        exercise = exercise_of(cell)
        if exercise:
            found[exercise] = [course.RESULTS[exercise]]
            for answer in reversed(answers[exercise]):
                exec(answer, namespace)
                exec(code, namespace)
                found[exercise].append(course.RESULTS[exercise])
    assert found.keys() == answers.keys(), "the exercises of the notebook are not those of its solutions"
    return found


if __name__ == "__main__":
    os.chdir(FOLDER)
    sys.path.insert(0, str(FOLDER))
    with contextlib.redirect_stdout(sys.stderr):
        results = results_of(sys.argv[1])
    sys.stdout.write(json.dumps(results))
