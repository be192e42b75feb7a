"""Camera rays against the twin, and where the corners of the film look."""

import numpy as np
import pytest

import naive
import naive_sampling
import rays
from raytrace.accel.lanes import packet_width
from raytrace.passes.camera import camera_rays, make_view
from raytrace.passes.sampling import make_sampler
from raytrace.records import Camera
from small_scenes import look

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
CAMERAS = {
    "straight": (look((0, 0, 0), (0, 0, -1), fov=60), (32, 16)),
    "tilted": (look((1, 2, 3), (-4, 0.5, 1), fov=35, up=(0.2, 3, -0.1)), (16, 48)),
    "wide": (look((100, -50, 7), (101, -52, 7.5), fov=140, up=(0, 0, 1)), (20, 20)),
}
QUIET = pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")  # uint32 arithmetic wraps around


def film(width, height):
    """All pixels, row by row, the last one again until packets are full."""
    numbers = np.minimum(np.arange(-(-width * height // rays.PACKET) * rays.PACKET), width * height - 1)
    return (numbers % width).astype(np.uint32), (numbers // width).astype(np.uint32)


def directions(camera, size, precision, sampler, samples=(0, 1)):
    """(samples, pixels, 3)"""
    x, y = film(*size)
    d = np.empty(3 * len(x) * (samples[1] - samples[0]), precision)
    camera_rays(make_view(camera, size, np.dtype(precision)), sampler, x, y, np.array(samples), d)
    return d.reshape(3, samples[1] - samples[0], -1).transpose(1, 2, 0)


@pytest.mark.nojit
@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", CAMERAS)
def test_rays_are_the_twins(name, precision):
    camera, size = CAMERAS[name]
    for sampler in ("sobol", "stratified", "independent"):
        d = directions(camera, size, precision, make_sampler(sampler, 9, 4), (1, 3))
        points = naive_sampling.film_points(sampler, 9, 4, (0, 0, *size))[:, :, 1:3]
        _, expected = naive.camera_rays(camera, size, points.reshape(-1, 3 - 1))
        expected = expected.reshape(-1, 2, 3).swapaxes(0, 1)
        eps = np.finfo(precision).eps
        # film coordinates up to 48 pixels are rounded, and a pixel spans at most 2 tan(70 deg) / 20 = 0.3 at distance 1
        np.testing.assert_allclose(d[:, : size[0] * size[1]], expected, atol=48 * eps * 0.3)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", CAMERAS)
def test_directions_are_unit(name, precision):
    d = directions(*CAMERAS[name], precision, make_sampler("independent", 1, 4), (0, 4)).astype(np.float64)
    # five roundings of the square, and three of the scaling
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1, atol=4 * np.finfo(precision).eps)


def corner(camera, size, x, y):
    """Mean direction of many samples of a pixel, about its centre."""
    width = packet_width(np.empty(0))
    view, samples = make_view(camera, size, np.dtype("float64")), np.array([0, 4096])
    d = np.empty(3 * 4096 * width)
    camera_rays(
        view, make_sampler("sobol", 0, 4096), np.full(width, x, np.uint32), np.full(width, y, np.uint32), samples, d
    )
    return d.reshape(3, -1).mean(axis=1)


def test_the_film_spans_the_angle_and_its_first_row_is_on_top():
    camera, size = CAMERAS["straight"][0], (2000, 1000)
    half = np.tan(np.radians(30))
    for x, y, right, up in [(0, 0, -2, 1), (1999, 0, 2, 1), (0, 999, -2, -1), (1999, 999, 2, -1), (1000, 500, 0, 0)]:
        expected = np.array([right * half, up * half, -1])
        # the middle of a pixel lies up to 0.75 pixels from that corner
        np.testing.assert_allclose(
            corner(camera, size, x, y), expected / np.linalg.norm(expected), atol=2 * half / 1000
        )


@pytest.mark.nojit
def test_the_view_is_orthogonal_its_pixels_square_and_forward_its_middle():
    for camera, size in CAMERAS.values():
        view = make_view(camera, size, np.dtype("float64"))
        pixel = 2 * np.tan(np.radians(camera.fov / 2)) / size[1]
        np.testing.assert_allclose(np.linalg.norm([view.right, view.down], axis=1), pixel, rtol=1e-14)
        np.testing.assert_allclose(
            [view.right @ view.down, view.right @ view.forward, view.down @ view.forward], 0, atol=1e-15
        )
        to = camera.look_at - camera.position
        np.testing.assert_allclose(view.forward, to / np.linalg.norm(to), rtol=1e-14)
        assert view.down @ camera.up < 0
        assert (np.cross(view.right, view.down) @ view.forward) > 0  # right-handed: x right, y down, z forward
        assert view.centre.tolist() == [size[0] / 2, size[1] / 2]


@QUIET
@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_do_not_depend_on_the_batch(precision):
    camera, size = CAMERAS["tilted"]
    sampler = make_sampler("sobol", 2, 8)
    whole = directions(camera, size, precision, sampler, (0, 8))
    assert rays.same_bits(directions(camera, size, precision, sampler, (3, 5)), whole[3:5])
    x, y = film(*size)
    order = np.random.default_rng(3).permutation(len(x))
    d = np.empty(3 * len(x), precision)
    camera_rays(make_view(camera, size, np.dtype(precision)), sampler, x[order], y[order], np.array([6, 7]), d)
    assert rays.same_bits(d.reshape(3, -1).T, whole[6][order])


def test_up_and_look_at_may_have_any_length():
    camera = Camera(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.5, -1.0]), np.array([0.1, 1.0, 0.2]), 40.0)
    plain = make_view(camera, (4, 3), np.dtype(np.float64))
    for factor in (2.0**-1000, 2.0**-40, 2.0**900, 2.0**1023):
        view = make_view(camera._replace(up=camera.up * factor), (4, 3), np.dtype(np.float64))
        assert all(np.array_equal(a, b) for a, b in zip(view, plain, strict=True))
    for factor in (1e20, 1e200, 1e307):
        there = make_view(camera._replace(look_at=factor * np.array([-1.0, -1.5, -4.0])), (4, 3), np.dtype(np.float64))
        np.testing.assert_allclose(there.forward, np.array([-1, -1.5, -4]) / np.linalg.norm([1, 1.5, 4]), rtol=1e-15)
        assert all(np.isfinite(vector).all() for vector in there)
