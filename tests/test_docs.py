"""The documents: complete, and true where a reader would copy from them. Sphinx checks their links (.ci/run)."""

import ast
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
    links = [link for link in re.findall(r"(?:\]\(|src=\")([^)#\"]+)", text) if "://" not in link]
    assert len(links) > 5
    assert not [link for link in links if not (ROOT / link).exists()]


def test_the_readme_is_short_and_its_python_works(tmp_path):
    text = (ROOT / "README.md").read_text("utf-8")
    assert text.count("\n") <= 120
    (program,) = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    small = program.replace("spp=64", "spp=1, size=(32, 24)").replace("scenes/", f"{ROOT.as_posix()}/scenes/")
    assert small.count("size=") == 1
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{small}print(hits.t)"],
        capture_output=True,
        text=True,
        timeout=600,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "room.png").stat().st_size > 0
    assert "inf" not in done.stdout


TOTALS = re.compile(
    r"^\| (Open3D|embreex|Mitsuba|Mitsuba, robust) \([\d.a-z]+\) +\| +\d+ \| +(\d+) \| +(\d+) \|", re.MULTILINE
)


@pytest.mark.parametrize("name", ["README.md", "docs/accuracy.md"])
def test_pages_quote_the_totals_of_the_hard_cases_as_they_were_measured(name):
    text = (ROOT / name).read_text("utf-8")
    totals = TOTALS.findall(page("numerics.md"))
    assert len(totals) == 2 * 4
    assert not [(tracer, wrong, leaks) for tracer, wrong, leaks in totals if f"{wrong} / {leaks}" not in text]


def test_the_textbook_page_names_functions_that_exist():
    table = [line for line in page("textbook.md").splitlines() if re.match(r"\| .* \| `textbook/", line)]
    assert len(table) == 10 + 6  # steps of the course, and of path tracing
    for line in table:
        for file, names in re.findall(r"`([\w/]+\.py)`: ((?:`[\w.]+`(?:, )?)+)", line):
            tree = ast.parse((ROOT / "raytrace" / file).read_text("utf-8"))
            defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
            assert set(re.findall(r"\w+", names)) <= defined, file


def test_the_glossary_names_classes_and_files_that_exist():
    package = ROOT / "raytrace"
    text = "".join(path.read_text("utf-8") for path in package.rglob("*.py"))
    terms = [line.split("|")[1:-1] for line in page("glossary.md").splitlines() if line.startswith("| ")][1:]
    assert len(terms) > 20
    assert [term for term, *_ in terms] == sorted(term for term, *_ in terms)
    for *_, where in terms:
        (name,) = re.findall(r"`(.*)`", where)
        assert f"class {name}(" in text or f"class {name}:" in text or (package / name).exists(), name


BOX = 34  # triangles of scenes/cornell-box.json


def test_documents_count_the_triangles_of_the_box_as_the_scene_has_them():
    assert len(raytrace.load(ROOT / "scenes" / "cornell-box.json").mesh.faces) == BOX
    claims = {
        "notebooks/01-rays-and-triangles.md": r"40,000 pixels, (\d+) triangles",
        "notebooks/07-from-one-ray-to-a-wavefront.md": (
            r"The Cornell box has (\d+) triangles|# \((\d+) triangles|"
            r"(\d+) triangles are a short array|With (\d+) triangles the tree"
        ),
        "benchmarks.md": r"plan and trees \((\d+) triangles|box, (\d+) triangles",
        "error.md": r"the box's (\d+) triangles",
        "robustness.md": r"for (\d+) triangles, takes",
    }
    for name, pattern in claims.items():
        found = [int(number) for groups in re.finditer(pattern, page(name)) for number in groups.groups() if number]
        assert len(found) == pattern.count("|") + 1, name
        assert set(found) == {BOX}, name


NOTEBOOK_PAGES = [name for name in PAGES if name.startswith("notebooks/")]
PROSE = re.compile(r"^ *```.*?^ *```|`[^`\n]*`", re.MULTILINE | re.DOTALL)  # what is not


@pytest.mark.parametrize("name", NOTEBOOK_PAGES)
def test_links_of_notebooks_lead_somewhere_without_the_site(name):
    """JupyterLab shows these pages as they stand: sources are links, and what is linked lies below its folder."""
    prose = PROSE.sub("", page(name))
    links = [link for link in re.findall(r"\]\(([^)#]+)", prose) if "://" not in link]
    missing = [link for link in links if not (DOCS / name).parent.joinpath(link).is_file()]
    assert not missing
    bare = [key for key in CITED.finditer(prose) if not prose[key.end() :].startswith("](")]
    assert not bare
    sources = [link for link in links if "references" in link]
    assert all((DOCS / name).parent.joinpath(link).resolve() == DOCS / "references.md" for link in sources)


def test_jupyterlab_is_started_where_all_documents_lie_below():
    commands = [line for line in page("notebooks/index.md").splitlines() if line.startswith("jupyter lab")]
    assert len(commands) == 1
    arguments = commands[0].split()[2:]
    assert all(word.startswith("--LabApp.default_url=/lab/tree/") for word in arguments)  # a folder would be its root
    assert all((ROOT / word.partition("/lab/tree/")[2]).is_file() for word in arguments)


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
            timeout=600,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine.exr").stat().st_size > 0
    assert done.stdout == "[ 1. inf] [ 0 -1]\n"


def test_meshes_of_other_packages_as_start_shows_them(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks("start.md", "mesh")), {})
    assert capsys.readouterr().out == "[4.5]\n12\n[0.7 0.7 0.7]\nTrue\n"
    assert len({path.read_bytes() for path in tmp_path.glob("turn-*.png")}) == 3


def test_the_scene_of_the_format_page_is_changed_and_saved(tmp_path, monkeypatch, capsys):
    (tmp_path / "scenes").symlink_to(ROOT / "scenes", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks("scene-format.md", "data")), {})
    assert capsys.readouterr().out == "True\n"
    assert (tmp_path / "wide-files").is_dir()


def test_rays_only_as_start_shows_them(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    (program,) = blocks("start.md", "rays")
    told = re.search(r"^print.*# (.*)$", program, re.MULTILINE)[1]
    space = {}
    exec(program, space)
    assert [round(float(word), 3) for word in capsys.readouterr().out.split()] == [float(word) for word in told.split()]
    in_rows = space["bvh"].closest_hit([0, 0, 4], space["directions"].reshape(-1, 3))
    assert (space["hits"].t.ravel() == in_rows.t).all()


def test_what_live_shows_works():
    pytest.importorskip("anywidget")
    (program,) = blocks("live.md", "python")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=600, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "(320, 320, 3) 16 1.33\n"
