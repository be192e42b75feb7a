"""One sample of a path-traced image, step by step: the bits of ``render``, and the formulas behind the numbers."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.show.path_steps import follow
from raytrace.show.prepared_scene import prepare_scene
from shipped_scenes import load

ROOT = Path(__file__).parents[1] / "scenes"
SIZE = (24, 18)
ALL = {
    "camera": {"position": [0, 1, 4], "look_at": [0, 0.6, 0], "fov": 45},
    "film": {"size": SIZE},
    "render": {"integrator": "path", "max_depth": 8, "spp": 4},
    "lights": [
        {"type": "environment", "radiance": [0.2, 0.3, 0.4]},
        {"type": "spot", "position": [1, 3, 1], "look_at": [0, 0, 0], "intensity": [20, 20, 20], "cutoff": 60},
        {"type": "point", "position": [-1, 2, 1], "flux": [0, 0, 0]},
        {"type": "directional", "direction": [0.2, -1, -0.1], "irradiance": [1, 0.8, 0.6]},
        {"type": "point", "position": [-1, 2, 1], "flux": [99, 99, 99]},
    ],
    "materials": {
        "grey": {"type": "diffuse", "albedo": [0.7, 0.6, 0.5]},
        "lamp": {"type": "diffuse", "albedo": [0.1, 0.1, 0.1], "emission": [4, 3, 2]},
        "mirror": {"type": "mirror", "reflectance": [0.9, 0.8, 0.7]},
        "gold": {"type": "conductor", "metal": "gold"},
        "glass": {"type": "dielectric", "ior": 1.5},
        "course": {"type": "refractive", "ior": 1.3, "shadows": "transparent"},
    },
    "objects": [
        {"box": {}, "material": "grey", "scale": [3, 0.1, 3], "translate": [0, -0.1, 0]},
        {"box": {}, "material": "mirror", "scale": [2, 2, 0.1], "translate": [0, 0, -1.5]},
        {"rectangle": {}, "material": "lamp", "rotate": {"axis": [1, 0, 0], "angle": 90}, "translate": [0, 1.8, 0]},
        *(
            {"sphere": {"center": [x, 0.4, 0.6], "radius": 0.35, "tolerance": 0.01}, "material": name}
            for x, name in ((-0.8, "gold"), (0, "glass"), (0.8, "course"))
        ),
    ],
}  # fmt: skip
PIXELS = [(x, y) for x in range(1, 24, 3) for y in range(2, 18, 3)]


def scene(name):
    return load(ROOT / f"{name}.json")


@pytest.fixture(scope="module")
def all_kinds():
    return rt.load(ALL)


@pytest.fixture(scope="module")
def walks(all_kinds):
    """Steps of sample 0 of many pixels."""
    return [follow(prepare_scene(all_kinds), pixel, 0) for pixel in PIXELS]


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize("name", ["cornell-box-area", "mirrors", "glass-sphere-transparent-shadow", None])
def test_the_radiance_is_that_of_render_to_the_bit(name, integrator, all_kinds):
    given = scene(name) if name else all_kinds
    rgb = rt.render(given, spp=1, size=SIZE, integrator=integrator).rgb
    prepared = prepare_scene(given, SIZE, integrator)
    for x, y in PIXELS[::3]:
        np.testing.assert_array_equal(np.float32(follow(prepared, (x, y), 0).radiance), rgb[y, x])


def test_samples_sum_to_their_pixel(all_kinds):
    rgb = rt.render(all_kinds).rgb
    for x, y in PIXELS[::6]:
        total = sum(follow(prepare_scene(all_kinds), (x, y), sample).radiance.astype(float) for sample in range(4))
        np.testing.assert_allclose(total / 4, rgb[y, x], rtol=1e-6)


def test_what_is_met_and_what_shadow_rays_bring_is_the_radiance(walks):
    for steps in walks:
        total = sum(step.added.astype(float) for step in steps.path) + sum(ray.radiance for ray in steps.shadows)
        np.testing.assert_allclose(steps.radiance, total, rtol=1e-5)


def test_all_that_can_happen_happens(walks):
    events = Counter(step.event for steps in walks for step in steps.path)
    assert {"scatters", "is reflected", "enters", "leaves", "leaves the scene", "stops: roulette"} <= events.keys()
    assert any(step.event == "is reflected" and step.material == "glass" for steps in walks for step in steps.path)
    names = {ray.name.split(":")[0] for steps in walks for ray in steps.shadows}
    assert names == {"lights[0]", "lights[1]", "lights[3]", "lights[4]", "lamp"}  # lights[2] is dark
    assert {ray.event for steps in walks for ray in steps.shadows} >= {"reaches", "blocked", "faces away"}


def test_the_throughput_is_the_product_of_what_surfaces_do(walks, all_kinds):
    albedo = dict(zip(all_kinds.materials.name, all_kinds.materials.albedo, strict=True))
    for steps in walks:
        for step, following in zip(steps.path, steps.path[1:], strict=False):
            ratio = following.throughput.astype(float) * step.survival / step.throughput
            if step.event == "scatters" or step.material == "mirror":
                np.testing.assert_allclose(ratio, albedo[step.material], rtol=1e-5)
            elif step.material == "glass" and step.event in ("enters", "leaves"):
                np.testing.assert_allclose(ratio, 1 / step.eta**2, rtol=1e-5)
            elif step.material in ("glass", "course"):
                np.testing.assert_allclose(ratio, 1, rtol=1e-5)
            np.testing.assert_array_equal(step.onward, following.d)
            assert np.isinf(following.pdf) == (step.event != "scatters")


def test_what_a_shadow_ray_brings_is_weight_throughput_and_irradiance(walks, all_kinds):
    albedo = dict(zip(all_kinds.materials.name, all_kinds.materials.albedo, strict=True))
    point = 0
    for steps in walks:
        for ray in steps.shadows:
            step = steps.path[ray.step]
            assert step.event.split(":")[0] in ("scatters", "stops")
            factor = step.throughput * albedo[step.material] / np.pi
            weight = 0 if ray.event == "sends nothing here" else ray.weight
            np.testing.assert_allclose(ray.radiance, weight * factor * ray.irradiance, rtol=1e-5)
            if ray.event == "blocked":
                assert 0 < ray.t < 1 or ray.far
            elif ray.name == "lights[4]: point" and ray.event == "reaches":
                point += 1
                to_light = np.array([-1, 2, 1]) - step.p
                r2 = to_light @ to_light
                share = 99 / (4 * np.pi) * (to_light @ step.ns) / r2**1.5 / ray.irradiance  # of the power of all lights
                np.testing.assert_allclose(share, share[0], rtol=1e-4)
                assert 0.01 < share[0] < 1
    assert point > 3


def test_lamps_are_weighted_by_the_power_heuristic():
    """One lamp: the density of a point on it is 1 / its area, that of a direction that times t^2 / cos."""
    box = scene("cornell-box-area")
    lit = box.materials.emission[box.mesh.material_id].any(axis=1)
    corners = box.mesh.vertices[box.mesh.faces[lit]]
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
    prepared, met, sampled = prepare_scene(box, (16, 16)), 0, 0
    for x, y in ((x, y) for x in range(2, 14) for y in range(2, 14)):
        steps = follow(prepared, (x, y), 0)
        for step in steps.path:
            if step.added.any() and np.isfinite(step.pdf):
                density = step.t**2 / -(step.d @ step.ng) / area
                assert step.weight == pytest.approx(step.pdf**2 / (step.pdf**2 + density**2), rel=1e-4)
                met += 1
        for ray in steps.shadows:
            if ray.event == "reaches":
                far, normal = np.linalg.norm(ray.d), steps.path[ray.step].ns
                cosine, other = ray.d @ normal / far, -ray.d[1] / far * -1  # the lamp faces down
                assert ray.pdf == pytest.approx(far**2 / other / area, rel=1e-3)
                assert ray.weight == pytest.approx(1 / (1 + (cosine / np.pi / ray.pdf) ** 2), rel=1e-4)
                sampled += 1
    assert met > 1
    assert sampled > 50


def test_direct_light_ends_after_the_ray_that_looks_for_lamps(all_kinds):
    prepared = prepare_scene(all_kinds, integrator="direct")
    walks = [follow(prepared, pixel, 0) for pixel in PIXELS]
    assert all(
        step.event in ("lands", "is reflected", "enters", "leaves") for steps in walks for step in steps.path[:-1]
    )
    assert {"stops: direct light only", "leaves the scene"} <= {steps.path[-1].event for steps in walks}
    for steps in walks:
        assert sum(step.event == "lands" for step in steps.path) <= 1
        assert len(steps.shadows) <= 1


def test_depth_that_is_spent_is_told(all_kinds):
    short = {**ALL, "render": {"integrator": "path", "max_depth": 1}}
    steps = [follow(prepare_scene(short), pixel, 0) for pixel in PIXELS]
    assert max(len(each.path) for each in steps) == 2
    assert {each.path[-1].event for each in steps} == {"stops: max_depth", "leaves the scene"}


def test_it_can_be_drawn_and_printed(all_kinds):
    for pixel in PIXELS[::24]:
        drawing = rt.show.path(all_kinds, pixel)
        assert drawing.encode("svg")
        assert "nan" not in str(drawing)
        assert "throughput" in str(drawing)
        assert drawing.data["throughput"].shape == drawing.data["o"].shape
