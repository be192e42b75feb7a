"""After ``warmup`` no picture needs Numba; and what a picture needs is compiled for it, and no more."""

import json
import os
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

import raytrace as rt
from raytrace import jit
from raytrace.cli.main import main
from raytrace.native import store
from raytrace.native.fallback import Unavailable
from raytrace.native.signatures import kind_of
from raytrace.rendering import warmup
from raytrace.rendering.compiled_scene import plan_of
from raytrace.rendering.kernels import needs, traits_of
from raytrace.rendering.path_kernels import path_needs_of
from shipped_scenes import ALL, SCENES

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


COMPILING = "compiling kernels (first run only)"


def without_progress(text):
    """Lines of a text without those that a slow machine prints: a line per 10 %."""
    return [line for line in text.splitlines() if not line.startswith("compiling: ")]


def test_after_the_warm_up_no_picture_of_a_shipped_scene_needs_numba(tmp_path):
    done = run("-m", "raytrace", "warmup", cache=tmp_path)
    assert (done.returncode, without_progress(done.stderr)) == (0, [COMPILING])
    pictures = list(product(map(str, SCENES), ("float32", "float64"), ("sobol", "stratified", "independent")))
    done = run("-c", DRAW, json.dumps(pictures), cache=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    done = run("-m", "raytrace", "warmup", cache=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")  # nothing is left


LAMP = """
{"camera": {"position": [0, 0, 4], "look_at": [0, 0, 0], "fov": 40}, "render": {"integrator": "path"},
 "materials": {"lamp": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5], "emission": [1, 1, 1]}},
 "objects": [{"box": {}, "material": "lamp"}]}
"""


def is_of_paths(kernel):
    title = kernel.read_bytes()[store.DIGEST :].split(b"\n")[0]
    return any(
        f"raytrace.passes.{module}.".encode() in title for module in ("paths", "lights", "materials", "compaction")
    )


def test_after_the_warm_up_of_a_scene_its_first_picture_needs_no_numba(tmp_path):
    scene, kept = tmp_path / "lamp.json", tmp_path / "kernels" / store.cache_folder().name
    scene.write_text(LAMP)
    kept.mkdir(parents=True, mode=0o700)
    for kernel in store.cache_folder().glob("*.kernel"):  # others that are there need not be compiled again
        if not is_of_paths(kernel):
            shutil.copy2(kernel, kept)
    done = run("-m", "raytrace", "warmup", str(scene), cache=tmp_path / "kernels")
    assert (done.returncode, without_progress(done.stderr)) == (0, [COMPILING])
    done = run("-c", DRAW, json.dumps([(str(scene), "auto", "sobol")]), cache=tmp_path / "kernels")
    assert (done.returncode, done.stderr) == (0, "")
    names = {kernel.name.rpartition("-")[0] for kernel in kept.iterdir() if is_of_paths(kernel)}
    assert {"go_on", "sample_triangles", "scatter_diffuse"} <= names
    assert not {"reflect_mirrors", "pass_dielectrics", "sample_points", "sample_environment"} & names


def kernels_of(renders):
    return {(kernel, tuple(map(kind_of, args))) for traits in renders for kernel, args in needs(traits)}


def test_the_warm_up_with_path_tracing_has_all_that_any_scene_needs():
    every = kernels_of(warmup.every_kind("path"))
    for path in ALL[::3]:
        scene = rt.load(path)
        needs_paths = path_needs_of(scene, "path")
        if needs_paths.textures or needs_paths.image or needs_paths.lens:
            continue  # as documented: these scenes are named
        for precision, sampler, integrator in product(*warmup_choices()):
            settings = scene.settings._replace(sampler=sampler, integrator=integrator)
            traits = traits_of(scene, plan_of(scene), precision, settings, layers=True, adaptive=True)
            assert kernels_of([traits]) <= every, path.stem


def warmup_choices():
    return warmup.PRECISIONS, warmup.SAMPLERS, ("direct", "path")


def test_the_warm_up_without_it_has_none_of_its_kernels():
    names = {f"{kernel.__module__}.{kernel.__name__}" for kernel, _ in kernels_of(warmup.every_kind())}
    assert "raytrace.passes.light.shadow_rays" in names
    assert not any(f".{module}." in name for name in names for module in ("paths", "lights", "materials"))


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
    errors = [line for line in errors if not line.startswith("compiling")]
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
