"""Mirror and Snell against 50 digits, and origins of rays."""

import numpy as np
import pytest

import exact_optics
import naive
import rays
import raytrace as rt

TOLERANCE = {"float32": 2e-6, "float64": 3e-14}


def directions(n, seed):
    """Unit directions towards surfaces of unit normals, from normal to grazing."""
    rng = np.random.default_rng(seed)
    normal = naive.unit(rng.normal(size=(n, 3)))
    along = naive.unit(np.cross(normal, rng.normal(size=(n, 3))))
    angle = np.concatenate([np.linspace(0, np.pi / 2 - 1e-3, n - n // 4), 10.0 ** rng.uniform(-8, -1, n // 4)])[:, None]
    return np.sin(angle) * along - np.cos(angle) * normal, normal


@pytest.mark.parametrize("precision", TOLERANCE)
@pytest.mark.parametrize("eta", exact_optics.INDICES)
@pytest.mark.parametrize("where", exact_optics.WHERE)
def test_refract_agrees_with_fifty_digits(where, eta, precision):
    eta = np.array(eta, precision)
    d, n = exact_optics.at_angles(exact_optics.angles(where, float(eta), 60, seed=1), 2, precision)
    out, total = rt.refract(d, n, eta)
    assert out.dtype == precision
    for k in range(len(d)):
        assert exact_optics.agrees(out[k], total[k], (d[k], n[k], eta), TOLERANCE[precision]), (d[k], n[k])


@pytest.mark.nojit
@pytest.mark.parametrize("precision", TOLERANCE)
def test_every_direction_about_the_critical_angle_has_a_unit_result(precision):
    eta = np.array(1 / 1.5, precision)
    d, n = exact_optics.at_angles(np.full(4000, np.arcsin(float(eta))), 3, precision)
    ulps = np.random.default_rng(4).integers(-3, 4, d.shape)
    out, total = rt.refract((d + ulps * np.spacing(d)).astype(precision), n, eta)
    assert 0.2 < total.mean() < 0.8
    np.testing.assert_allclose(np.linalg.norm(out.astype(np.float64), axis=1), 1, atol=2 * np.finfo(precision).eps)


@pytest.mark.nojit
@pytest.mark.parametrize("precision", TOLERANCE)
@pytest.mark.parametrize("eta", [1e-3, 1e3, 1e-25, 1e25, 1e-38, 1e38])
def test_extreme_indices_give_unit_directions(eta, precision):
    d, n = (a.astype(precision) for a in directions(2000, 11))
    d[0] = -n[0]
    out, total = rt.refract(d, n, eta)
    np.testing.assert_allclose(np.linalg.norm(out.astype(np.float64), axis=1), 1, atol=2 * np.finfo(precision).eps)
    if eta > 1:
        assert not total.any()
        np.testing.assert_allclose(out, -n, atol=2 / eta + 1e-6)
    else:
        assert total.mean() > 0.7  # those nearest to the normal get through
        assert (naive.dot(out[total].astype(np.float64), n[total]) > 0).all()


@pytest.mark.nojit
@pytest.mark.parametrize("precision", TOLERANCE)
def test_a_thousand_bounces_keep_the_length(precision):
    d, n = (a.astype(precision) for a in directions(100, 12))
    rng = np.random.default_rng(13)
    worst = 0.0
    for k in range(1000):
        d = rt.reflect(d, n) if k % 2 else rt.refract(d, n, rng.uniform(0.5, 2, 100))[0]
        worst = max(worst, np.abs(np.linalg.norm(d.astype(np.float64), axis=1) - 1).max())
        n = naive.unit(rng.normal(size=(100, 3)))
        n = np.where(naive.dot(n, d)[:, None] > 0, -n, n).astype(precision)
    assert worst < 2 * np.finfo(precision).eps


@pytest.mark.parametrize("precision", TOLERANCE)
def test_reflect_agrees_with_fifty_digits(precision):
    d, n = (a.astype(precision) for a in directions(300, 2))
    out = rt.reflect(d, n)
    for k in range(len(d)):
        truth = exact_optics.mirror(*(exact_optics.unit(exact_optics.vector(a[k])) for a in (d, n)))
        assert exact_optics.distance(out[k], truth) < TOLERANCE[precision]


@pytest.mark.nojit
@pytest.mark.parametrize("precision", TOLERANCE)
def test_a_boundary_that_is_none_changes_no_bit(precision):
    d, n = (a.astype(precision) for a in directions(1000, 3))
    out, total = rt.refract(d, n, 1.0)
    assert rays.same_bits(out, d)
    assert not total.any()


@pytest.mark.nojit
@pytest.mark.parametrize("precision", TOLERANCE)
def test_results_are_unit_and_on_the_right_side(precision):
    d, n = (a.astype(precision) for a in directions(2000, 4))
    eta = np.random.default_rng(5).uniform(0.4, 2.5, 2000).astype(precision)
    out, total = rt.refract(d, n, eta)
    eps = np.finfo(precision).eps
    np.testing.assert_allclose(np.linalg.norm(out.astype(np.float64), axis=1), 1, atol=2 * eps)
    assert 0.1 < total.mean() < 0.9
    away = naive.dot(out.astype(np.float64), n)
    assert (away[total] > 0).all()
    assert (away[~total] < 0).all()
    np.testing.assert_allclose(np.linalg.norm(rt.reflect(d, n).astype(np.float64), axis=1), 1, atol=2 * eps)


@pytest.mark.nojit
def test_light_goes_back_the_way_it_came():
    d, n = directions(500, 6)
    out, total = rt.refract(d, n, 1.33)
    assert not total.any()
    back, total = rt.refract(-out, -n, 1 / 1.33)
    clear = naive.dot(d, n) < -0.01
    assert not total[clear].any()
    np.testing.assert_allclose(back[clear], -d[clear], atol=1e-13)  # eps / cosine


@pytest.mark.nojit
def test_shapes_broadcast_and_types_are_kept():
    d, n = directions(6, 7)
    out, total = rt.refract(d.reshape(2, 3, 3), n.reshape(2, 3, 3), np.full((2, 3), 1.5))
    assert (out.shape, total.shape) == ((2, 3, 3), (2, 3))
    assert rays.same_bits(out.reshape(6, 3), rt.refract(d, n, 1.5)[0])
    one, flag = rt.refract(d[0], n[0], 1.5)
    assert (one.shape, flag.shape) == ((3,), ())
    many, flags = rt.refract(d[0], n[0], [0.5, 1.5])
    assert (many.shape, flags.shape) == ((2, 3), (2,))
    assert rt.refract([0, 0, -1], [0, 0, 1], 2)[0].dtype == np.float64
    assert rt.refract(d.astype("f2"), n.astype("f2"), 1.5)[0].dtype == np.float32
    assert rt.reflect(d.astype("f4"), n)[0].dtype == np.float64
    assert rt.refract(np.empty((0, 3)), np.empty((0, 3)), 1.5)[0].shape == (0, 3)


@pytest.mark.nojit
@pytest.mark.parametrize("precision", TOLERANCE)
def test_rays_start_at_a_distance_that_the_errors_bound_on_their_side(precision):
    d, n = (a.astype(precision) for a in directions(200, 8))
    p, p_error = np.zeros((200, 3), precision), np.random.default_rng(9).uniform(0, 1e-3, (200, 3)).astype(precision)
    for way in (d, -d):
        o = rt.spawn_ray(p, p_error, n, way)
        assert o.dtype == precision
        distance = naive.dot(o.astype(np.float64), n)
        np.testing.assert_allclose(distance, np.sign(naive.dot(way, n)) * naive.dot(np.abs(n), p_error), rtol=1e-5)
        np.testing.assert_allclose(np.cross(o, n), 0, atol=1e-9)
    assert rays.same_bits(rt.spawn_ray(p + 1, 0 * p_error, n, d), p + 1)
