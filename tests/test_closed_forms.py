"""Physics whose answer is a formula, or was printed before this project began, asked of the public face."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from small_scenes import Part, ball, box, glass, look, make_scene, quad

pytestmark = pytest.mark.engine

SCENES = Path(__file__).parents[1] / "scenes"
FLOOR = quad((-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9))  # faces +y
PINHOLE_FOV = 1e-7  # degrees; the whole film spans 2e-9 of the distance: one ray, to the digits of float32


def unit(a):
    a = np.asarray(a, np.float64)
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def soup(triangles):
    corners = np.asarray(triangles, np.float64).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def see(scene, eye, at, up=(0.0, 1.0, 0.0)):
    """Linear RGB of one ray."""
    scene = dataclasses.replace(scene, camera=look(eye, at, PINHOLE_FOV, up))
    return rt.render(scene, size=(1, 1), spp=1, precision="float64").rgb[0, 0].astype(np.float64)


def pass_surfaces(triangles, ior, o, d, count, normals=None):
    """Follow rays through `count` refractive surfaces by the calls of the library; origins and directions after."""
    bvh = rt.BVH(*soup(triangles), precision="float64")
    for _ in range(count):
        hits = bvh.closest_hit(o, d)
        assert (hits.prim_id >= 0).all()
        point = bvh.surface(hits)
        n = point.ng
        if normals is not None:
            weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
            n = unit(np.einsum("nk,nkc->nc", weights, normals[hits.prim_id]))
        entering = np.sum(d * point.ng, axis=1) < 0
        n = np.where(entering[:, None], n, -n)
        d, _ = rt.refract(d, n, np.where(entering, ior, 1 / ior))
        o = rt.spawn_ray(point.p, point.p_error, point.ng, d)
    return o, d


# --- light -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("x", [0.0, 0.3, 1.0, 2.5, 7.0])
def test_point_light_on_a_plane(x):
    flux, albedo, height = np.array([17.0, 12.0, 5.0]), np.array([0.2, 0.5, 0.8]), 1.5
    scene = make_scene([Part(FLOOR, albedo=albedo)], [((0, height, 0), flux)])
    r2 = x * x + height * height
    irradiance = flux * (height / math.sqrt(r2)) / (4 * math.pi * r2)
    # the picture is float32: half a unit in the last place is 6e-8
    np.testing.assert_allclose(see(scene, (x, 2, 3), (x, 0, 0)), albedo / math.pi * irradiance, rtol=1.2e-7)


def test_lights_add_up():
    lights = [((0, 1, 0), (1, 2, 3)), ((2, 3, 1), (9, 5, 1)), ((-3, 0.5, 2), (4, 4, 4))]
    together = see(make_scene([Part(FLOOR)], lights), (1, 2, 3), (1, 0, 0))
    alone = [see(make_scene([Part(FLOOR)], [light]), (1, 2, 3), (1, 0, 0)) for light in lights]
    np.testing.assert_allclose(together, np.sum(alone, axis=0), rtol=2e-7)


def test_block_of_glass_under_a_uniform_sky_can_not_be_seen():
    """The furnace: all light is transmitted, and every ray that enters a box gets out on the other side."""
    sky = (1.0, 0.5, 0.25)
    block = glass(box((-1, -1, -1), (1, 1, 1)), 1.5)
    scene = make_scene([block], background=sky, camera=look((2, 1.7, 3), (0, 0, 0)))
    assert (rt.render(scene, size=(32, 32), spp=4).rgb == np.array(sky, np.float32)).all()


def test_ball_of_glass_adds_no_light():
    triangles, normals = ball(12)
    scene = make_scene(
        [glass(triangles, 1.5, normals=normals)], background=(1, 1, 1), camera=look((0, 0.3, 4), (0, 0, 0))
    )
    picture = rt.render(scene, size=(32, 32), spp=4).rgb
    assert picture.max() == 1
    assert (picture == 1).mean() > 0.98  # at the rim, normals of the chords trap a few paths for ever


# --- Snell -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ior", [1.31, 1.5, 2.42])
@pytest.mark.parametrize("leaving", [False, True])
def test_snell_at_ten_angles_and_from_both_sides(ior, leaving):
    eta = 1 / ior if leaving else ior
    angle = np.linspace(0, 0.999 * math.asin(min(eta, 1.0)), 10)
    d = np.stack([np.sin(angle), -np.cos(angle), np.zeros(10)], axis=1)
    w, total = rt.refract(d, np.broadcast_to([0.0, 1.0, 0.0], d.shape), eta)
    assert not np.any(total)
    np.testing.assert_allclose(np.arctan2(w[:, 0], -w[:, 1]), np.arcsin(np.sin(angle) / eta), atol=2e-14)
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), 1, rtol=4e-16)


@pytest.mark.parametrize("ior", [1.31, 1.5, 2.42])
def test_past_the_critical_angle_everything_is_reflected(ior):
    critical = math.asin(1 / ior)
    angle = critical + np.array([-1e-3, -1e-9, 1e-9, 1e-3, 0.2])
    d = np.stack([np.sin(angle), -np.cos(angle), np.zeros(5)], axis=1)
    n = np.broadcast_to([0.0, 1.0, 0.0], d.shape)
    w, total = rt.refract(d, n, 1 / ior)
    assert np.asarray(total).tolist() == [False, False, True, True, True]
    np.testing.assert_allclose(w[2:], rt.reflect(d, n)[2:], atol=1e-15)
    np.testing.assert_allclose(rt.reflect(d, n), d * [1, -1, 1], atol=1e-15)


def test_refraction_can_be_walked_backwards():
    rng = np.random.default_rng(0)
    n, d = unit(rng.normal(size=(1000, 3))), unit(rng.normal(size=(1000, 3)))
    n = np.where(np.sum(n * d, axis=1, keepdims=True) < 0, n, -n)
    w, _ = rt.refract(d, n, 1.5)
    back, total = rt.refract(-w, -n, 1 / 1.5)
    assert not np.any(total)
    np.testing.assert_allclose(back, -d, atol=1e-13)  # condition at grazing: 1 / cos, below 1e3 here


# --- paths through bodies --------------------------------------------------------------------------------------------


def test_slab_displaces_a_ray_and_keeps_its_direction():
    thickness, n = 0.37, 1.5
    slab = box((-50, -thickness, -50), (50, 0, 50))
    a = np.linspace(0.01, 1.4, 10)
    d = np.stack([np.sin(a), -np.cos(a), np.zeros(10)], axis=1)
    start = np.broadcast_to([0.1, 1.0, 0.2], d.shape)
    o, w = pass_surfaces(slab, n, start, d, 2)
    np.testing.assert_allclose(w, d, atol=1e-14)
    across = np.linalg.norm(np.cross(o - start, d), axis=1)
    expected = thickness * np.sin(a) * (1 - np.cos(a) / np.sqrt(n**2 - np.sin(a) ** 2))
    np.testing.assert_allclose(across, expected, atol=1e-12)  # the offsets along the normal: gamma(27) x 50


def extrude(*polygon):
    """A long body along z over a triangle whose corners run counter-clockwise seen from +z."""
    near, far = ([(x, y, z) for x, y in polygon] for z in (9.0, -9.0))
    sides = [quad(far[i], far[j], near[j], near[i]) for i, j in ((0, 1), (1, 2), (2, 0))]
    return np.concatenate([*sides, [near], [far[::-1]]])


@pytest.mark.parametrize("apex_degrees", [30, 60])
def test_prism_deviates_by_the_textbook_angle(apex_degrees):
    apex, n = math.radians(apex_degrees), 1.5
    i = np.radians([40.0, 45.0, 50.0, 60.0, 70.0])
    face = np.array([-math.cos(apex / 2), math.sin(apex / 2)])  # outward normal of the left face
    along = np.array([face[1], -face[0]])  # up the left face
    d2 = -np.cos(i)[:, None] * face + np.sin(i)[:, None] * along
    target = np.array([-math.sin(apex / 2), -math.cos(apex / 2)])  # halfway up the left face
    d, start = (np.pad(a, ((0, 0), (0, 1))) for a in (d2, target - 3 * d2))
    foot = 2 * target
    _, w = pass_surfaces(extrude((0, 0), foot, foot * [-1, 1]), n, start, d, 2)
    inside = np.arcsin(np.sin(i) / n)
    expected = i + np.arcsin(n * np.sin(apex - inside)) - apex
    np.testing.assert_allclose(np.arccos(np.sum(d * w, axis=1)), expected, atol=1e-13)


def test_right_angled_prism_turns_the_view_by_total_reflection():
    a = np.radians([-5.0, 0.0, 3.0])  # total below -5.6 degrees no more
    d = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    start = np.broadcast_to([-1.0, 1.2, 0.3], d.shape)
    _, w = pass_surfaces(extrude((0, 0), (2, 0), (0, 2)), 1.5, start, d, 3)
    np.testing.assert_allclose(w, -d[:, [1, 0, 2]], atol=1e-14)


def test_ball_lens_focuses_at_its_paraxial_length():
    n, h = 1.5, np.array([0.005, 0.01, 0.02])
    triangles, normals = ball(100)
    start = np.stack([np.full(3, -3.0), 0.6 * h, 0.8 * h], axis=1)
    o, w = pass_surfaces(triangles, n, start, np.broadcast_to([1.0, 0.0, 0.0], (3, 3)), 2, normals)
    focus = o[:, 0] - o[:, 1] / w[:, 1] * w[:, 0]
    # the chords of 100 rings lie up to 2.5e-4 below the sphere; spherical aberration is of the order of h^2
    np.testing.assert_allclose(focus, n / (2 * (n - 1)), atol=1.5e-3)
    np.testing.assert_allclose(o[:, 2] / w[:, 2], o[:, 1] / w[:, 1], rtol=1e-9)


# --- the Cornell box -------------------------------------------------------------------------------------------------

BOX_PIXELS = [
    ((256, 40), (0.314987, 0.217743, 0.086893)),
    ((256, 140), (0.137745, 0.095220, 0.037999)),
    ((20, 300), (0.151386, 0.011025, 0.003534)),
    ((490, 300), (0.033530, 0.076077, 0.006410)),
    ((310, 300), (0.240409, 0.166189, 0.066320)),
    ((420, 400), (0.0, 0.0, 0.0)),
]


@pytest.mark.parametrize(("pixel", "rgb"), BOX_PIXELS)
def test_cornell_box_at_a_pixel_centre(pixel, rgb):
    scene = rt.load(SCENES / "cornell-box.json")
    half = math.tan(math.radians(scene.camera.fov / 2))
    x, y = ((2 * (c + 0.5) / 512 - 1) * half for c in pixel)
    eye = scene.camera.position
    np.testing.assert_allclose(see(scene, eye, eye + [x, -y, -1]), rgb, rtol=1e-4, atol=5e-7)


# with the pane: the brute-force twin at 512 x 512 and 16 spp
BOX_MEANS = {"cornell-box": (0.11798, 0.07750, 0.02878), "cornell-box-glass": (0.113918, 0.074688, 0.027661)}


@pytest.mark.parametrize("name", BOX_MEANS)
def test_mean_of_the_cornell_box(name):
    mean = rt.render(SCENES / f"{name}.json", spp=16, precision="float64").rgb.mean(axis=(0, 1), dtype=np.float64)
    np.testing.assert_allclose(mean, BOX_MEANS[name], rtol=1e-4, atol=5e-6)  # given to five digits
