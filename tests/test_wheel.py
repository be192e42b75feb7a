"""What is handed out: the package with all its files and nothing else, small, and without code that runs at install."""

import configparser
import io
import re
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LARGEST = 1_000_000  # bytes
KINDS = {".py", ".json", ".html", ".css", ".js", ".ply", ".typed"}  # of files; no programs, nothing that installs
pytestmark = pytest.mark.nojit


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    from hatchling.builders.wheel import WheelBuilder

    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("dist")), versions=["standard"])
    return Path(wheel)


@pytest.fixture(scope="module")
def wheel(path):
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def of(wheel: dict[str, bytes], name: str) -> bytes:
    """A file of the wheel's own folder."""
    return next(data for path, data in wheel.items() if re.fullmatch(rf"raytrace-[^/]*\.dist-info/{name}", path))


def test_it_is_small_and_for_any_machine(path):
    assert path.stat().st_size < LARGEST
    assert path.name.endswith("-py3-none-any.whl")


def test_it_holds_the_package_whole_and_nothing_else(wheel):
    ours = {name for name in wheel if not re.match(r"raytrace-[^/]*\.dist-info/", name)}
    files = (path for path in (ROOT / "raytrace").rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    assert ours == {path.relative_to(ROOT).as_posix() for path in files}
    assert "raytrace/scene/scene.schema.json" in ours
    assert {Path(name).suffix for name in ours} <= KINDS


def test_nothing_runs_when_it_is_installed_or_python_starts(wheel):
    assert not [name for name in wheel if name.endswith((".pth", ".so", ".pyd", ".dll", ".sh")) or ".data/" in name]
    for name in ("setup.py", "setup.cfg", "hatch_build.py"):
        assert not (ROOT / name).exists()
    project = (ROOT / "pyproject.toml").read_text("utf-8")
    hooks = set(re.findall(r"hooks\.[\w-]+", project))
    assert hooks == {
        "hooks.fancy-pypi-readme"
    }  # code at build time: it makes the README fit for an index, by data alone
    assert 'requires = ["hatchling' in project
    entries = configparser.ConfigParser(delimiters="=")
    entries.read_file(io.StringIO(of(wheel, r"entry_points\.txt").decode()))
    assert {section: dict(entries[section]) for section in entries.sections()} == {
        "console_scripts": {"raytrace": "raytrace.cli.main:main"},
        "pytest11": {"raytrace-golden": "raytrace.golden.plugin"},
    }


def test_the_description_has_no_link_into_the_folder(wheel):
    about = message_from_bytes(of(wheel, "METADATA"))
    text = about.get_payload()
    assert about["Description-Content-Type"] == "text/markdown"
    assert text.startswith("# raytrace\n")
    links = re.findall(r"\]\(([^)]*)\)", text) + re.findall(r"(?:src|href)=\"([^\"]*)", text)
    assert [link for link in links if not link.startswith("https://")] == []
    assert "![" not in text
    assert re.findall(r"^\|", text, re.MULTILINE) == []  # nothing of the tables of images is left
    assert "docs/start.md: from nothing to a scene" in text
    for heading in re.findall(r"^## .*", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE):
        assert heading in text


def test_its_classifiers_say_where_it_runs_and_that_it_is_typed(wheel):
    told = message_from_bytes(of(wheel, "METADATA")).get_all("Classifier")
    assert "raytrace/py.typed" in wheel
    assert {"Typing :: Typed", "Operating System :: POSIX :: Linux"} <= set(told)
    assert "Operating System :: OS Independent" not in told
    versions = [
        line.rpartition(" ")[2] for line in told if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", line)
    ]
    assert versions == ["3.11", "3.12", "3.13", "3.14"]


def test_its_licence_and_what_it_needs_are_told(wheel):
    assert b"MIT" in of(wheel, r"licenses/LICENSE")
    needs = message_from_bytes(of(wheel, "METADATA")).get_all("Requires-Dist")
    needed = [line for line in needs if "extra ==" not in line]
    assert {re.match(r"[\w-]+", line)[0].lower() for line in needed} == {
        "mapbox-earcut", "numpy", "numba", "pillow", "platformdirs", "psutil", "rich", "trimesh",
    }  # fmt: skip
    assert [line for line in needs if not re.match(r"[\w.-]+>=[\d.]+(;|$)", line)] == []  # a lower bound, and no other
