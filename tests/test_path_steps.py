"""One sample, step by step: the bits of ``render``, and closed forms."""

import dataclasses

import numpy as np
import pytest

import raytrace as rt
from naive_sampling import film_points
from raytrace.show.path_steps import follow
from raytrace.show.prepared_scene import prepare_scene
from shipped_scenes import SCENES, load
from small_scenes import Part, ball, glass, look, make_scene, quad, studio

FLOOR = quad((-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4))


def scene(name):
    return load(next(path for path in SCENES if path.stem == name))


def steps_of(prepared, pixel=(4, 4), sample=0, size=None):
    return follow(prepare_scene(prepared, size), pixel, sample)


@pytest.mark.parametrize("name", ["cornell-box-glass", "glass-sphere", "prism", "room"])
def test_the_radiance_is_that_of_render_to_the_bit(name):
    rgb = rt.render(scene(name), spp=1, size=(24, 18)).rgb
    for x, y in ((1, 2), (12, 9), (9, 12), (16, 7), (23, 17)):
        np.testing.assert_array_equal(np.float32(steps_of(scene(name), (x, y), 0, (24, 18)).radiance), rgb[y, x])


def test_samples_of_the_studio_sum_to_its_pixels():
    picture = rt.render(studio())
    for x, y in ((10, 30), (24, 24), (30, 33), (40, 12)):
        total = np.zeros(3)
        for sample in range(picture.provenance["spp"]):
            total += steps_of(studio(), (x, y), sample).radiance
        np.testing.assert_allclose(total / picture.provenance["spp"], picture.rgb[y, x], rtol=1e-6)


def test_the_pane_bends_by_snells_law_in_closed_form():
    box = dataclasses.replace(scene("cornell-box-glass"))
    box = dataclasses.replace(box, settings=box.settings._replace(precision="float64", size=(64, 64)))
    x, y = film_points("sobol", 0, 1, (24, 24, 1, 1))[0, 0, 0]
    size = 2 * np.tan(np.radians(19.5 / 2)) / 64
    d = np.array([(x - 32) * size, (32 - y) * size, -1.0])
    d /= np.linalg.norm(d)
    camera = np.array([0, 1, 6.8])
    entry = camera + d * 5.8 / -d[2]  # the pane stands at z = 1
    across = d[:2] / 0.5  # the part along the pane grows by 1 / eta
    onward = np.array([*across, -np.sqrt(1 - across @ across)])
    wall = entry + onward * 2.0 / -onward[2]  # the back wall, at z = -1
    steps = steps_of(box, (24, 24))
    first, second = steps.path
    assert (first.event, first.material, first.eta) == ("enters", "pane", 0.5)
    assert (second.event, second.material) == ("lands", "grey")
    np.testing.assert_allclose(first.o, camera, rtol=1e-15)
    np.testing.assert_allclose(first.d, d, atol=1e-15)
    np.testing.assert_allclose(first.p, entry, atol=1e-13)
    np.testing.assert_allclose(first.onward, onward, atol=1e-14)
    np.testing.assert_array_equal(second.d, first.onward)
    np.testing.assert_allclose(second.p, wall, atol=1e-13)
    np.testing.assert_allclose([first.angle_in, first.angle_out], np.degrees(np.arccos([-d[2], -onward[2]])), atol=1e-5)
    np.testing.assert_allclose(first.t, np.linalg.norm(entry - camera), rtol=1e-14)
    (ray,) = steps.shadows
    to_light = np.array([0, 1.5, 0.5]) - wall
    r2 = to_light @ to_light
    irradiance = np.array([17, 12, 5]) * to_light[2] / np.sqrt(r2) / (4 * np.pi * r2)
    assert (ray.event, ray.t) == ("reaches", 1.0)
    np.testing.assert_allclose(ray.irradiance, irradiance, rtol=1e-12)
    np.testing.assert_allclose(ray.radiance, np.array([0.725, 0.71, 0.68]) / np.pi * irradiance, rtol=1e-12)
    np.testing.assert_allclose(steps.radiance, ray.radiance)


def test_total_reflection_keeps_the_angle_and_snell_holds_elsewhere():
    events = set()
    for pixel in ((160, 360), (200, 330), (140, 400)):
        for step in steps_of(scene("glass-sphere"), pixel).path:
            events.add(step.event)
            if "totally" in step.event:
                assert step.angle_out == pytest.approx(step.angle_in, abs=0.05)  # degrees, by a cosine in float32
                assert np.sin(np.radians(step.angle_in)) > step.eta
            elif not np.isnan(step.eta):
                assert np.sin(np.radians(step.angle_out)) * step.eta == pytest.approx(
                    np.sin(np.radians(step.angle_in)), abs=1e-3
                )
    assert events == {"enters", "leaves", "is reflected totally", "lands"}


def test_a_ray_that_leaves_sees_the_background():
    steps = steps_of(make_scene([Part(FLOOR)], camera=look((0, 1, 5), (0, 9, 0)), background=(0.1, 0.2, 0.3)))
    (step,) = steps.path
    assert (step.event, step.prim_id, step.t) == ("leaves the scene", -1, np.inf)
    assert steps.shadows == ()
    np.testing.assert_allclose(steps.radiance, [0.1, 0.2, 0.3])


def test_depth_that_is_spent_is_told():
    triangles, normals = ball(12)
    parts = [glass(triangles, 1.5, normals=normals), Part(FLOOR - [0, 2, 0])]
    spent = make_scene(parts, lights=[((0, 5, 0), (1, 1, 1))])
    spent = dataclasses.replace(spent, settings=spent.settings._replace(max_depth=1))
    steps = steps_of(spent)
    assert [step.event for step in steps.path] == ["stops: max_depth"]
    assert not steps.radiance.any()


def test_shadow_rays_are_blocked_where_something_stands_in_the_way():
    lid = quad((-2, 1, 2), (2, 1, 2), (2, 1, -2), (-2, 1, -2))
    lights = [((0, 4, 0), (10, 10, 10)), ((9, 4, 9), (10, 10, 10)), ((0, -4, 0), (10, 10, 10))]
    prepared = make_scene([Part(FLOOR), Part(lid)], lights, look((0, 0.5, 4), (0, 0, 0)))
    steps = steps_of(prepared)
    assert [ray.event for ray in steps.shadows] == ["blocked", "reaches", "faces away"]
    blocked = steps.shadows[0]
    assert (blocked.o + blocked.t * blocked.d)[1] == pytest.approx(1.0)
    assert not blocked.irradiance.any()
    np.testing.assert_allclose(steps.radiance, sum(ray.radiance for ray in steps.shadows))


def test_the_back_of_a_surface_is_black():
    steps = steps_of(make_scene([Part(FLOOR)], [((0, 4, 0), (1, 1, 1))], look((0, -3, 1), (0, 0, 0))))
    assert steps.path[-1].event == "meets the back: black"
    assert steps.shadows == ()
    assert not steps.radiance.any()
