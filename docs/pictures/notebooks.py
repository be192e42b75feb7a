"""Make the figures of the course, and the page that shows them: ``python docs/pictures/notebooks.py``.

It runs the notebooks as they stand (some minutes; needs ``pip install ".[notebook]"``), saves what their cells show
below ``docs/pictures/notebooks/``, and writes ``docs/notebooks/figures.md``. With names of notebooks it runs only
these, as in ``python docs/pictures/notebooks.py 05-sampling-and-error``; with ``--page`` it runs none, and writes the
page alone. A figure is named after its notebook and its code cell, so that tests notice a page that is out of date.
"""

import ast
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
FOLDER, COURSE = HERE / "notebooks", HERE.parent / "notebooks"
PAGE = COURSE / "figures.md"
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(?::[^\n]*\n|\n)*(.*?)^```$", re.MULTILINE | re.DOTALL)
COLOURS, DPI, WIDEST = 96, 75, 800

HEAD = """# Figures of the course

What the cells of the notebooks show, so that you can see it without running anything. Exercises are still to do here,
so their figures are missing. `python docs/pictures/notebooks.py` made this page; speeds are those of a busy machine.
"""


def names() -> list[str]:
    """The notebooks, in their order."""
    return sorted(path.stem for path in COURSE.glob("[0-9]*.md"))


def cells(name: str) -> list[tuple[str, str]]:
    """The text before each code cell of a notebook, and its code."""
    text = (COURSE / f"{name}.md").read_text("utf-8")
    found, end = [], text.index("# ")
    for cell in CELL.finditer(text):
        found.append((text[end : cell.start()], cell[1]))
        end = cell.end()
    return found


def save(png: bytes, path: Path) -> None:
    """Write an image with few colours, no wider than a page."""
    from PIL import Image

    image = Image.open(io.BytesIO(png)).convert("RGB")
    if image.width > WIDEST:
        image = image.resize((WIDEST, round(image.height * WIDEST / image.width)), Image.Resampling.LANCZOS)
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def run(name: str) -> None:
    """Run a notebook in this process, and save its figures."""
    os.environ["MPLBACKEND"] = "Agg"
    import matplotlib.pyplot as plt

    shown: list[bytes] = []

    def show(*_: Any, **__: Any) -> None:
        for number in plt.get_fignums():
            drawn = io.BytesIO()
            plt.figure(number).savefig(drawn, dpi=DPI)
            shown.append(drawn.getvalue())
        plt.close("all")

    os.chdir(COURSE)
    sys.path.insert(0, str(COURSE))
    plt.show = show
    for path in FOLDER.glob(f"{name[:2]}-*.png"):
        path.unlink()
    namespace: dict[str, Any] = {"__name__": "__main__", "display": lambda *things: None}
    for number, (_, code) in enumerate(cells(name)):
        shown.clear()
        tree = ast.parse(code)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"<{name}, cell {number}>", "exec"), namespace)
        value = last and eval(compile(ast.Expression(last.value), f"<{name}, cell {number}>", "eval"), namespace)
        if hasattr(value, "figure"):  # of rt.show
            drawn = io.BytesIO()
            value.figure.savefig(drawn, dpi=DPI)
            shown.append(drawn.getvalue())
        elif hasattr(value, "_repr_png_"):  # an image
            shown.append(value._repr_png_())
        for k, png in enumerate(shown):
            save(png, FOLDER / f"{name[:2]}-{number:02}{'abcdefgh'[k]}.png")


def caption(texts: list[str]) -> str:
    """The last paragraph before a figure, if it is one; between cells that follow each other there is no text."""
    text = next((text for text in reversed(texts) if text.strip()), "")
    paragraphs = [part.strip() for part in text.split("\n\n") if part.strip()]
    if not paragraphs or paragraphs[-1].startswith(("#", "$$", "- ", "```", "    ")):
        return ""
    return " ".join(paragraphs[-1].split())


def page() -> str:
    """The page of all figures, from the texts of the notebooks and the names of the files."""
    parts = [HEAD]
    for name in names():
        text = (COURSE / f"{name}.md").read_text("utf-8")
        parts.append(f"## {re.findall('^# (.*)$', text, re.MULTILINE)[0]}\n\n[The notebook]({name}.md).\n")
        section = of_last = said = ""
        texts = [before for before, _ in cells(name)]
        for number, before in enumerate(texts):
            for heading in re.findall(r"^##+ (.*)$", before, re.MULTILINE):
                section = heading
            files = sorted(FOLDER.glob(f"{name[:2]}-{number:02}?.png"))
            if not files:
                continue
            if section != of_last:
                parts.append(f"**{section}**\n")
                of_last = section
            words = caption(texts[: number + 1])
            if words and words != said:
                parts.append(f"{words}\n")
                said = words
            alt = section or "At the beginning"
            parts += [f"![{alt.replace('$', '')}](../pictures/notebooks/{path.name})\n" for path in files]
    return "\n".join(parts)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    match sys.argv[1:]:
        case ["--page"]:
            pass
        case [name]:
            run(name)
        case wanted:
            for name in wanted or names():
                print(name)
                subprocess.run([sys.executable, __file__, name], check=True)
    PAGE.write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
