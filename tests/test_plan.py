"""The plan says what a scene needs, says it truly, and what it leaves out is neither compiled nor run."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import make_sampler
from raytrace.records import REFRACTIVE
from raytrace.scene.plan import FLOAT32_RANGE, GAMMA, TOLERANCE, make_plan, smallest_height
from raytrace.wavefront import Wavefront, make_stage
from small_scenes import Part, ball, glass, look, make_scene, quad, studio

ROOT = Path(__file__).parents[1]
SCENES = sorted((ROOT / "scenes").glob("*.json"))
BOX = ROOT / "scenes" / "cornell-box.json"
each_scene = pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)

FLOOR = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))
LIGHT = ((0, 2, 0), (1, 1, 1))


def auto(scene):
    """The scene with precision "auto", small and with few samples."""
    return dataclasses.replace(scene, settings=scene.settings._replace(precision="auto", size=(16, 16), spp=2))


def moved(scene, scale=1.0, shift=0.0):
    """The whole scene, camera and lights too, scaled and then shifted along x."""
    shift = np.array([shift, 0.0, 0.0])
    camera = scene.camera._replace(
        position=scale * scene.camera.position + shift, look_at=scale * scene.camera.look_at + shift
    )
    lights = scene.lights._replace(position=scale * scene.lights.position + shift)
    mesh = scene.mesh._replace(vertices=scale * scene.mesh.vertices + shift)
    return dataclasses.replace(scene, camera=camera, lights=lights, mesh=mesh)


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


# Precision ------------------------------------------------------------------------------------------------------------


def test_the_cornell_box_is_drawn_in_float32_and_the_bound_says_why():
    precision = rt.explain(BOX).precision
    assert precision.name == "float32"
    gamma = GAMMA * 2.0**-24 / (1 - GAMMA * 2.0**-24)
    assert precision.largest == 6.8  # the camera's z
    assert precision.error == pytest.approx(6.8 * gamma, rel=1e-12)
    assert precision.error <= TOLERANCE * precision.feature
    assert precision.why == (
        "error of a point at most gamma(16) x 6.8 = 6.5e-06, is less than 1% of the smallest feature, 0.42"
    )


def test_the_bound_covers_the_points_that_float32_computes():
    scene = rt.load(BOX)
    layers = {p: rt.render(scene, spp=1, size=(64, 64), precision=p).aov for p in ("float32", "float64")}
    same = layers["float32"]["prim_id"] == layers["float64"]["prim_id"]
    assert same.mean() > 0.999
    exact = layers["float64"]["position"][same].astype(np.float64)
    # off the surface, not along it: along it a point moves with its ray
    ng = layers["float64"]["normal"][same]
    off = np.abs(((layers["float32"]["position"][same] - exact) * ng).sum(axis=-1))
    assert off.max() <= rt.explain(scene).precision.error


@pytest.mark.parametrize(
    ("scale", "shift", "reason"),
    [
        (1.0, 1e6, "in float32, error of a point at most gamma(16) x 1e+06 = 0.95, is more than 1% of the smallest"),
        (1e-13, 0.0, "sizes leave 1e-12 .. 1e+12"),
        (1e13, 0.0, "sizes leave 1e-12 .. 1e+12"),
    ],
    ids=["far from the origin", "tiny", "huge"],
)
def test_where_float32_is_too_coarse_the_box_is_drawn_in_float64(scale, shift, reason):
    scene = moved(rt.load(BOX), scale, shift)
    precision = rt.explain(scene).precision
    assert precision.name == "float64"
    assert precision.why.startswith(reason)
    picture = rt.render(scene, spp=1, size=(32, 32))
    assert picture.provenance["precision"] == "float64"
    if scale == 1.0:
        there, here = picture.rgb, rt.render(BOX, spp=1, size=(32, 32), precision="float64").rgb
        assert np.isclose(there, here, rtol=1e-3).all(axis=-1).mean() > 0.995  # but for pixels at edges


@pytest.mark.parametrize("scale", [1e-10, 1e10])
def test_sizes_alone_do_not_ask_for_float64(scale):
    scene = moved(rt.load(BOX), scale)
    assert rt.explain(scene).precision.name == "float32"
    scene = dataclasses.replace(scene, lights=scene.lights._replace(flux=scale**2 * scene.lights.flux))
    ask = {"spp": 4, "size": (48, 48)}
    picture, box = rt.render(scene, **ask), rt.render(BOX, **ask)
    assert picture.provenance["precision"] == "float32"
    assert np.isclose(picture.rgb, box.rgb, rtol=1e-4, atol=1e-6).all(axis=-1).mean() > 0.995


def test_a_sliver_asks_for_float64():
    sliver = np.array([[[0, 0, 0], [1, 0, 0], [0.5, 1e-5, 0]]])
    precision = make_plan(auto(make_scene([Part(FLOOR), Part(sliver)], [LIGHT]))).precision
    assert precision.name == "float64"
    assert precision.feature == pytest.approx(1e-5)
    assert "is more than 1% of the smallest feature, 1e-05" in precision.why


def test_a_far_light_or_camera_counts_as_a_coordinate():
    near = auto(make_scene([Part(FLOOR)], [LIGHT]))
    assert make_plan(near).precision.name == "float32"
    assert make_plan(auto(make_scene([Part(FLOOR)], [((1e7, 2, 0), (1, 1, 1))]))).precision.largest == 1e7
    assert make_plan(dataclasses.replace(near, camera=look((0, 0, 1e7), (0, 0, 0)))).precision.name == "float64"


def test_triangles_without_area_are_no_features():
    mesh = make_scene([Part(FLOOR)]).mesh
    point, line = np.zeros((1, 3), np.int64), np.array([[0, 0, 1]])
    assert smallest_height(mesh) == pytest.approx(2**0.5)
    assert smallest_height(mesh._replace(faces=np.concatenate([mesh.faces, point, line]))) == pytest.approx(2**0.5)


def test_a_scene_without_area_has_a_plan_and_a_black_picture():
    scene = auto(make_scene([Part(FLOOR)], [LIGHT]))
    scene = dataclasses.replace(scene, mesh=scene.mesh._replace(vertices=0 * scene.mesh.vertices))
    precision = make_plan(scene).precision
    assert (precision.name, precision.feature) == ("float32", np.inf)
    assert not rt.render(scene).rgb.any()


@pytest.mark.parametrize("asked", ["float32", "float64"])
def test_the_scene_s_wish_outranks_the_bound(asked):
    scene = rt.load(BOX)
    wished = dataclasses.replace(scene, settings=scene.settings._replace(precision=asked))
    assert rt.explain(wished).precision.name == asked
    assert rt.explain(wished).precision.why == "asked for by the scene"
    assert rt.render(wished, spp=1, size=(8, 8)).provenance["precision"] == asked


def test_the_limits_of_float32_are_where_its_cubes_are_normal_numbers():
    tiny, huge = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
    low, high = FLOAT32_RANGE
    assert low**3 > tiny
    assert high**3 < huge


# What is left out -----------------------------------------------------------------------------------------------------


def wavefront(scene):
    plan = make_plan(scene)
    stage = make_stage(scene, plan, "float32")
    view = make_view(scene.camera, scene.settings.size, np.dtype(np.float32))
    return stage, Wavefront(stage, view, make_sampler("sobol", 0, 1), 64)


def test_a_plain_scene_has_no_memory_for_what_it_lacks():
    stage, front = wavefront(make_scene([Part(FLOOR)], [LIGHT]))
    assert stage.shadow_bvh is stage.bvh
    assert stage.normals is None
    assert front.points.ns is front.points.ng
    assert front.bounced == []


def test_a_scene_that_has_it_gets_the_memory():
    triangles, normals = ball(4)
    parts = [Part(triangles, normals=normals), glass(FLOOR, 1.5, transparent_shadow=True)]
    stage, front = wavefront(make_scene(parts, [LIGHT]))
    assert len(stage.shadow_bvh.faces) == len(stage.bvh.faces) - 2
    assert len(stage.normals) == 9 * len(stage.bvh.faces)
    assert front.points.ns is not front.points.ng
    assert len(front.bounced) == 2


def test_where_all_surfaces_let_shadow_rays_pass_their_tree_is_empty():
    stage, _ = wavefront(make_scene([glass(FLOOR, 1.5, transparent_shadow=True)], [LIGHT]))
    assert len(stage.shadow_bvh.faces) == 0
    scene = auto(make_scene([glass(FLOOR, 1.5, transparent_shadow=True)], [LIGHT], background=(1, 2, 3)))
    assert np.unique(rt.render(scene).rgb.reshape(-1, 3), axis=0).tolist() == [[1.0, 2.0, 3.0]]


COLD = """
import json, sys
import raytrace as rt
from raytrace.accel import build, flatten, grow, query, triangle
from raytrace.passes import camera, film, light, refraction, sampling, surface

KERNELS = {
    "closest_hit": query.closest_hit, "any_hit": query.any_hit, "camera_rays": camera.camera_rays,
    "surface": surface.surface, "shadow_rays": light.shadow_rays, "accumulate": film.accumulate,
    "refract_rays": refraction.refract_rays, "land": refraction.land,
    "interface_direction": refraction.interface_direction, "shading_normal": surface.shading_normal,
    "measure": build.measure, "grow": grow.grow, "flatten": flatten.flatten,
    "watertight": triangle.watertight, "moller_trumbore": triangle.moller_trumbore,
    "sobol": sampling._sobol, "stratified": sampling._stratified, "independent": sampling._independent,
}
TYPED = "closest_hit", "any_hit", "camera_rays", "surface", "shadow_rays"
for scene in sys.argv[1:]:
    picture = rt.render(scene, spp=1, size=(16, 16))
    print(json.dumps({
        "compiled": {name: len(kernel.signatures) for name, kernel in KERNELS.items()},
        "double": [name for name in TYPED if "float64" in str(KERNELS[name].signatures)],
        "passes": picture.stats["seconds_by_pass"], "rays": picture.stats["rays"],
        "seconds": picture.stats["compile_seconds"], "layers": list(picture.aov.computed),
    }))
"""


@pytest.fixture(scope="module")
def cold(tmp_path_factory):
    """What a fresh process with an empty cache has compiled after each of three scenes."""
    cache = tmp_path_factory.mktemp("kernels")
    scenes = [str(ROOT / "scenes" / f"{name}.json") for name in ("cornell-box", "glass-slab", "glass-sphere")]
    done = subprocess.run(
        [sys.executable, "-c", COLD, *scenes],
        capture_output=True, text=True, timeout=300, cwd=ROOT, env={**os.environ, "RAYTRACE_CACHE": str(cache)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_the_plain_box_compiles_and_runs_no_more_than_it_needs(cold):
    box = cold[0]
    needed = {"closest_hit", "any_hit", "camera_rays", "surface", "shadow_rays", "accumulate", "watertight", "sobol"}
    assert needed == {name for name, count in box["compiled"].items() if count}
    assert all(box["compiled"][name] == 1 for name in needed - {"watertight"})  # one variant: a type, a scene
    assert box["double"] == []
    assert set(box["passes"]) == {"camera", "closest hit", "surface", "light", "shadow", "film"}
    assert set(box["rays"]) == {"camera", "shadow"}
    assert box["layers"] == []
    assert box["seconds"] > 0.5


def test_flat_glass_compiles_the_refraction_but_no_interpolation(cold):
    compiled = cold[1]["compiled"]
    assert compiled["refract_rays"] == compiled["land"] == 1
    assert compiled["measure"] == compiled["grow"] == compiled["flatten"] == 1  # more than 64 triangles
    assert compiled["interface_direction"] > 0
    assert compiled["shading_normal"] == 0
    assert cold[1]["rays"]["refraction"] > 0
    assert cold[1]["passes"]["refraction"] > 0


def test_smooth_glass_compiles_the_interpolation_but_never_what_nothing_asked_for(cold):
    compiled = cold[2]["compiled"]
    assert compiled["shading_normal"] > 0
    for count in cold:
        assert count["compiled"]["moller_trumbore"] == 0
        assert count["compiled"]["stratified"] == count["compiled"]["independent"] == 0
        assert count["double"] == []
