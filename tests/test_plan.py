"""The plan says what a scene needs, says it truly, and what it leaves out is neither compiled nor run."""

import dataclasses
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.jit import PLAIN
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import make_sampler
from raytrace.records import REFRACTIVE
from raytrace.rendering.compiled_scene import compile_scene
from raytrace.rendering.wavefront import Wavefront
from raytrace.scene.path_costs import most_rays
from raytrace.scene.plan import make_plan
from shipped_scenes import PATH_TRACED, SCENES, each_scene
from small_scenes import Part, ball, glass, make_scene, quad, studio

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"
compiled = pytest.mark.skipif(PLAIN, reason="kernels are plain functions")

FLOOR = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))
LIGHT = ((0, 2, 0), (1, 1, 1))


def auto(scene):
    """The scene with precision "auto", small and with few samples."""
    return dataclasses.replace(scene, settings=scene.settings._replace(precision="auto", size=(16, 16), spp=2))


def left_out(plan):
    return {what for what, _ in plan.left_out}


# What it says ---------------------------------------------------------------------------------------------------------


@each_scene
def test_the_plan_of_a_shipped_scene_is_true(path):
    scene = rt.load(path)
    plan = rt.explain(scene)
    used = {int(k) for k in scene.mesh.material_id}
    assert plan.refraction == any(scene.materials.kind[k] == REFRACTIVE for k in used)
    assert plan.transparent == any(scene.materials.transparent_shadow[k] for k in used)
    smooth = {item.get("normals", "flat") for item in json.loads(path.read_text("utf-8"))["objects"]}
    assert plan.smooth == ("smooth" in smooth)
    assert plan.lights == len(scene.lights.flux)
    assert f"{len(scene.mesh.faces):,} triangles in {len(scene.objects)} objects, {len(used)} materials" in plan.holds


@each_scene
def test_the_passes_that_it_names_are_those_that_run(path):
    picture = rt.render(path, size=(16, 16), spp=1)
    assert set(picture.stats["seconds_by_pass"]) == {name for name, _ in rt.explain(path).passes}


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize("path", [*PATH_TRACED[:3], SCENES[1]], ids=lambda path: path.stem)
def test_the_passes_of_path_tracing_that_it_names_are_those_that_run(path, integrator):
    picture = rt.render(path, size=(16, 16), spp=1, integrator=integrator)
    plan = rt.explain(path, integrator)
    assert set(picture.stats["seconds_by_pass"]) == {name for name, _ in plan.passes}
    scene = rt.load(path)
    most = most_rays(dataclasses.replace(scene, settings=scene.settings._replace(integrator=integrator)))
    if plan.paths:
        rays = picture.stats["rays"]
        assert (rays["camera"] + rays.get("path", 0)) / 256 <= most.closest + 0.1  # 256 samples
        if integrator == "path":
            assert rays.get("shadow", 0) / 256 <= (most.shadow + 0.1) * (1 + plan.transparent)


@pytest.mark.parametrize(("albedo", "depth"), [(0.7, 16), (0.2, 9), (0.9, 3), (1, 12)])
def test_in_a_closed_room_the_bound_on_rays_is_reached(albedo, depth):
    room = {
        "camera": {"position": [0, 0, 0], "look_at": [0, 0, 1], "fov": 60},
        "film": {"size": [64, 64]},
        "render": {"integrator": "path", "max_depth": depth, "spp": 4},
        "materials": {"wall": {"type": "diffuse", "albedo": [albedo] * 3, "emission": [1, 1, 1]}},
        "objects": [{"box": {}, "material": "wall", "flip": True}],
    }
    most, rays = most_rays(rt.load(room)), rt.render(room).stats["rays"]
    assert (rays["camera"] + rays["path"]) / 64**2 / 4 == pytest.approx(most.closest, rel=0.01)
    # a sixth of the lamps is the wall of the point itself, to which no ray is sent
    assert rays["shadow"] / 64**2 / 4 == pytest.approx(most.shadow * 5 / 6, rel=0.01)
    (row,) = [text for name, text in rt.explain(room).passes if name == "closest hit"]
    assert row == f"one query per ray, at most {most.closest:.3g} per sample on average"


def warned(lights=(), transparent=False, lamp=None, integrator="path"):
    """Warnings of a glass ball over a floor."""
    glass = {"type": "dielectric", "ior": 1.5, "shadows": "transparent" if transparent else "opaque"}
    scene = {
        "camera": {"position": [0, 2, 4], "look_at": [0, 0, 0], "fov": 40},
        "render": {"integrator": integrator},
        "lights": list(lights),
        "materials": {"floor": {"type": "diffuse", "albedo": [1, 1, 1]}, "glass": glass},
        "objects": [
            {"box": {}, "material": "floor", "scale": [2, 0.1, 2], "translate": [0, -1.5, 0]},
            {"sphere": {"center": [0, 0, 0], "radius": 1, "tolerance": 0.1}, "material": "glass"},
        ],
    }
    if lamp:
        scene["materials"]["lamp"] = {"type": "diffuse", "albedo": [0, 0, 0], "emission": [9, 9, 9]}
        scene["objects"].append({"rectangle": {}, "material": "lamp", "scale": lamp, "translate": [0, 3, 0]})
    return rt.explain(scene).warnings


def test_light_that_is_not_physical_or_found_badly_is_told():
    point = {"type": "point", "position": [0, 3, 0], "flux": [9, 9, 9]}
    sky = {"type": "environment", "radiance": [1, 1, 1]}
    assert [line[:20] for line in warned([point])] == ["point, spot and dire"]
    assert warned([sky]) == warned([point], integrator="direct") == warned(lamp=1.0) == ()
    assert [line.split(":")[0] for line in warned(lamp=0.01)] == ["lamp"]
    assert [line.split(":")[0] for line in warned([sky], transparent=True)] == ["glass"]


@each_scene
def test_its_text_holds_all_of_it(path):
    plan = rt.explain(path)
    text = str(plan)
    lines = text.splitlines()
    assert lines[0] == plan.about
    assert lines[1].endswith(plan.holds)
    assert lines[2] == f"precision  {plan.precision.name}: {plan.precision.why}"
    for name, what in (*plan.passes, *plan.left_out):
        assert any(line.startswith(f"  {name}  ") and line.endswith(f"  {what}") for line in lines)
    assert all(line and line == line.rstrip() for line in lines)


@pytest.mark.parametrize(
    ("scene", "absent"),
    [
        (
            make_scene([Part(FLOOR)], [LIGHT]),
            {"refraction pass", "normal interpolation", "second tree for shadows", "loop over lights"},
        ),
        (make_scene([Part(FLOOR)], [LIGHT, LIGHT]), {"refraction pass", "normal interpolation"}),
        (make_scene([Part(FLOOR)]), {"surface, shadow and light passes", "refraction pass", "normal interpolation"}),
        (make_scene([glass(FLOOR, 1.5)], [LIGHT, LIGHT]), {"normal interpolation", "second tree for shadows"}),
        (make_scene([glass(FLOOR, 1.5, transparent_shadow=True)], [LIGHT, LIGHT]), {"normal interpolation"}),
    ],
    ids=["plain", "two lights", "no light", "glass", "transparent glass"],
)
def test_what_a_scene_lacks_is_left_out(scene, absent):
    plan = make_plan(scene)
    assert absent <= left_out(plan)
    assert "layers (AOVs)" in left_out(plan)
    scene = auto(scene)
    assert set(rt.render(scene).stats["seconds_by_pass"]) == {name for name, _ in plan.passes}


def test_a_scene_that_has_everything_leaves_out_only_layers():
    assert left_out(make_plan(studio())) == {"layers (AOVs)"}


def test_a_material_that_no_triangle_has_costs_nothing():
    scene = make_scene([Part(FLOOR), glass(FLOOR + [0.0, 1.0, 0.0], 1.5)], [LIGHT])
    mesh = scene.mesh._replace(material_id=np.zeros_like(scene.mesh.material_id))
    assert not make_plan(dataclasses.replace(scene, mesh=mesh)).refraction


def test_explain_takes_what_render_takes(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT / "scenes")  # mesh paths of a dict are relative to the current folder
    content = json.loads(BOX.read_text("utf-8"))
    assert (
        str(rt.explain(content)) == str(rt.explain(BOX)) == str(rt.explain(str(BOX))) == str(rt.explain(rt.load(BOX)))
    )


# What is left out -----------------------------------------------------------------------------------------------------


def wavefront(scene):
    plan = make_plan(scene)
    compiled = compile_scene(scene, plan, "float32")
    view = make_view(scene.camera, scene.settings.size, np.dtype(np.float32))
    return compiled, Wavefront(compiled, view, make_sampler("sobol", 0, 1), 64)


def test_a_plain_scene_has_no_memory_for_what_it_lacks():
    compiled, front = wavefront(make_scene([Part(FLOOR)], [LIGHT]))
    assert compiled.shadow_bvhs == (compiled.bvh,)
    assert compiled.normals is None
    assert np.shares_memory(front.points.ns, front.points.ng)
    assert front.bounced == []


def test_a_scene_that_has_it_gets_the_memory():
    triangles, normals = ball(4)
    parts = [Part(triangles, normals=normals), glass(FLOOR, 1.5, transparent_shadow=True)]
    compiled, front = wavefront(make_scene(parts, [LIGHT]))
    assert len(compiled.shadow_bvhs[0].faces) == len(compiled.bvh.faces) - 2
    assert len(compiled.normals) == 9 * len(compiled.bvh.faces)
    assert not np.shares_memory(front.points.ns, front.points.ng)
    assert len(front.bounced) == 2


def test_where_all_surfaces_let_shadow_rays_pass_their_tree_is_empty():
    compiled, _ = wavefront(make_scene([glass(FLOOR, 1.5, transparent_shadow=True)], [LIGHT]))
    assert len(compiled.shadow_bvhs[0].faces) == 0
    scene = auto(make_scene([glass(FLOOR, 1.5, transparent_shadow=True)], [LIGHT], background=(1, 2, 3)))
    assert np.unique(rt.render(scene).rgb.reshape(-1, 3), axis=0).tolist() == [[1.0, 2.0, 3.0]]


BITS = {  # SHA-256 of radiance at 32 x 24 pixels and 3 samples, by the last commit without path tracing
    "cornell-box": "18d2db75502c7b16",
    "cornell-box-glass": "a6eba4857e4b3337",
    "glass-slab": "7a518f2d1e953d5d",
    "glass-sphere": "410f601524d479c0",
    "glass-sphere-transparent-shadow": "61eddc94bcffddbc",
    "prism": "9257ddd5642c680d",
    "room": "a9a592c627cb2702",
}


@pytest.mark.parametrize("name", BITS)
def test_scenes_without_path_tracing_keep_their_bits(name):
    rgb = rt.render(ROOT / "scenes" / f"{name}.json", spp=3, size=(32, 24)).rgb
    assert hashlib.sha256(np.ascontiguousarray(rgb).tobytes()).hexdigest()[:16] == BITS[name]


COLD = """
import json, os, sys
import raytrace as rt
from raytrace import parallel
from raytrace.native import store

cores = 1 if sys.argv[1] == "alone" else 2
parallel.thread_count = lambda threads: threads or cores
for scene in sys.argv[2:]:
    picture = rt.render(scene, spp=1, size=(16, 16))
    files = [path.read_bytes()[store.DIGEST:].split(b"\\n")[0].decode() for path in store.cache_folder().iterdir()]
    print(json.dumps({
        "modules": [name for name in sys.modules if name.startswith("raytrace.")],
        "kept": sorted(title.split(" ", 2)[2] for title in files), "numba": "numba" in sys.modules,
        "passes": picture.stats["seconds_by_pass"], "rays": picture.stats["rays"],
        "seconds": picture.stats["compile_seconds"], "layers": list(picture.aov.computed),
    }))
"""


@pytest.fixture(scope="module", params=["alone", "with other processes"])
def cold(request, tmp_path_factory):
    """What a fresh process with an empty store has compiled after each of three scenes."""
    cache = tmp_path_factory.mktemp("kernels")
    scenes = [str(ROOT / "scenes" / f"{name}.json") for name in ("cornell-box", "glass-slab", "glass-sphere")]
    done = subprocess.run(
        [sys.executable, "-c", COLD, request.param, *scenes],
        capture_output=True, text=True, timeout=600, cwd=ROOT, env={**os.environ, "RAYTRACE_CACHE": str(cache)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def kernels(titles):
    """Names of kernels, each as often as it was compiled."""
    return sorted(title.partition("(")[0].rpartition(".")[2] for title in titles)


PATH_MODULES = [f"raytrace.rendering.{path.stem}" for path in (ROOT / "raytrace" / "rendering").glob("path_*.py")]
PATH_MODULES += [
    f"raytrace.passes.{name}" for name in ("paths", "lights", "materials", "fresnel", "warp", "path_records")
]
PATH_MODULES += ["raytrace.rendering.light_table"]

TRACING = [
    "accumulate",
    "any_hit",
    "background",
    "camera_rays",
    "closest_hit",
    "develop",
    "errors",
    "reflect_light",
    "shadow_rays",
    "surface",
]


@compiled
def test_the_plain_box_compiles_and_runs_no_more_than_it_needs(cold):
    box = cold[0]
    assert kernels(box["kept"]) == TRACING  # one variant of each
    assert set(box["passes"]) == {"camera", "closest hit", "surface", "light", "shadow", "film"}
    assert set(box["rays"]) == {"camera", "shadow"}
    assert box["layers"] == []
    assert box["seconds"] > 0.5


@compiled
def test_scenes_without_path_tracing_import_and_compile_nothing_of_it(cold):
    assert {"raytrace.passes.light", "raytrace.rendering.wavefront"} <= set(cold[2]["modules"])
    assert len(PATH_MODULES) >= 10
    assert any("raytrace.passes.light." in title for title in cold[2]["kept"])
    for count in cold:
        assert not set(count["modules"]) & set(PATH_MODULES)
        assert not [title for title in count["kept"] if any(f"{name}." in title for name in PATH_MODULES)]


@compiled
def test_flat_glass_compiles_the_refraction_but_no_interpolation(cold):
    new = set(cold[1]["kept"]) - set(cold[0]["kept"])
    assert kernels(new) == [
        "fill_leaves",
        "flatten",
        "grow",
        "land",
        "measure",
        "refract_rays",
    ]  # more than 64 triangles
    assert all("None" in title for title in new if "refract_rays" in title)  # in the place of normals
    assert cold[1]["rays"]["refraction"] > 0
    assert cold[1]["passes"]["refraction"] > 0


@compiled
def test_smooth_glass_compiles_the_interpolation_but_never_what_nothing_asked_for(cold):
    new = set(cold[2]["kept"]) - set(cold[1]["kept"])
    assert kernels(new) == ["refract_rays", "surface"]
    for count in cold:
        assert set(count["kept"]) <= set(cold[2]["kept"])
    for title in cold[2]["kept"]:
        assert not any(word in title for word in ("MollerTrumbore", "Stratified", "Independent"))
        assert "Sobol" in title or "camera_rays" not in title
        assert "float32" in title or ".errors(" in title  # errors of sums, which are float64
        in_double = [
            record for record in ("Nodes", "Leaves", "Points", "Shading", "View") if f"{record}(float64" in title
        ]
        assert not in_double


@compiled
def test_with_other_processes_to_compile_for_it_a_process_never_imports_numba(cold, request):
    alone = "alone" in request.node.name
    assert [count["numba"] for count in cold] == [alone] * 3
