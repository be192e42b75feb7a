"""The scene that comes with the package works from anywhere: any folder, a wheel, a zip."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.image.files import srgb8

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "raytrace" / "scene" / "demo"


def test_it_is_a_scene_without_a_fault():
    scene = rt.demo()
    assert scene.warnings == ()
    assert scene.about
    assert len(scene.mesh.faces) < 30_000
    assert rt.explain(scene).precision.name == "float32"
    assert scene.sha256 == rt.load(FOLDER / "demo.json").sha256


def test_its_image_is_well_exposed_and_shows_every_object():
    image = rt.render(rt.demo(), spp=4, size=(160, 120), aov=("prim_id",), seed=0)
    grey = srgb8(image.rgb).mean(axis=2) / 255
    assert 0.4 < grey.mean() < 0.7
    assert (grey > 0.99).mean() < 0.02
    assert (grey < 0.02).mean() < 0.05
    scene, seen = rt.demo(), image.aov["prim_id"]
    assert (seen >= 0).all()  # the backdrop fills the film
    objects = np.bincount(scene.mesh.object_id[seen.ravel()], minlength=len(scene.objects))
    assert (objects > 100).all()


def test_the_command_renders_it_to_demo_png_in_the_current_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main(["demo", "--spp", "1", "--size", "16x12", "--quiet"]) == 0
    assert capsys.readouterr() == ("demo.png\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["demo.png"]
    assert main.main(["demo", "--spp", "1", "--size", "16x12", "--quiet", "-o", "b.npz", "--aov", "depth"]) == 0
    assert capsys.readouterr().out == "b.npz\n"


@pytest.mark.parametrize("words", [["demo", "scene.json"], ["demo", "--root", "."]])
def test_the_command_takes_no_scene(words, capsys):
    with pytest.raises(SystemExit, match="2"):
        main.main(words)
    assert "unrecognized arguments" in capsys.readouterr().err


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    from hatchling.builders.wheel import WheelBuilder

    folder = tmp_path_factory.mktemp("dist")
    return next(iter(WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])))


def test_it_loads_from_a_wheel_in_another_folder(wheel, tmp_path):
    """A wheel is a zip; Python imports from it, and there is no file of the package on the disk."""
    program = "import raytrace as rt; print(rt.__file__); print(rt.demo().sha256)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        capture_output=True,
        text=True,
        timeout=600,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(wheel)},
    )
    assert done.returncode == 0, done.stderr
    where, sha256 = done.stdout.split()
    assert where.startswith(str(wheel))
    assert sha256 == rt.demo().sha256


def test_its_meshes_are_those_that_the_script_makes(tmp_path):
    subprocess.run([sys.executable, ROOT / "scenes" / "meshes" / "make_demo.py", tmp_path], check=True)
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert made == {path.name: path.read_bytes() for path in FOLDER.glob("*.ply")}
    used = {entry["mesh"] for entry in json.loads((FOLDER / "demo.json").read_text("utf-8"))["objects"]}
    assert used == made.keys()


def test_the_documents_name_it():
    assert re.search(r"raytrace demo\b", (ROOT / "README.md").read_text("utf-8"))
