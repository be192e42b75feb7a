"""The images of the documents: each is shown, has a text, and has the command that made it."""

import ast
import re
import sys
from argparse import ArgumentParser
from pathlib import Path

import pytest

from raytrace.cli.arguments import render_options

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
MARKDOWN = re.compile(r"!\[([^\]]*)\]\(([^)\s]+\.(?:png|svg|jpg))\)")
HTML = re.compile(r"<img\s[^>]*>")


def images(page):
    """The text and the file of each image on a page."""
    text = page.read_text("utf-8")
    shown = [(alt, page.parent / file) for alt, file in MARKDOWN.findall(text)]
    for tag in HTML.findall(text):
        parts = dict(re.findall(r'(\w+)="([^"]*)"', tag))
        shown.append((parts.get("alt", ""), page.parent / parts["src"]))
    return [(alt, file.resolve()) for alt, file in shown]


def unused(pictures, pages):
    """Images below a folder that no page shows."""
    shown = {file for page in pages for _, file in images(page)}
    files = {path.resolve() for path in pictures.rglob("*") if path.suffix in (".png", ".svg", ".jpg")}
    return sorted(path.relative_to(pictures.resolve()).as_posix() for path in files - shown)


def test_every_image_is_on_a_page():
    assert unused(PICTURES, PAGES) == [], "show it on a page, or delete it"


def test_an_image_on_no_page_is_found(tmp_path):
    (tmp_path / "more").mkdir()
    for name in ("a.png", "b.png", "more/c.png", "d.png"):
        (tmp_path / name).touch()
    (tmp_path / "page.md").write_text('![A](a.png)\n<img src="more/c.png" alt="C">\n`d.png` in words is not shown\n')
    assert unused(tmp_path, [tmp_path / "page.md"]) == ["b.png", "d.png"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_images_of_a_page_exist_and_have_a_text(page):
    assert not [file for alt, file in images(page) if not alt.strip() or not file.is_file()]


@pytest.fixture
def gallery(monkeypatch):
    monkeypatch.syspath_prepend(PICTURES)
    monkeypatch.delitem(sys.modules, "gallery", raising=False)
    import gallery

    return gallery


def test_the_pages_have_the_expression_of_each_figure(gallery):
    figures = gallery.figures()
    assert set(figures) == {path.stem for path in PICTURES.glob("show-*.png")}
    assert {said.split("(")[0] for said in figures.values()} == {
        f"rt.show.{n}" for n in ("bvh", "heatmap", "path", "samples")
    }
    for said in figures.values():
        ast.parse(said, mode="eval")


def test_the_gallery_has_commands_that_the_command_line_knows(gallery):
    parser, scenes = ArgumentParser(exit_on_error=False), gallery.scenes()
    render_options(parser)
    changed = {name for name, options in scenes.items() if options}
    assert changed == {"glass-sphere", "glass-sphere-transparent-shadow", "veach-lights"}
    for name, options in scenes.items():
        assert (PICTURES / f"{name}.png").is_file()
        parser.parse_args([f"{name}.json", *options])
