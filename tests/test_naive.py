"""The twin itself, against exact arithmetic, SciPy and answers known by hand."""

import math

import numpy as np
import pytest

import exact
import naive
import naive_sampling
from small_scenes import Part, ball, box, glass, look, make_scene, quad

FLOOR = quad((-4, 0, 4), (4, 0, 4), (4, 0, -4), (-4, 0, -4))  # faces +y


def unit(a):
    return naive.unit(np.atleast_2d(np.asarray(a, np.float64)))


def soup(triangles):
    corners = np.asarray(triangles, np.float64).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)


# --- nearest hit -----------------------------------------------------------------------------------------------------


def test_closest_hit_is_exact_on_a_lattice_where_rays_meet_edges_and_vertices():
    rng = np.random.default_rng(1)
    vertices = rng.integers(-2, 3, (24, 3)).astype(np.float64)
    faces = np.array([rng.choice(24, 3, replace=False) for _ in range(30)])
    origins = rng.integers(-4, 5, (300, 3)).astype(np.float64)
    directions = rng.choice([-2.0, -1.0, -0.0, 0.0, 1.0, 2.0], (300, 3))  # ratios are powers of two: no rounding
    directions[(directions == 0).all(axis=1)] = 1.0
    hits = naive.closest_hit(vertices, faces, origins, directions)
    kinds = set()
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        t, tied, crossings = exact.closest(vertices, faces, o, d)
        kinds |= {crossings[j].kind for j in tied}
        assert hits.prim_id[i] == (tied[0] if tied else -1)
        if t is not None:
            expected = [float(x) for x in (t, crossings[tied[0]].u, crossings[tied[0]].v)]
            np.testing.assert_allclose([hits.t[i], hits.u[i], hits.v[i]], expected, rtol=4e-16, atol=0)
    assert kinds == {"interior", "edge", "vertex"}


def test_closest_hit_agrees_with_rationals_on_random_triangles():
    rng = np.random.default_rng(2)
    for _ in range(300):
        triangle, (o, d) = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
        crossing = exact.classify(triangle, o, d)
        hits = naive.closest_hit(*soup(triangle), o, d)
        if crossing.kind == "miss" or crossing.t < 0:
            assert hits.prim_id[0] == -1
            assert hits.t[0] == np.inf
        else:
            # condition: the plane may stand nearly along the ray, 1 / |cos| <= 1e3 among these
            np.testing.assert_allclose(hits.t[0], float(crossing.t), rtol=1e-12)


def test_no_ray_slips_through_edges_or_vertices_of_a_closed_mesh():
    triangles, _ = ball(8)
    triangles = triangles * 0.7 + 0.1
    edges = (triangles + np.roll(triangles, 1, axis=1)) / 2
    targets = np.concatenate([triangles.reshape(-1, 3), edges.reshape(-1, 3)])
    inside = np.array([0.123, -0.2, 0.3])
    assert naive.any_hit(*soup(triangles), np.broadcast_to(inside, targets.shape), targets - inside).all()


def test_equal_distance_gives_the_lowest_prim_id():
    triangles = np.array([FLOOR[1], FLOOR[0], FLOOR[0], FLOOR[1]])
    hits = naive.closest_hit(*soup(triangles), [[1, 1, 2], [-1, 1, -2], [0, 1, 0]], [[0, -1, 0]] * 3)
    assert hits.prim_id.tolist() == [1, 0, 0]


def test_range_is_open_and_distance_counts_directions():
    ray = ([1.0, 2.0, 2.0], [0.0, -4.0, 0.0])
    assert naive.closest_hit(*soup(FLOOR), *ray).t[0] == 0.5
    assert not naive.any_hit(*soup(FLOOR), *ray, 0.5, 1.0)[0]
    assert not naive.any_hit(*soup(FLOOR), *ray, 0.0, 0.5)[0]
    assert not naive.any_hit(*soup(FLOOR), *ray, 1.0, 0.0)[0]
    assert naive.any_hit(*soup(FLOOR), *ray, 0.49, 0.51)[0]


def test_bad_rays_and_flat_triangles_are_misses():
    rays = np.array([[np.nan, 1, 0], [1, 1, np.inf], [1, 1, 1]]), np.array([[0, -1, 0], [0, -1, 0], [0, -np.inf, 0]])
    assert (naive.closest_hit(*soup(FLOOR), *rays).prim_id == -1).all()
    assert not naive.any_hit(*soup(FLOOR), [1, 1, 0], [0, 0, 0])[0]
    assert not naive.any_hit(*soup([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]]), [1, 1, 0], [0, -1, 0])[0]
    assert naive.closest_hit(*soup(FLOOR), np.empty((0, 3)), np.empty((0, 3))).t.shape == (0,)
    assert not naive.any_hit(np.empty((0, 3)), np.empty((0, 3)), [1, 1, 0], [0, -1, 0])[0]


# --- optics ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [1.5, 1 / 1.5, 1.0])
def test_refract_obeys_snell_and_stays_in_the_plane(eta):
    angle = np.linspace(0, 0.99 * np.arcsin(min(eta, 1.0)), 10)
    d = np.stack([np.sin(angle), -np.cos(angle), 0 * angle], axis=1)
    w, total = naive.refract(d, np.array([[0.0, 1.0, 0.0]]), np.full(10, eta))
    assert not total.any()
    np.testing.assert_allclose(w[:, 0], np.sin(angle) / eta, atol=2e-15)
    np.testing.assert_allclose(np.sum(w * w, axis=1), 1, rtol=4e-16)
    assert (w[:, 1] < 0).all()
    assert (w[:, 2] == 0).all()


def test_refract_reflects_past_the_critical_angle():
    n, critical = np.array([[0.0, 1.0, 0.0]]), math.asin(1 / 1.5)
    for angle, expected in ((critical - 1e-9, False), (critical + 1e-9, True), (1.5, True)):
        d = unit([math.sin(angle), -math.cos(angle), 0])
        w, total = naive.refract(d, n, np.array([1 / 1.5]))
        assert total[0] == expected
        if expected:
            np.testing.assert_allclose(w, d * [1, -1, 1], atol=1e-15)


def test_bounce_never_leaves_on_the_wrong_side_of_the_triangle():
    rng = np.random.default_rng(3)
    ng = unit(rng.normal(size=(5000, 3)))
    ns = unit(ng + 0.7 * unit(rng.normal(size=(5000, 3))))
    d = unit(rng.normal(size=(5000, 3)))
    w = naive.bounce(d, ng, ns, np.full(5000, 1.5))
    by_ng = naive.bounce(d, ng, ng, np.full(5000, 1.5))
    side, through = np.sign(np.sum(d * ng, axis=1)), np.sum(w * ng, axis=1)
    total = np.sign(np.sum(by_ng * ng, axis=1)) != side
    assert total.any()
    assert (through * side > 0)[side < 0].all()  # entering is never total
    assert (np.abs(through) > 0).all()
    assert (np.abs(w - by_ng).max(axis=1) > 1e-3).mean() > 0.5  # and ns does matter


# --- camera ----------------------------------------------------------------------------------------------------------


def test_camera_sees_its_target_in_the_centre_and_its_angle_at_the_top():
    camera = look((1, 2, 3), (1, 2, -7), fov=60)
    o, d = naive.camera_rays(camera, (40, 20), np.array([[20, 10], [20, 0], [40, 10], [0, 20]], np.float64))
    half = math.tan(math.radians(30))
    np.testing.assert_allclose(d, unit([[0, 0, -1], [0, half, -1], [2 * half, 0, -1], [-2 * half, -half, -1]]))
    assert (o == camera.position).all()


# --- the renderer ----------------------------------------------------------------------------------------------------


def one_ray(scene, origin, direction, max_depth=16):
    return naive.radiance(scene, np.array([origin], np.float64), unit(direction), max_depth)[0]


LIGHT = ((0.0, 2.0, 0.0), (4.0, 8.0, 12.0))
ALBEDO = np.array([0.2, 0.5, 0.8])


def test_floor_returns_albedo_over_pi_times_the_irradiance():
    scene = make_scene([Part(FLOOR, albedo=ALBEDO)], [LIGHT])
    # under (1.5, 0, 0): r = 2.5, cos = 0.8
    expected = ALBEDO / math.pi * np.array(LIGHT[1]) * 0.8 / (4 * math.pi * 2.5**2)
    np.testing.assert_allclose(one_ray(scene, (1.5, 1, 1), (0, -1, -1)), expected, rtol=1e-14)


def test_light_behind_a_surface_and_eyes_behind_it_see_nothing_unless_two_sided():
    below = ((0.0, -2.0, 0.0), (1.0, 1.0, 1.0))
    for two_sided in (False, True):
        scene = make_scene([Part(FLOOR, two_sided=two_sided)], [below])
        assert (one_ray(scene, (1, 1, 0), (0, -1, 0)) == 0).all()
        assert (one_ray(scene, (1, -1, 0), (0, 1, 0)) > 0).all() == two_sided


@pytest.mark.parametrize("part", [Part(FLOOR / 4 + [0, 1, 0]), glass(FLOOR / 4 + [0, 1, 0], 1.5)])
def test_everything_between_point_and_light_casts_a_shadow_unless_told_otherwise(part):
    for transparent in (False, True):
        scene = make_scene([Part(FLOOR), part._replace(transparent_shadow=transparent)], [LIGHT])
        assert (one_ray(scene, (3, 0.5, 0), (-2.5, -0.5, 0)) > 0).all() == transparent


def test_nothing_beyond_the_light_casts_a_shadow():
    scene = make_scene([Part(FLOOR), Part(box((-1, 3, -1), (1, 4, 1)))], [LIGHT])
    assert (one_ray(scene, (1, 1, 0), (0, -1, 0)) > 0).all()


def test_depth_counts_surfaces_and_a_path_cut_short_is_black():
    slab = glass(box((-1, 1, -1), (1, 2, 1)), 1.5)
    scene = make_scene([Part(FLOOR), slab], [((0, 0.5, 0), (1, 1, 1))], background=(7, 7, 7))
    assert (one_ray(scene, (0.1, 3, 0), (0, -1, 0), max_depth=2) == 0).all()
    assert (one_ray(scene, (0.1, 3, 0), (0, -1, 0), max_depth=3) > 0).all()
    assert (one_ray(scene, (0.1, 3, 0), (0, 1, 0), max_depth=1) == 7).all()


def test_mean_of_film_points_fills_the_film():
    scene = make_scene([Part(FLOOR)], background=(1, 2, 3), camera=look((0, 5, 0.1), (0, 6, 0)))
    film = naive.render(scene, naive_sampling.film_points("sobol", 0, 3, (1, 2, 5, 4)))
    np.testing.assert_allclose(film, np.broadcast_to([1.0, 2.0, 3.0], (4, 5, 3)), rtol=1e-15)
