"""The plugin in a pytest of its own, as another project has it."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from test_init import HEAVY, python

ROOT = Path(__file__).parents[1]
TESTS = """
import numpy as np
import pytest

@pytest.mark.parametrize("level", range(4))
def test_grey(golden, level):
    golden.check(np.full((16, 16, 3), 0.1 + 0.2 * level) * SCALE, f"grey-{level}")

def test_noise(golden):
    golden.check(lambda seed: SCALE * np.random.default_rng(seed).uniform(size=(16, 16)), "noise")
"""

NAMES = ["grey-0", "grey-1", "grey-2", "grey-3", "noise"]


@pytest.fixture
def project(tmp_path):
    """Another project: a folder with one file of tests, and a way to run them; output, exit code."""
    tests = tmp_path / "checks" / "test_pictures.py"
    tests.parent.mkdir()

    def run(*words, scale=1.0, ini="", plugin=("-p", "raytrace.golden.plugin"), folder=tmp_path):
        tests.write_text(TESTS.replace("SCALE", str(scale)))
        (tmp_path / "pytest.ini").write_text(f"[pytest]\n{ini}")
        command = [sys.executable, "-m", "pytest", "-p", "no:raytrace-golden", *plugin, "-q", "--color=no", *words]
        environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "400"}
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
        return done.stdout + done.stderr, done.returncode

    return run


def goldens(folder):
    return sorted(path.name for path in (folder / "checks" / "golden").glob("*"))


def test_goldens_are_missing_then_written_then_kept(project, tmp_path):
    output, code = project()
    assert code == 1
    assert "5 failed" in output
    line = (
        r"there is no checks/golden/grey-2\.npz: .* pytest --update-goldens 'checks/test_pictures\.py::test_grey\[2\]'"
    )
    assert re.search(line, output)
    assert goldens(tmp_path) == []
    output, code = project("--update-goldens", "-n", "2")  # with pytest-xdist
    assert code == 0
    told = re.search(r"= golden images written =+\n(.*?)\n\d+ passed", output, re.DOTALL)[1].splitlines()
    assert told == [f"checks/golden/{name}.npz and .png" for name in NAMES]
    written = goldens(tmp_path)
    assert written == [f"{name}.{kind}" for name in NAMES for kind in ("npz", "png")]
    output, code = project("-n", "2")
    assert "5 passed" in output
    assert "written" not in output
    assert not any((tmp_path / "golden-failures").rglob("*.html"))
    output, code = project("-n", "2", scale=1.02)
    assert code == 1
    errors = [line for line in output.splitlines() if line.startswith("E ") and "golden 'grey-1'" in line]
    assert len(errors) == 1
    assert re.search(
        r"relative bias of red 0\.02 is above 0\.001; .* \(ssim .*\); see golden-failures/checks/golden/grey-1\.html$",
        errors[0],
    )
    assert "/golden/" not in output.replace("see golden-failures/checks/golden/", "")  # the traceback ends in the test
    failures = tmp_path / "golden-failures"
    assert "\n5 failures, all in golden-failures/index.html\n" in output
    index = (failures / "index.html").read_text("utf-8")
    links = re.findall(r'<h2><a href="([^"]+)">(.*?)</a>', index)
    assert links == [(f"checks/golden/{name}.html", name) for name in NAMES]
    assert all((failures / link).is_file() for link, _ in links)
    assert [index.count(f'<img alt="{title}"') for title in ("expected", "actual", "difference")] == [5, 5, 5]
    assert index.count("Likely cause: all light is multiplied by 1.02.") == 4
    assert goldens(tmp_path) == written
    output, _ = project("-k", "grey-1 or 1]", scale=1.02)  # a single failure needs no index
    assert "index.html" not in output
    assert not (failures / "index.html").exists()


def test_files_are_named_from_where_pytest_is_called(project, tmp_path):
    output, _ = project("test_pictures.py::test_noise", folder=tmp_path / "checks")
    line = "there is no golden/noise.npz: look at the image, then write it: pytest --update-goldens "
    assert f"{line}test_pictures.py::test_noise; see ../golden-failures/checks/golden/noise.html" in output
    output, code = project("--update-goldens", "test_pictures.py::test_noise", folder=tmp_path / "checks")
    assert code == 0
    assert "\ngolden/noise.npz and .png\n" in output


def test_a_picture_that_is_none_is_told_at_the_line_of_the_test(project):
    output, _ = project("-k", "0", scale="1.0 + 1j")
    assert "expected floats or uint8, got complex128" in output
    assert "light.py" not in output


def test_what_is_missing_is_told_in_one_line(project, tmp_path):
    (tmp_path / "conftest.py").write_text(
        "import importlib.util as u\nfind = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name == 'skimage' else find(name, *rest)\n"
    )
    output, code = project("-k", "noise", plugin=("-p", "conftest", "-p", "raytrace.golden.plugin"))
    assert code == 1
    assert "\nthe fixture golden needs scikit-image: pip install scikit-image\n" in output
    assert "Traceback" not in output


def test_options_of_the_configuration(project, tmp_path):
    ini = "golden_folder = approved\ngolden_failures = left\ngolden_max_bias = none\ngolden_max_worst_tile = 0.05\n"
    assert project("--update-goldens", ini=ini)[1] == 0
    assert len(list((tmp_path / "approved").glob("*.npz"))) == 5
    assert project(scale=1.02, ini=ini)[1] == 0
    assert "see left/approved/grey-0.html" in project(scale=1.1, ini=ini)[0]
    output, code = project(ini="golden_max_bias = few\n")
    assert code != 0
    assert "golden_max_bias: expected a number or none, got 'few'" in output


def test_it_can_be_left_out(project):
    output, code = project(plugin=())
    assert code == 1
    assert "fixture 'golden' not found" in output
    assert project("--co", plugin=(), ini="")[1] == 0


def test_another_plugin_of_the_same_names_keeps_them(project, tmp_path):
    (tmp_path / "pytest_golden.py").write_text(
        "import pytest\n"
        "def pytest_addoption(parser):\n    parser.addoption('--update-goldens', action='store_true')\n"
        "@pytest.fixture\ndef golden():\n    raise AssertionError('the other one')\n"
    )
    both = ("-p", "raytrace.golden.plugin", "-p", "pytest_golden")
    output, code = project(plugin=both)
    assert code == 1
    assert "the other one" in output
    assert "raytrace_golden" in project("--fixtures", plugin=both)[0]


def test_the_plugin_is_light():
    program = f"import sys, pytest, raytrace.golden.plugin; print(*({HEAVY!r} & sys.modules.keys()))"
    assert python(program).split() == []


def test_the_entry_point_names_the_plugin():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"raytrace-golden": "raytrace.golden.plugin"}


def test_the_plugin_works_where_the_renderer_s_packages_are_missing(project, tmp_path):
    packages = {"numba", "llvmlite", "trimesh", "rich", "platformdirs", "mapbox_earcut", "psutil"}
    hook = f"def pytest_configure():\n    sys.modules |= dict.fromkeys({packages})\n"  # then their imports fail
    (tmp_path / "missing.py").write_text(f"import sys\n{hook}")
    missing, folder = ("-p", "missing", "-p", "raytrace.golden.plugin"), "python_files = test_*.py\npythonpath = ."
    output, code = project("--update-goldens", plugin=missing, ini=folder)
    assert code == 0, output
    output, code = project(scale=1.1, plugin=missing, ini=folder)  # with a page, causes and an index
    assert code == 1
    assert "5 failed" in output
    assert (tmp_path / "golden-failures" / "index.html").exists()
    done = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    needed = {re.split(r"[^\w-]", text)[0].replace("-", "_") for text in done} - packages
    assert needed == {"numpy", "pillow"}  # docs/goldens.md names these; scikit-image brings them
