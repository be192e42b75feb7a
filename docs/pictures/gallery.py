"""Make the images of docs/gallery.md, and the figures of ``rt.show`` on all pages: ``python docs/pictures/gallery.py``.

The pages say how: an image of a scene is what ``python -m raytrace scenes/NAME.json`` writes, with the options that
docs/gallery.md names. A figure ``show-NAME.png`` is what the last ``rt.show`` before it makes. With names of images,
such as ``metals show-path``, only these are made. Needs matplotlib (``pip install ".[report]"``).
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
DOCS, ROOT = HERE.parent, HERE.parents[1]
COMMAND = re.compile(r"`python -m raytrace scenes/([\w-]+)\.json([^`]*)`")
FIGURE = re.compile(r"`(rt\.show\.\w+\([^`]*\))`|\]\(pictures/(show-[\w-]+)\.png\)")
LARGEST = 960, 800  # pixels of a figure


def scenes() -> dict[str, list[str]]:
    """The options of the command line for the image of each scene."""
    options = dict(COMMAND.findall((DOCS / "gallery.md").read_text("utf-8")))
    return {path.stem: shlex.split(options.get(path.stem, "")) for path in sorted((ROOT / "scenes").glob("*.json"))}


def figures() -> dict[str, str]:
    """The expression that makes each figure of ``rt.show``, as the pages state it."""
    found = dict[str, str]()
    for page in sorted(DOCS.glob("*.md")):
        said = ""
        for expression, name in FIGURE.findall(page.read_text("utf-8")):
            if name and found.setdefault(name, said) != said:
                raise ValueError(f"{page.name}: {name}.png is {found[name]} on another page")
            said = expression or said
    return found


def render(name: str, options: list[str]) -> None:
    """Write the image of a scene, as a user would."""
    command = [sys.executable, "-m", "raytrace", f"scenes/{name}.json", *options]
    subprocess.run([*command, "-o", str(HERE / f"{name}.png")], check=True, cwd=ROOT)


def draw(name: str, expression: str) -> None:
    """Write a figure, no larger than a page shows it."""
    import os

    from PIL import Image

    import raytrace as rt

    os.chdir(ROOT)
    path = eval(expression, {"rt": rt}).save(HERE / f"{name}.png")
    image = Image.open(path).convert("RGB")
    image.thumbnail(LARGEST, Image.Resampling.LANCZOS)
    image.save(path, optimize=True)


def main() -> None:
    wanted = sys.argv[1:] or [*scenes(), *figures()]
    for name in wanted:
        if name in scenes():
            render(name, scenes()[name])
        elif name in figures():
            draw(name, figures()[name])
        else:
            sys.exit(f"{name}: neither a scene of scenes/ nor a figure of a page")


if __name__ == "__main__":
    main()
