"""The documents: complete, and true where a reader would copy from them. Sphinx checks their links (.ci/run)."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import raytrace

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))
SCENES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "scenes").rglob("*.json"))
DIRECTIVE = re.compile(r"^\.\. auto\w+:: ([\w.]+)$", re.MULTILINE)
CITED = re.compile(r"\[([A-Z][A-Za-z]+[0-9]{4})(?:, [^]]*)?\]")


def page(name):
    return (DOCS / name).read_text("utf-8")


def blocks(name, mark):
    """Code below <!-- tested: mark --> in a page."""
    return re.findall(rf"^<!-- tested: {mark} -->\n```\w+\n(.*?)^```$", page(name), re.MULTILINE | re.DOTALL)


def test_the_api_page_has_every_public_name():
    listed = DIRECTIVE.findall(page("api.md"))
    assert {f"raytrace.{name}" for name in raytrace.__all__} <= set(listed)
    assert {f"raytrace.show.{name}" for name in raytrace.show.__all__} <= set(listed)
    assert len(listed) == len(set(listed))


@pytest.mark.parametrize("scene", SCENES)
def test_the_gallery_shows_every_scene_with_its_file(scene):
    text = page("gallery.md")
    assert f"]({Path('..', scene).as_posix()})" in text
    assert f"```{{literalinclude}} ../{scene}\n" in text
    assert json.loads((ROOT / scene).read_text("utf-8"))["about"] in text


@pytest.mark.parametrize("name", PAGES)
def test_every_cited_source_is_listed(name):
    listed = re.findall(r"^- \*\*\[(\w+)\]", page("references.md"), re.MULTILINE)
    assert set(CITED.findall(page(name))) <= set(listed)


def test_links_of_the_readme_lead_somewhere():
    text = (ROOT / "README.md").read_text("utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    assert len(links) > 5
    assert not [link for link in links if not (ROOT / link).exists()]


def test_what_start_shows_works(tmp_path):
    (scene,) = blocks("start.md", "scene")
    (tmp_path / "mine.json").write_text(scene, "utf-8")
    shutil.copytree(ROOT / "scenes", tmp_path / "scenes")  # a link would lead out of the scene's folder
    programs = blocks("start.md", "python")
    assert len(programs) == 2
    for program in programs:
        small = program.replace("spp=64", "spp=4, size=(48, 32)").replace("spp=4, seed", "spp=4, size=(48, 32), seed")
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{small}"],
            capture_output=True,
            text=True,
            timeout=300,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine.exr").stat().st_size > 0
    assert done.stdout == "[ 1. inf] [ 0 -1]\n"


def test_meshes_of_other_packages_as_start_shows_them(capsys):
    (program,) = blocks("start.md", "mesh")
    exec(program, {})
    assert capsys.readouterr().out == "[4.5]\n12\n"


def test_what_live_shows_works():
    pytest.importorskip("anywidget")
    (program,) = blocks("live.md", "python")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=300, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "(320, 320, 3) 16 1.33\n"
