"""``rt.radiance``: closed forms, the image of the same rays, honest errors, and results that no batch changes."""

import math
import tracemalloc

import numpy as np
import pytest

import raytrace as rt
from light_cases import ABOVE, CUBE, PLANE, diffuse, scene
from light_scenes import glass_and_metal
from raytrace import memory
from raytrace.errors import OptionError
from raytrace.passes.camera import make_view, pinhole_directions
from raytrace.rendering import given_rays
from small_scenes import studio

pytestmark = pytest.mark.engine
ROOM = scene([(CUBE[:, ::-1], diffuse(0.5, 0.25))], {"position": [0, 0, 0.5], "look_at": [0, 0.2, -1], "fov": 60}, 5)


def directions(n, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


@pytest.mark.parametrize("depth", [1, 2, None])
def test_a_furnace(depth):
    light, stderr = rt.radiance(ROOM, [0.1, 0.2, 0.3], directions(500), spp=16, max_depth=depth)
    expected = 0.25 * (1 - 0.5 ** ((depth or 5) + 1)) / 0.5
    rt.testing.t_test(light.mean(axis=0), expected, variance=(stderr**2).sum(axis=0) / 500**2, tolerance=1e-6)
    assert stderr.max() < 0.2


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_a_point_light_on_a_plane(integrator):
    """No path tracing is needed for it, but the answer is the same."""
    lit = scene(
        [(PLANE, diffuse(0.5))],
        ABOVE,
        1,
        lights=[{"type": "point", "position": [0, 0, 2], "flux": [100, 50, 25]}],
        integrator="direct",
    )
    x = np.array([0.0, 1.0, 3.0])
    origins = np.stack([x, 0.1 * x, np.full(3, 5.0)], axis=1)
    light, stderr = rt.radiance(lit, origins, [0, 0, -2], spp=4, integrator=integrator, precision="float64")
    r2 = 4 + 1.01 * x**2
    expected = 0.5 / math.pi * np.array([100, 50, 25]) / (4 * math.pi) * (2 / r2**1.5)[:, None]
    np.testing.assert_allclose(light, expected, rtol=1e-9)
    assert not stderr.any()


@pytest.mark.parametrize("make", [lambda: rt.load(glass_and_metal()), studio])
def test_rays_of_the_camera_make_its_image(make):
    """Means over the film: of rays through random points of it, and of the image."""
    given = make()
    n, side = 20_000, 16
    x, y = np.random.default_rng(1).random((2, n)) * side
    d = pinhole_directions(make_view(given.camera, (side, side), np.dtype(np.float64)), x, y)
    light, stderr = rt.radiance(given, given.camera.position, d, spp=4, seed=3)
    images = [rt.render(given, size=(side, side), spp=64, seed=seed).rgb.mean(axis=(0, 1)) for seed in range(8)]
    spread = np.var(images, axis=0, ddof=1) / 8
    between = light.var(axis=0) / n  # noise, and where on the film the points lie
    assert (between >= (stderr**2).mean(axis=0) / n).all()
    rt.testing.t_test(light.mean(axis=0), np.mean(images, axis=0), variance=between, reference_variance=spread)


@pytest.mark.parametrize("spp", [16, 48])
def test_standard_errors_are_honest(spp):
    """Squares of t have the mean 15 / 13 with 16 batches; errors beyond three standard errors are rare."""
    light, stderr = rt.radiance(ROOM, [0.1, 0.2, 0.3], directions(3000, 2), spp=spp, max_depth=2)
    t = (light[:, 0] - 0.4375) / stderr[:, 0]
    assert 0.95 < (t**2).mean() < 1.5
    assert (np.abs(t) > 3).mean() < 0.025
    assert abs(t.mean()) < 0.2
    assert stderr[:, 0].mean() == pytest.approx(light[:, 0].std(), rel=0.1)


def test_no_thread_or_batch_changes_a_bit(monkeypatch):
    o, d = directions(200, 3) * 0.3, directions(200, 4)
    light, stderr = rt.radiance(ROOM, o, d, spp=20, threads=1)
    for other in (rt.radiance(ROOM, o, d, spp=20, threads=3), rt.radiance(ROOM, o.tolist(), 7 * d, spp=20)):
        np.testing.assert_array_equal(light, other[0])
        np.testing.assert_array_equal(stderr, other[1])
    first, _ = rt.radiance(ROOM, o[:11], d[:11], spp=20)
    np.testing.assert_array_equal(light[:11], first)
    monkeypatch.setattr(given_rays, "BATCH", 512)
    np.testing.assert_array_equal(light, rt.radiance(ROOM, o, d, spp=20)[0])
    assert (rt.radiance(ROOM, o, d, spp=20, seed=1)[0] != light).any()


def test_shapes_broadcast():
    light, stderr = rt.radiance(ROOM, np.zeros((4, 1, 3)), directions(5), spp=2)
    assert light.shape == stderr.shape == (4, 5, 3)
    assert (rt.radiance(ROOM, [0, 0, 0], [0, 0, 1], spp=2)[0].shape, light.dtype) == ((1, 3), np.float64)
    assert np.isnan(rt.radiance(ROOM, [0, 0, 0], [0, 0, 1], spp=1)[1]).all()
    assert rt.radiance(ROOM, np.zeros((0, 3)), [0, 0, 1])[0].shape == (0, 3)


def test_many_samples_fit_into_few_batches():
    light, stderr = rt.radiance(ROOM, [0, 0, 0], [[0, 0, 1]], spp=20_000, max_depth=2)
    assert abs(light[0, 0] - 0.4375) < 5 * stderr[0, 0]
    assert stderr[0, 0] < 0.002


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: rt.radiance(ROOM, [0, 0], [0, 0, 1]), r"origins: expected \(\.\.\., 3\)"),
        (lambda: rt.radiance(ROOM, "a", [0, 0, 1]), "origins: expected numbers"),
        (lambda: rt.radiance(ROOM, np.zeros((2, 3)), np.ones((3, 3))), "do not broadcast"),
        (lambda: rt.radiance(ROOM, [[0, 0, 0], [0, np.nan, 0]], [0, 0, 1]), "origins: ray 1: expected finite"),
        (lambda: rt.radiance(ROOM, [0, 0, 0], [0, 0, 0]), "directions: ray 0: expected finite numbers that are not"),
        (lambda: rt.radiance(ROOM, [1e300, 0, 0], [0, 0, 1], precision="float32"), "float64"),
        (lambda: rt.radiance(ROOM, [0, 0, 0], [0, 0, 1], max_depth=0), "max_depth: expected"),
        (lambda: rt.radiance(ROOM, [0, 0, 0], [0, 0, 1], spp=0), "spp: expected"),
        (lambda: rt.radiance(ROOM, [0, 0, 0], [0, 0, 1], integrator="all"), "integrator: expected"),
    ],
)
def test_mistakes_are_named(call, text):
    with pytest.raises(OptionError, match=text):
        call()


def test_too_many_rays_are_refused_before_any_array_is_made(monkeypatch):
    monkeypatch.setattr(memory, "free", lambda: 1e9)
    ways = np.broadcast_to([0.0, 0.0, 1.0], (200_000_000, 3))
    with pytest.raises(
        OptionError, match=r"^memory: radiance, with 29.8 GiB for 200,000,000 rays, .*; divide the rays$"
    ):
        rt.radiance(ROOM, [0, 0, 0], ways)


def test_the_memory_of_rays_is_not_underestimated():
    n, options = 100_000, {"spp": 1, "precision": "float64", "threads": 1}
    ways = directions(n)
    rt.radiance(ROOM, [0, 0, 0], ways[:9], **options)
    tracemalloc.start()
    try:
        rt.radiance(ROOM, np.zeros(3), ways, **options)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    batch = given_rays.BATCH * 8 * memory.PATH
    assert 0.5 * memory.RAY * n < used <= memory.RAY * n + 2 * batch
