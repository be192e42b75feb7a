"""The notebooks of docs/notebooks as text: their code cells, and the answers to their exercises."""

import re
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "docs" / "notebooks"
NOTEBOOKS = sorted(path.stem for path in FOLDER.glob("[0-9]*.md"))
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(?::[^\n]*\n|\n)*(.*?)^```$", re.MULTILINE | re.DOTALL)
EXERCISE = re.compile(r"^## Exercise ([\d.]+)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
FENCE = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CHECK = re.compile(r"^with check\(\"([\d.]+)\"\):", re.MULTILINE)


def cells_of(notebook: str) -> list[str]:
    """Code of the cells of a notebook, in their order."""
    return CELL.findall((FOLDER / f"{notebook}.md").read_text("utf-8"))


def answers_of(notebook: str) -> dict[str, tuple[str, ...]]:
    """Exercise -> its solution, and a mistake or more."""
    text = (FOLDER / "solutions" / f"{notebook}.md").read_text("utf-8")
    found = {name: tuple(FENCE.findall(part)) for name, part in EXERCISE.findall(text)}
    assert all(len(answers) >= 2 for answers in found.values()), "an exercise has one solution, and a mistake or more"
    return found


def exercise_of(cell: str) -> str | None:
    """The exercise that a cell checks."""
    found = CHECK.search(cell)
    return found[1] if found else None
