"""Thin lenses, orthographic cameras and filters of the film, against formulas."""

import math

import numpy as np
import pytest

import raytrace as rt
from raytrace.passes import lens
from raytrace.passes.camera import make_view
from raytrace.records import Camera
from raytrace.scene.path_plan import needs_lens

FORMAT = {
    "materials": {
        "lamp": {"type": "diffuse", "albedo": [0, 0, 0], "emission": [1, 1, 1]},
        "black": {"type": "diffuse", "albedo": [0, 0, 0]},
    },
}


def scene_of(camera, objects, **film):
    return rt.load({"camera": camera, "film": {"size": [64, 64], **film}, **FORMAT, "objects": objects})


def spot(distance, radius):
    """A small emitting square on the axis of a camera at the origin that looks along -z."""
    return {"rectangle": {}, "scale": radius, "translate": [0, 0, -distance], "material": "lamp"}


@pytest.mark.parametrize("distance", [1.5, 2.0, 3.0, 4.0, 8.0])
def test_a_point_out_of_focus_becomes_the_circle_of_confusion(distance):
    """Its radius on the plane in focus is aperture |distance - focus| / distance, for a pinhole's size of the point."""
    aperture, focus, fov, size = 0.1, 3.0, 20.0, 64
    camera = {"position": [0, 0, 0], "look_at": [0, 0, -focus], "fov": fov, "aperture": aperture}
    pixel = 2 * math.tan(math.radians(fov / 2)) / size  # at distance 1
    radius = pixel * distance
    image = rt.render(scene_of(camera, [spot(distance, radius)]), spp=256, size=(size, size)).rgb[..., 0]
    blur = aperture * abs(distance - focus) / distance / focus / pixel  # pixels
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    total = image.sum()
    assert total == pytest.approx((2 * radius / (distance * pixel)) ** 2, rel=0.05)  # the light is spread, not lost
    mean_square = (image * (x * x + y * y)).sum() / total
    point = 2 * (2 * radius / (distance * pixel)) ** 2 / 12 + 2 / 12  # of the square, and of the pixels
    assert mean_square == pytest.approx(blur * blur / 2 + point, rel=0.1, abs=0.4)  # r^2 / 2: an even disc


def test_focus_is_the_distance_to_look_at_by_default():
    camera = {"position": [0, 0, 0], "look_at": [1, 2, -2], "fov": 20, "aperture": 0.1}
    assert scene_of(camera, [spot(1, 1)]).camera.focus == 3.0
    assert scene_of(camera | {"focus": 7}, [spot(1, 1)]).camera.focus == 7.0


def test_an_orthographic_camera_sees_sizes_that_do_not_depend_on_the_distance():
    camera = {"type": "orthographic", "position": [0, 0, 0], "look_at": [0, 0, -1], "height": 4}
    areas = []
    for distance in (1, 50):
        scene = scene_of(camera, [spot(distance, 0.5)])
        image = rt.render(scene, spp=16, size=(64, 64))
        areas.append(image.rgb[..., 0].sum() / 16**2)  # 16 pixels per unit
        depth = image.aov["depth"]
        assert np.isfinite(depth).sum() == 16 * 16
        np.testing.assert_allclose(depth[32, 32], distance, rtol=1e-6)
    np.testing.assert_allclose(areas, 1.0, rtol=1e-6)


def rays_of(camera, name, n=4096, dtype="float32"):
    """Origins and directions (3, n) through one pixel of a film of 16 x 16."""
    view = make_view(camera, (16, 16), np.dtype(dtype))
    made, like = lens.make_lens(camera, name, dtype), np.zeros(n, dtype)
    rng = np.random.default_rng(1)
    u, v, a, b = rng.random((4, n)).astype(dtype)
    x, y = lens.filtered(made, u) - 0.5, lens.filtered(made, v) - 0.5
    o, d = lens.lens_ray(view, made, like + x, like + y, a, b)
    return np.array(o), np.array(d), x, y


def test_rays_of_a_lens_meet_in_the_plane_in_focus():
    camera = Camera(np.zeros(3), np.array([0, 0, -3.0]), np.array([0, 1.0, 0]), 20.0, 0.2, 3.0)
    o, d, x, y = rays_of(camera, "box", dtype="float64")
    assert np.linalg.norm(o, axis=0).max() <= 0.2 * (1 + 1e-12)
    assert np.mean(o[0] ** 2 + o[1] ** 2) == pytest.approx(0.2**2 / 2, rel=0.05)  # even over the disc
    at = o + d * (-3 - o[2]) / d[2]
    pixel = 2 * math.tan(math.radians(10)) / 16
    np.testing.assert_allclose(at[0], 3 * pixel * x, atol=1e-12)
    np.testing.assert_allclose(at[1], -3 * pixel * y, atol=1e-12)


@pytest.mark.parametrize("focus", [1e18, 1e20, 1e38, 1e39, 1e300])
def test_a_lens_in_focus_far_away_has_the_directions_of_the_pinhole(focus):
    camera = Camera(np.zeros(3), np.array([0, 0, -3.0]), np.array([0, 1.0, 0]), 20.0, 0.2, focus)
    o, d, x, y = rays_of(camera, "box")
    pixel = 2 * math.tan(math.radians(10)) / 16
    wanted = np.array([pixel * x, -pixel * y, -np.ones_like(x)], np.float64)
    np.testing.assert_allclose(d, wanted / np.linalg.norm(wanted, axis=0), atol=1e-6)
    assert 0.19 < np.linalg.norm(o, axis=0).max() < 0.201


@pytest.mark.parametrize(
    ("name", "radius", "variance"), [("box", 0.5, 1 / 12), ("tent", 1.0, 1 / 6), ("gaussian", 2.0, 0.2497)]
)
def test_positions_follow_the_filter(name, radius, variance):
    """Extent and variance; a Gaussian of deviation 1/2 that is cut off at 4 deviations has 0.9989 of 1/4."""
    camera = Camera(np.zeros(3), np.array([0, 0, -1.0]), np.array([0, 1.0, 0]), 20.0)
    made = lens.make_lens(camera, name, np.float64)
    u = (np.arange(200_000) + 0.5) / 200_000
    x = lens.filtered(made, u) - 0.5
    assert abs(x).max() <= radius
    assert abs(x.mean()) < 1e-6
    assert np.mean(x * x) == pytest.approx(variance, rel=2e-3)
    assert (np.diff(x) >= 0).all()


def test_quantiles_are_those_of_the_gaussian():
    quantiles = lens.gaussian_quantiles()
    share = math.erf(4 / math.sqrt(2))
    for k in (0, 1, 400, 2048, 2800, 4095, 4096):
        wanted = (2 * k / lens.STEPS - 1) * share
        assert math.erf(2 * quantiles[k] / math.sqrt(2)) == pytest.approx(wanted, abs=1e-5)


def test_a_filter_blurs_an_edge_as_its_distribution():
    """An emitting half plane whose edge lies between two pixels: each column shows the filter's share beyond it."""
    camera = {"type": "orthographic", "position": [0, 0, 0], "look_at": [0, 0, -1], "height": 8}
    half = {"rectangle": {}, "scale": 20, "translate": [20, 0, -1], "material": "lamp"}
    shares = {"box": [0, 0, 1, 1], "tent": [0, 1 / 8, 7 / 8, 1], "gaussian": [0.00135, 0.1587, 0.8413, 0.99865]}
    for name, wanted in shares.items():
        image = rt.render(scene_of(camera, [half], filter=name), spp=256, size=(8, 8)).rgb[..., 0]
        np.testing.assert_allclose(image.mean(axis=0)[2:6], wanted, atol=0.01)


def test_a_pinhole_with_a_box_filter_needs_none_of_it():
    camera = {"position": [0, 0, 0], "look_at": [0, 0, -1], "fov": 20}
    plain = scene_of(camera, [{"rectangle": {}, "translate": [0, 0, -1], "material": "black"}])
    assert not needs_lens(plain)


@pytest.mark.parametrize(
    ("camera", "text"),
    [
        ({"fov": 20, "height": 4}, "exclude each other"),
        ({"height": 4}, "a perspective camera has .fov."),
        ({"type": "orthographic", "fov": 20, "height": 4}, "exclude each other"),
        ({"type": "orthographic", "fov": 20}, "an orthographic camera has .height."),
        ({"type": "orthographic", "height": 2, "aperture": 0.1}, "an orthographic camera has no lens"),
        ({"fov": 20, "aperture": -1}, "aperture: expected a number >= 0"),
        ({"fov": 20, "aperture": 1, "focus": 0}, "focus: expected a number > 0"),
        ({"type": "fisheye", "fov": 20}, "unknown type .fisheye."),
    ],
)
def test_wrong_cameras_are_named(camera, text):
    with pytest.raises(rt.SceneError, match=text) as caught:
        scene_of({"position": [0, 0, 0], "look_at": [0, 0, -1], **camera}, [spot(1, 1)])
    assert len(str(caught.value).splitlines()) == 1
