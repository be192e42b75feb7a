"""The course: every notebook runs, and its checks tell an unsolved exercise, a mistake and the solution apart."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import raytrace
from notebook_cells import FOLDER, NOTEBOOKS, answers_of, cells_of, exercise_of

ROOT = FOLDER.parents[1]
COLUMNS = 100  # what a page of the site has room for


def test_there_are_ten_notebooks_in_their_order():
    assert [name[:2] for name in NOTEBOOKS] == [f"0{k}" for k in range(10)]
    index = (FOLDER / "index.md").read_text("utf-8")
    assert re.findall(r"^(0\d-[\w-]+)$", index, re.MULTILINE) == NOTEBOOKS


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_checks_tell_solutions_from_mistakes(notebook):
    here = {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8", "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-W", "error", Path(__file__).parent / "run_notebook.py", notebook],
        capture_output=True,
        encoding="utf-8",
        timeout=600,
        env=os.environ | here,
    )
    assert done.returncode == 0, done.stderr
    for exercise, (unsolved, *mistakes, solved) in json.loads(done.stdout).items():
        assert unsolved == "yours to do", f"{exercise} as it stands: {unsolved}"
        for mistaken in mistakes:
            assert mistaken.startswith("not yet: "), f"{exercise} with a mistake: {mistaken}"
            assert "Error" not in mistaken, f"{exercise}: a check says what is wrong in its own words, not {mistaken}"
        assert solved == "solved", f"{exercise} with its solution: {solved}"


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_a_notebook_has_exercises(notebook):
    checked = [name for name in map(exercise_of, cells_of(notebook)) if name]
    assert checked == [f"{int(notebook[:2])}.{k}" for k in range(1, len(checked) + 1)]
    assert len(checked) >= 3
    assert list(answers_of(notebook)) == checked


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_notebooks_use_the_public_face_alone(notebook):
    for tree in map(ast.parse, cells_of(notebook)):
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("raytrace"):
                assert node.module == "raytrace.textbook", ast.unparse(node)
                assert {name.name for name in node.names} <= set(raytrace.textbook.__all__)
            elif isinstance(node, ast.Import):
                assert not any(name.name.startswith("raytrace.") for name in node.names), ast.unparse(node)
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "rt":
                assert node.attr in raytrace.__all__
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "rt.show":
                assert node.attr in raytrace.show.__all__
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "rt.textbook":
                assert node.attr in raytrace.textbook.__all__


def test_moller_trumbore_is_typed_once_and_imported_afterwards():
    typed = [name for name in NOTEBOOKS if any("def moller_trumbore" in cell for cell in cells_of(name))]
    imported = [name for name in NOTEBOOKS if any("textbook import moller_trumbore" in cell for cell in cells_of(name))]
    assert typed == [NOTEBOOKS[1]]
    assert imported == [NOTEBOOKS[1], NOTEBOOKS[2], NOTEBOOKS[7]]


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_a_notebook_begins_with_its_goals_duration_and_prerequisites(notebook):
    text = (FOLDER / f"{notebook}.md").read_text("utf-8")
    top = text[: text.index("```{code-cell}")]
    found = re.findall(r"^- \*\*(\w+):\*\* ", top, re.MULTILINE)
    assert found == ["Goals", "Duration", "Prerequisites", "Figures"]


def test_the_page_of_figures_shows_what_the_notebooks_say_and_every_figure(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "pictures")
    monkeypatch.delitem(sys.modules, "notebooks", raising=False)
    import notebooks

    text = (FOLDER / "figures.md").read_text("utf-8")
    assert text == notebooks.page(), "out of date: run python docs/pictures/notebooks.py"
    files = sorted((ROOT / "docs" / "pictures" / "notebooks").iterdir())
    assert re.findall(r"\(\.\./pictures/notebooks/([\w.-]+)\)", text) == [path.name for path in files]
    assert {path.name[:2] for path in files} == {name[:2] for name in NOTEBOOKS}
    assert sum(path.stat().st_size for path in files) < 2e6
    for path in files:
        cell = notebooks.cells(next(name for name in NOTEBOOKS if name[:2] == path.name[:2]))[int(path.name[3:5])][1]
        assert re.search(r"show\(|row\(|rt\.show|render\(|microscope\(|draw|variances\(|compare\(|image$", cell), (
            path.name
        )


@pytest.mark.parametrize("notebook", NOTEBOOKS)
def test_code_fits_the_page(notebook):
    code = cells_of(notebook) + [answer for pair in answers_of(notebook).values() for answer in pair]
    assert not [line for cell in code for line in cell.splitlines() if len(line) > COLUMNS]


def test_a_check_reports_where_and_what_and_does_not_stop_the_notebook():
    program = """
import course
with course.check("a"): raise NotImplementedError
with course.check("b"): assert 1 == 2, "one is not two"
with course.check("c"): 1 / 0
with course.check("d"): pass
def answer(x):
    return x / 0
with course.check("e"):
    answer(1)
assert list(course.RESULTS.values()) == [
    "yours to do", "not yet: one is not two",
    "not yet: ZeroDivisionError: division by zero (in line 5 of the check). "
    "Is what your function returns of the right type and shape?",
    "solved", "not yet: ZeroDivisionError: division by zero (in line 8 of the cell, in answer)"]
print("one number:", [course.np.float64(0.5)])
ones = course.np.ones(5)
print(*(course.factor_hint(factor * ones, ones) for factor in (3.1416, 1 / 3.1416, 3)), sep="")
"""
    here = {"PYTHONPATH": os.pathsep.join([str(ROOT), str(FOLDER)]), "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, encoding="utf-8", timeout=600, env=os.environ | here
    )
    assert done.returncode == 0, done.stderr
    *_, number, hint = done.stdout.splitlines()
    assert "✓ exercise d: solved" in done.stdout
    assert number == "one number: [0.5]"
    assert hint == (
        "; yours is π times too large; is there a division by π missing?"
        "; yours is too small by a factor of π; is there a division by π too many?"
    )
