import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.hardcases.judge import RayQuery
from raytrace.hardcases.rays import Case, cases
from raytrace.hardcases.shadows import shadow_cases
from raytrace.hardcases.tracers import Baseline, Ours, own_tracers, paths, renderer_shadow_rays

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
CASES: dict[str, Case] = {case.name: case for case in cases()}
SHADOWS = {case.name: case for case in shadow_cases()}


@pytest.mark.parametrize("precision", PRECISIONS)
def test_all_paths_give_the_bits_of_a_plain_query(precision):
    bvh = rt.BVH(*rays.torus(30, 15), precision)
    o, d = (a.astype(precision) for a in rays.anywhere(777, seed=1))
    rng = np.random.default_rng(2)
    tmin, tmax = (rng.uniform(low, high, 777).astype(precision) for low, high in ((-1, 1), (0.5, 3)))
    hits, blocked = bvh.closest_hit(o, d, tmin, tmax), bvh.any_hit(o, d, tmin, tmax)
    assert 0.1 < blocked.mean() < 0.9
    ways = list(paths(bvh))
    assert len(ways) == 4
    for closest, occluded in ways:
        assert rays.same_hits(closest(o, d, tmin, tmax), hits)
        assert np.array_equal(occluded(o, d, tmin, tmax), blocked)
        assert rays.same_hits(closest(o[:0], d[:0]), rt.Hits(*(column[:0] for column in hits)))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_paths_visit_nodes_alone_together_or_behind_a_frustum(precision):
    bvh = rt.BVH(*rays.cube(), precision)
    d = np.tile(np.array([[1.0, 0.5, 0.25]], precision), (4 * rays.PACKET, 1))
    visited = []
    for closest, _ in paths(bvh):
        work = bvh.work()
        bvh.work = lambda work=work: work
        closest(0 * d, d)
        visited.append(work.counts[0])
        del bvh.work
    packed, _, alone, bundled = visited
    assert alone >= 4 * rays.PACKET
    assert packed < alone / 2
    assert bundled == 4 * rays.PACKET


def test_every_tree_is_asked_in_every_way():
    query = CASES["cube, from inside"].query("float32", 9)
    ours = Ours("float32")
    assert len(list(ours.nearest(query))) == len(list(ours.blocked(query))) == 2 * 4
    assert len(list(ours.shadows(SHADOWS["lit floor, scale 1e+00"].query("float32", 50)))) == 8
    assert [tracer.name for tracer in own_tracers()] == [
        "raytrace float32",
        "raytrace float64",
        "baseline float32",
        "baseline float64",
    ]
    assert [tracer.exact for tracer in own_tracers()] == [True, True, False, False]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_shadow_rays_start_where_spawn_ray_says_and_end_at_the_light(precision):
    vertices, faces = rays.torus(12, 8)
    bvh = rt.BVH(vertices + 3, faces, precision)
    o, d = (a.astype(precision) for a in rays.towards([[3, 3, 5]], vertices[::3].astype(precision) + 3))
    hits = bvh.closest_hit(o, d)
    surface = rt.Surface(*(a[hits.prim_id >= 0] for a in bvh.surface(hits)))
    light = np.array([3.5, 2, 9], precision)
    start, away, tmax = renderer_shadow_rays(surface, light)
    expected = rt.spawn_ray(*surface, light - surface.p)
    np.testing.assert_allclose(start, expected, rtol=0, atol=4 * np.finfo(precision).eps * 5)
    assert (
        (start - surface.p) * surface.ng * np.sign(((light - surface.p) * surface.ng).sum(axis=1))[:, None]
    ).sum() > 0
    np.testing.assert_allclose(start + away, np.tile(light, (len(start), 1)), rtol=1e-6)
    assert set(tmax.tolist()) <= {1.0, -1.0}


def test_the_seed_loses_what_is_small_and_shadows_itself_where_scenes_are_large():
    query = CASES["scale 1e-06"].query("float32", 20)
    assert all((hits.prim_id == -1).all() for hits in Baseline("float32").nearest(query))
    assert all((hits.prim_id >= 0).mean() > 0.6 for hits in Ours("float32").nearest(query))
    lit = SHADOWS["lit sphere, scale 1e+06"].query("float32", 2)
    assert all(found.dark[found.found].mean() > 0.1 for found in Baseline("float32").shadows(lit))
    assert all(not found.dark[found.found].any() for found in Ours("float32").shadows(lit))


def test_intervals_are_handed_on():
    floor = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])
    o, d = np.array([[1.0, 1, 3]] * 3), np.array([[0.0, 0, -1]] * 3)
    query = RayQuery(*floor, o, d, np.array([0, 4.0, 0]), np.array([9, 9, 2.0]), np.zeros(3, bool), False)
    for hits in Ours("float64").nearest(query):
        assert hits.t.tolist() == [3, np.inf, np.inf]
    for blocked in Ours("float64").blocked(query):
        assert blocked.tolist() == [True, False, False]
