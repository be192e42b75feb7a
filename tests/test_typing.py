"""Our types reach the programs that use them: a strict type checker knows each result, and finds mistakes."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import raytrace as rt

pytest.importorskip("mypy", reason="checks types: pip install mypy")

ROOT = Path(__file__).parents[1]
PROGRAM = """\
from collections.abc import Sequence
from pathlib import Path
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import raytrace as rt
from raytrace import compiled
from raytrace.adapters.trimesh import RayMeshIntersector
from raytrace.golden.check import Golden
from raytrace.golden.gates import Verdict
from raytrace.image.comparison import Comparison
from raytrace.reporting.sweep import Report
from raytrace.scene.plan import Plan
from raytrace.show.path_drawing import PathDrawing
from raytrace.show.widget import Viewer

Floats = NDArray[np.floating]
F8 = NDArray[np.float64]

# Images
scene = rt.load("scene.json")
assert_type(scene, rt.Scene)
assert_type(scene.mesh.vertices, F8)
assert_type(rt.demo(), rt.Scene)
image = rt.render(scene, spp=4, size=(64, 64), aov=("depth",), progress=lambda p: print(p.stage, p.done))
assert_type(image, rt.Render)
assert_type(image.rgb, NDArray[np.float32])
assert_type(image.aov["depth"], NDArray[Any])
assert_type(image.save("a.png"), Path)
np.asarray(image).mean()
rt.render({"camera": {}}, camera={"position": [0, 0, 1]}, integrator="path", time_limit=1.0)
assert_type(rt.compare(image, "b.exr"), Comparison)
assert_type(rt.compare(image, image.rgb).rmse, float)
plan = rt.explain(scene)
assert_type(plan, Plan)
print(plan.precision.name.upper())
report = rt.report(scene, "folder", budget=5)
assert_type(report, Report)

# Rays
bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
rt.BVH(scene.mesh.vertices, scene.mesh.faces, precision="float64")
o, d = rt.camera_rays(scene)
o, d = rt.camera_rays(K=np.eye(3), pose=np.eye(4), size=(4, 4))
assert_type(o, F8)
hits = bvh.closest_hit(o, d)
assert_type(hits, rt.Hits)
assert_type(hits.t, Floats)
assert_type(bvh.any_hit(o, [0, 0, -1], tmax=2), NDArray[np.bool_])
assert_type(bvh.all_hits(o, d), rt.AllHits)
assert_type(bvh.count_hits(o, d), NDArray[np.int32])
assert_type(bvh.contains([0, 0, 0]), NDArray[np.bool_])
assert_type(bvh.closest_point([0, 0, 0]), rt.ClosestPoint)
assert_type(bvh.signed_distance([0, 0, 0]), Floats)
surface = bvh.surface(hits)
assert_type(surface, rt.Surface)
assert_type(bvh.stats.nodes, int)
bvh.refit(np.zeros((3, 3)))
bvh.validate()
assert_type(rt.reflect(d, surface.ng), Floats)
assert_type(rt.refract(d, surface.ng, 1.5)[0], Floats)
assert_type(rt.spawn_ray(surface.p, surface.p_error, surface.ng, d), Floats)
light, stderr = rt.radiance(scene, o, d, spp=4)
assert_type(light, F8)
handle = compiled.handle(bvh)
t, prim_id, u, v = compiled.closest_hit(handle, (0, 0, 1), (0, 0, -1))
print(bool(compiled.any_hit(handle, o, d)))

# Materials and statistics
glass: dict[str, Any] = {"type": "dielectric", "ior": 1.5, "alpha": 0.1}
assert_type(rt.bsdf.eval(glass, [0, 0, 1], [0, 0, 1]), F8)
assert_type(rt.bsdf.pdf(glass, [0, 0, 1], [0, 0, 1]), F8)
wi, weight, pdf = rt.bsdf.sample(glass, [0, 0, 1], np.zeros((9, 3)))
assert_type(weight, F8)
result = rt.testing.chi_square(wi, lambda w: rt.bsdf.pdf(glass, [0, 0, 1], w), charts=[rt.testing.Chart()])
assert_type(result, rt.testing.ChiSquare)
assert_type(rt.testing.t_test(light, 1.0, variance=stderr**2), rt.testing.TTest)
assert_type(rt.testing.furnace(glass, most=1.0), rt.testing.Furnace)
assert_type(rt.testing.sidak(0.05, 10), float)
error: type[AssertionError] = rt.testing.StatisticalError

# Figures
drawing: rt.show.Drawing = rt.show.bvh(scene)
assert_type(rt.show.path(scene, (1, 1)), PathDrawing)
drawings = [rt.show.heatmap(scene), rt.show.samples("sobol", 16), rt.show.error(image, "b.exr")]
drawings.append(rt.show.convergence(report))
assert_type(drawings[0].save("a.svg"), Path)
viewer = rt.show.live(scene, size=(64, 64), spp=4)
assert_type(viewer, Viewer)
assert_type(viewer.scene, rt.Scene)
viewer.power = 2.0

# The textbook
book = rt.textbook
assert_type(book.render(scene, spp=4), Floats)
x, y = book.pinhole_rays(scene.camera, (4, 4), book.pixel_centres((4, 4)))
tree = book.median_split(scene.mesh.vertices, scene.mesh.faces)
assert_type(tree, book.Tree)
assert_type(book.traverse(tree, x, y), rt.Hits)
assert_type(book.reflect(x, y), Floats)

# What others bring
def test_image(golden: Golden) -> None:
    assert_type(golden.check(image, "image", max_bias=None), Verdict)
    golden.check(lambda seed: rt.render(scene, seed=seed), "noisy", pictures=16)

def queries(mesh: Any) -> None:
    rt.BVH(mesh).closest_hit(o, d)
    assert_type(RayMeshIntersector(mesh).intersects_any(o, d), NDArray[np.bool_])
    rt.render(mesh)
    assert_type(rt.save(scene, "copy.json"), Path)

try:
    rt.load(Path("scene.json"))
except rt.SceneError as problem:
    assert_type(problem.problems, Sequence[str])
except (rt.FileError, rt.OptionError) as fault:
    root: rt.RaytraceError = fault

# Mistakes
rt.render(scene, spp="4")  # wrong
rt.render(scene, size=64)  # wrong
rt.load(3)  # wrong
rt.rendr(scene)  # wrong
rt.show.tree(scene)  # wrong
rt.testing.chisquare(wi)  # wrong
bvh.closest_hit(o)  # wrong
hits.distance  # wrong
scene.camera = 3  # wrong
"""


def test_the_program_uses_every_public_name():
    names = {f"rt.{name}" for name in rt.__all__ if name not in ("bsdf", "show", "testing", "textbook")}
    names |= {f"rt.show.{name}" for name in rt.show.__all__} | {f"rt.testing.{name}" for name in rt.testing.__all__}
    names |= {f"rt.bsdf.{name}" for name in ("eval", "pdf", "sample")}
    assert {name for name in names if not re.search(rf"\b{re.escape(name)}\b", PROGRAM)} == set()


def test_a_strict_type_checker_knows_all_results_and_finds_mistakes(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--no-error-summary", "program.py"],
        capture_output=True,
        text=True,
        timeout=1200,
        cwd=tmp_path,
        env={**os.environ, "MYPYPATH": str(ROOT)},
    )
    assert done.returncode == 1, done.stdout + done.stderr
    found = {
        int(re.match(r"program\.py:(\d+): error", line)[1]) for line in done.stdout.splitlines() if "error:" in line
    }
    assert found == {n for n, line in enumerate(PROGRAM.splitlines(), 1) if line.endswith("# wrong")}, done.stdout
