"""After ``warmup`` no picture needs Numba; and what a picture needs is compiled for it, and no more."""

import json
import os
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from raytrace import jit
from raytrace.cli.main import main
from raytrace.native import store
from raytrace.native.fallback import Unavailable
from raytrace.rendering import warmup
from shipped_scenes import SCENES

ROOT = Path(__file__).parents[1]
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


def test_what_could_not_be_kept_is_told(monkeypatch, tmp_path, capsys):
    kernel = type("Kernel", (), {"stored": lambda *_: None, "compile": lambda *_: None, "unkept": lambda *_: b"code"})()
    monkeypatch.setattr(warmup, "compile_ahead", lambda *_: [(kernel, ()), (kernel, ())])
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path))
    store.cache_folder.cache_clear()
    try:
        assert main(["warmup"]) == 4
        monkeypatch.setattr(kernel.__class__, "compile", lambda *_: (_ for _ in ()).throw(Unavailable("no such part")))
        assert main(["warmup"]) == 1
        monkeypatch.setattr(store, "can_keep", lambda: False)
        monkeypatch.setattr(warmup, "compile_ahead", lambda *_: [])
        assert main(["warmup"]) == 0  # all is there, in a folder that is read-only
    finally:
        monkeypatch.undo()
        store.cache_folder.cache_clear()
    errors = capsys.readouterr().err.splitlines()
    errors = [line for line in errors if line != "compiling kernels (first run only)"]
    assert errors[0].endswith("2 of 2 kernels could not be written")
    assert errors[1] == "kernels can't be compiled in advance, only in each process: no such part"


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
