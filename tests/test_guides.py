"""The guides to materials and passes fit the code as it is; the student project names every scene of the suite once.

``tests/bench/guides.py`` applies the guides to a copy of the project and runs their tests.
"""

import ast
import json
import re

import pytest

from guides import GUIDES, ROOT, changed_files
from notebook_cells import NOTEBOOKS
from raytrace.conformance.cases import suite


@pytest.mark.parametrize("guide", GUIDES)
def test_the_code_of_a_guide_fits_the_project_and_is_valid(guide):
    changed = changed_files(guide)
    assert any(path.startswith("raytrace/passes/") for path in changed)
    assert any(path.startswith("tests/test_") for path in changed)
    for path, text in changed.items():
        assert (json.loads if path.endswith(".json") else ast.parse)(text)
        long = [line for line in text.splitlines() if len(line) > 120 and "type: ignore" not in line]
        assert path.endswith(".json") or not long


def test_an_edit_that_does_not_fit_is_an_error(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "a.py").write_text("x = 1\n")
    page = "<!-- edit: a.py -->\n```diff\n-x = 2\n+x = 3\n```\n"
    (tmp_path / "docs" / "g.md").write_text(page)
    with pytest.raises(ValueError, match=r"g.md: a.py has 0 places"):
        changed_files("g", tmp_path)
    (tmp_path / "docs" / "g.md").write_text(page.replace("x = 2", "x = 1"))
    assert changed_files("g", tmp_path) == {"a.py": "x = 3\n"}


def test_the_project_names_every_scene_of_the_suite_in_one_stage():
    text = (ROOT / "docs" / "notebooks" / "project.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d)\. [^|]*\|[^|]*\|([^|]*)\|", text, re.MULTILINE)
    named = [scene for _, cell in rows for scene in re.findall(r"`([\w-]+)`", cell)]
    assert [number for number, _ in rows] == list("123456789")
    assert sorted(named) == sorted(case.name for case in suite())


def test_the_teachers_notes_have_a_section_for_each_notebook():
    text = (ROOT / "docs" / "notebooks" / "teacher.md").read_text("utf-8")
    parts = re.findall(
        r"^### \[[^\n]*\]\((\S*)\.md\): [^\n]*minutes[^\n]*\n\n(.*?)(?=^###|\Z)", text, re.MULTILINE | re.DOTALL
    )
    assert [name for name, _ in parts] == NOTEBOOKS
    for _, part in parts:
        assert re.findall(r"^- \*\*(.*?):\*\*", part, re.MULTILINE)[:3] == ["Stress", "Timing", "Typical mistakes"]
