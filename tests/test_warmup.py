"""After ``warmup`` no picture needs Numba; and what a picture needs is compiled for it, and no more."""

import json
import os
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from raytrace import jit
from raytrace.cli import main
from raytrace.native import store

ROOT = Path(__file__).parents[1]
SCENES = sorted((ROOT / "scenes").glob("*.json"))
pytestmark = pytest.mark.skipif(jit.PLAIN, reason="kernels are plain functions")
DRAW = """
import json, sys
import raytrace as rt
for scene, precision, sampler in json.loads(sys.argv[1]):
    image = rt.render(scene, spp=2, size=(16, 16), precision=precision, sampler=sampler)
    image.aov["depth"]
    assert image.stats["compile_seconds"] == 0, (scene, precision, sampler)
    assert "numba" not in sys.modules, (scene, precision, sampler)
"""


def run(*words, cache):
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, timeout=600, cwd=ROOT,
        env=os.environ | {"RAYTRACE_CACHE": str(cache)},
    )  # fmt: skip


def test_after_the_warm_up_no_picture_of_a_shipped_scene_needs_numba(tmp_path):
    done = run("-m", "raytrace", "warmup", cache=tmp_path)
    assert (done.returncode, done.stderr) == (0, "compiling kernels (first run only)\n")
    pictures = list(product(map(str, SCENES), ("float32", "float64"), ("sobol", "stratified", "independent")))
    done = run("-c", DRAW, json.dumps(pictures), cache=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    done = run("-m", "raytrace", "warmup", cache=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")  # nothing is left


def test_a_folder_that_cannot_be_written_to_is_told(monkeypatch, tmp_path, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path / "file"))
    store.cache_folder.cache_clear()
    try:
        assert main(["warmup"]) == 4
    finally:
        monkeypatch.undo()
        store.cache_folder.cache_clear()
    assert "can't be written to; set RAYTRACE_CACHE" in capsys.readouterr().err
