"""The public face: which names there are, and what they cost."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import raytrace as rt
from raytrace.jit import PLAIN

ROOT = Path(__file__).parents[1]
MISTAKE = "{'camera': {'lense': 1}}"
WARM = "rt.render('scenes/cornell-box.json', spp=1, size=(16, 16)).save(sys.argv[1] + '/a.png')"
MAY_IMPORT = {  # what is run -> the packages that it may import, beside Python's own
    "import raytrace": set(),
    "rt.load": set(),
    "main(['--help'])": set(),
    "main(['nowhere.json'])": set(),
    "main(['scenes/cornell-box.json', '--aov', 'colour'])": set(),
    "main(['schema'])": set(),
    f"rt.load({MISTAKE})": set(),
    "main(['explain', 'scenes/cornell-box.json'])": {"numpy"},
    "main(['check', 'scenes/cornell-box.json'])": {"numpy"},
    "rt.reflect([0, 0, -1], [0, 0, 1])": {"numpy", "llvmlite"},  # one formula with the kernels
    "rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])": {"numpy", "llvmlite"},
    WARM: {"numpy", "llvmlite", "platformdirs"},
}
HEAVY = {
    "numba",
    "llvmlite",
    "numpy",
    "trimesh",
    "scipy",
    "skimage",
    "matplotlib",
    "PIL",
    "OpenEXR",
    "rich",
}
FUNCTIONS = {
    *(
        "camera_rays",
        "compare",
        "demo",
        "explain",
        "load",
        "radiance",
        "reflect",
        "refract",
        "render",
        "report",
        "save",
    ),
    "spawn_ray",
}
CLASSES = {
    *("AllHits", "BVH", "ClosestPoint", "Hits", "Render", "Scene", "Surface"),
    *("RaytraceError", "SceneError", "FileError", "OptionError"),
}
ROOMS = {"bsdf", "show", "testing", "textbook"}
SUBMODULES = [
    "rendering.rendering",
    "rendering.result",
    "rendering.wavefront",
    "scene.load",
    "scene.plan",
    "image.metrics",
    "reporting.sweep",
    "accel.bvh",
    "optics",
    "cli.main",
]


def python(program, *words):
    done = subprocess.run(
        [sys.executable, *words, "-c", program], capture_output=True, text=True, timeout=600, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def parameters(thing):
    return [(name, p.default) for name, p in inspect.signature(thing).parameters.items()]


def test_the_public_names_are_the_promised_ones():
    assert set(rt.__all__) == FUNCTIONS | CLASSES | ROOMS
    assert rt.__all__ == sorted(rt.__all__)
    assert all(callable(getattr(rt, name)) for name in FUNCTIONS)
    assert all(inspect.isclass(getattr(rt, name)) for name in CLASSES)
    assert set(rt.__all__) <= set(dir(rt))


def test_functions_take_what_scripts_pass_them():
    names = [name for name, _ in parameters(rt.render)]
    assert names[:6] == ["scene", "spp", "size", "seed", "precision", "sampler"]
    assert {"threads", "progress"} <= set(names)
    box = [("vertices",), ("faces", None), ("precision", "float32"), ("split", "sah"), ("triangle", "watertight")]
    assert [
        (name, *(() if default is inspect.Parameter.empty else (default,))) for name, default in parameters(rt.BVH)
    ] == box
    ray = ["self", "origins", "directions", "tmin", "tmax"]
    assert [name for name, _ in parameters(rt.BVH.closest_hit)] == [*ray, "threads"]
    assert [name for name, _ in parameters(rt.BVH.any_hit)][:5] == ray
    assert [name for name, _ in parameters(rt.refract)] == ["d", "n", "eta"]
    assert [name for name, _ in parameters(rt.reflect)] == ["d", "n"]
    assert [name for name, _ in parameters(rt.spawn_ray)] == ["p", "p_error", "ng", "d"]
    assert [name for name, _ in parameters(rt.compare)] == ["image", "reference", "flip"]
    assert rt.Hits._fields == ("t", "prim_id", "u", "v")
    assert rt.Surface._fields == ("p", "p_error", "ng")


def test_errors_have_one_root():
    assert all(issubclass(error, rt.RaytraceError) for error in (rt.SceneError, rt.FileError, rt.OptionError))


def imported(program, *words):
    """Packages that a program has imported, beside Python's own and what its start brings."""
    program = f"""
import sys
before = set(sys.modules)
import raytrace as rt
from raytrace.cli.main import main
try:
    {program}
except (SystemExit, rt.RaytraceError):
    pass
names = {{name.partition(".")[0] for name in set(sys.modules) - before if not name.startswith("_sysconfigdata")}}
print()
print(*(names - sys.stdlib_module_names - {{"raytrace"}}))
"""
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=600, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("program", MAY_IMPORT)
def test_nothing_is_imported_before_it_is_needed(program, tmp_path):
    if program == WARM:
        imported(program, tmp_path)  # compiles, at the first time
        if PLAIN:
            pytest.skip("kernels are plain functions")
    assert imported(program, str(tmp_path)) <= MAY_IMPORT[program]


def test_a_name_is_imported_when_it_is_first_used_and_then_kept():
    program = """
import sys, raytrace as rt
assert "render" not in vars(rt)
first = rt.render
assert vars(rt)["render"] is first is rt.render
assert not {"trimesh", "skimage"} & sys.modules.keys()
"""
    python(program)


def test_a_star_import_brings_the_public_names():
    python("from raytrace import *; assert callable(render) and callable(load) and callable(BVH)")


@pytest.mark.parametrize("submodule", SUBMODULES)
def test_a_public_name_is_no_submodule(submodule):
    python(f"import raytrace.{submodule}, raytrace as rt, inspect; assert inspect.isfunction(rt.render), rt.render")


def test_no_file_of_the_package_has_the_name_of_a_public_function():
    assert not FUNCTIONS & {path.stem for path in (ROOT / "raytrace").glob("*")}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'raytrace' has no attribute 'rendr'"):
        _ = rt.rendr


def test_the_version_is_a_release_or_the_development_of_one():
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", rt.__version__)  # PEP 440
    assert f"\nversion: {rt.__version__}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"{{{rt.__version__}}}" in (ROOT / "docs" / "cite.md").read_text("utf-8")


def test_the_architecture_names_every_module():
    text = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    modules = {path.relative_to(ROOT / "raytrace").as_posix() for path in (ROOT / "raytrace").rglob("*.py")}
    rooms = [line for line in text.splitlines() if line.startswith("| `")]
    named = {line.split("`")[1] for line in rooms}
    described = {name for name in modules if (ROOT / "raytrace" / name).read_text("utf-8").count("\n") > 1}
    assert {name for name in named if name.endswith(".py")} == described
