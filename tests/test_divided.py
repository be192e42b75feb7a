"""Trees whose large triangles lie in several leaves: the same answers, bit for bit, and each hit once."""

import numpy as np
import pytest

import rays
import raytrace as rt
from divided_rays import aimed_at_cuts, beams
from raytrace.accel import build as building
from raytrace.accel import dividing, hit_lists, spatial, unite
from raytrace.accel.layout import boxes_of, children_of, triangles_of
from raytrace.hardcases.query_oracle import HitJudge
from raytrace.jit import interpreted

pytestmark = pytest.mark.engine

MESH = beams(300, 60, seed=1)
O, D = rays.anywhere(3000, seed=2)  # noqa: E741


def whole(precision="float32", mesh=MESH):
    """The tree in which each triangle lies in one leaf."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(building, "DIVIDED", 1 << 60)
        return rt.BVH(*mesh, precision)


def differing(bvh, other, o, d):
    """Whether any answer about rays differs."""
    t = bvh.closest_hit(o, d).t
    near, far = (t * bvh.vertices.dtype.type(1 + k * 16 * np.finfo(t.dtype).eps) for k in (-1, 1))
    return not (
        rays.same_hits(bvh.closest_hit(o, d), other.closest_hit(o, d))
        and np.array_equal(bvh.any_hit(o, d, tmax=far), other.any_hit(o, d, tmax=far))
        and np.array_equal(bvh.any_hit(o, d, tmin=near), other.any_hit(o, d, tmin=near))
    )


@pytest.fixture(scope="module", params=["float32", "float64"])
def pair(request):
    """A tree with divided triangles, and one without."""
    return rt.BVH(*MESH, request.param), whole(request.param)


def test_large_triangles_are_divided_and_the_tree_is_sound(pair):
    bvh, other = pair
    bvh.validate()
    stats, before = bvh.stats, other.stats
    assert bvh.divided
    assert not other.divided
    assert stats.triangles == before.triangles == len(MESH[1])
    assert before.references == 1 < stats.references <= 1 + building.SPARE
    assert stats.references == np.count_nonzero(triangles_of(bvh.tree.leaves) >= 0) / len(MESH[1])
    assert stats.sah_cost < 0.75 * before.sah_cost
    assert 0.5 < stats.fill <= 1


@pytest.mark.parametrize(
    "mesh", [rays.soup(2000, 1, 0.02), rays.torus(64, 32), rays.grid(32)], ids=["soup", "torus", "grid"]
)
def test_meshes_of_alike_triangles_are_not_divided(mesh):
    bvh, other = rt.BVH(*mesh), whole(mesh=mesh)
    assert not bvh.divided
    assert rays.same_bits(bvh.tree.nodes.bounds, other.tree.nodes.bounds)
    assert rays.same_bits(bvh.tree.leaves.rows, other.tree.leaves.rows)


@pytest.mark.parametrize("options", [{"split": "median"}, {"triangle": "moller-trumbore"}])
def test_trees_for_comparison_are_not_divided(options):
    assert not rt.BVH(*MESH, **options).divided


def test_all_queries_give_the_same_bits(pair):
    bvh, other = pair
    assert not differing(bvh, other, O, D)
    for crossings in (False, True):
        a, b = (tree.all_hits(O, D, crossings=crossings) for tree in pair)
        assert all(rays.same_bits(x, y) for x, y in zip(a, b, strict=True))
        count = bvh.count_hits(O, D, crossings=crossings)
        assert np.array_equal(count, np.diff(a.start))
        assert count.max() > 4
    assert np.array_equal(bvh.contains(O / 2), other.contains(O / 2))
    assert bvh.contains(O / 2).any()
    assert all(rays.same_bits(x, y) for x, y in zip(bvh.closest_point(O), other.closest_point(O), strict=True))


def test_rays_near_the_cuts_lose_no_hit(pair):
    bvh, other = pair
    o, d = aimed_at_cuts(bvh, 5000, seed=3)
    assert not differing(bvh, other, o, d)
    assert (bvh.closest_hit(o, d).prim_id >= 0).mean() > 0.7
    judge = HitJudge(bvh.vertices[bvh.faces], *(a[::100].astype(bvh.precision) for a in (o, d)))
    assert judge.of_hits(bvh.all_hits(o[::100], d[::100]))[:4] == (0, 0, 0, 0)


def test_boxes_that_are_too_small_are_noticed(monkeypatch):
    monkeypatch.setattr(dividing, "WIDEN", -64.0)
    bvh = rt.BVH(*MESH)
    assert differing(bvh, whole(), *aimed_at_cuts(bvh, 5000, seed=3))
    monkeypatch.setattr(dividing, "WIDEN", -1e5)
    with pytest.raises(ValueError, match="do not cover it"):
        rt.BVH(*MESH).validate()


def test_the_validator_sees_a_part_without_a_box():
    bvh = rt.BVH(*MESH)
    prim, child = triangles_of(bvh.tree.leaves), children_of(bvh.tree.nodes)
    counts = np.bincount(prim[prim >= 0])
    leaf = int(np.flatnonzero((counts[prim] > 1).all(axis=1) & (prim >= 0).all(axis=1))[0])
    node, slot = (int(k[0]) for k in np.nonzero(child == ~leaf))
    boxes_of(bvh.tree.nodes)[node, :3, slot] = boxes_of(bvh.tree.nodes)[node, 3:, slot]
    with pytest.raises(ValueError, match="the boxes of the leaves of a triangle do not cover it"):
        bvh.validate()


def test_hits_that_are_not_united_are_noticed(pair, monkeypatch):
    bvh, other = pair
    monkeypatch.setattr(unite, "unite", lambda *_: None)
    assert (bvh.count_hits(O, D) > other.count_hits(O, D)).any()


def test_rays_with_many_hits_are_counted_in_parts(pair, monkeypatch):
    bvh, other = pair
    monkeypatch.setattr(hit_lists, "UNCHECKED", 100 * hit_lists.HIT)
    monkeypatch.setattr(hit_lists, "FIRST_HITS", 0.01)
    assert np.array_equal(bvh.count_hits(O, D), other.count_hits(O, D))


def test_the_tree_does_not_depend_on_how_it_is_shared(pair, monkeypatch):
    bvh, _ = pair
    monkeypatch.setattr(building, "MIN_SUBTREE", 64)
    parts = rt.BVH(*MESH, bvh.precision)
    assert rays.same_bits(bvh.tree.nodes.bounds, parts.tree.nodes.bounds)
    assert rays.same_bits(bvh.tree.leaves.rows, parts.tree.leaves.rows)


def test_refit_builds_a_tree_of_whole_triangles_once(pair):
    _, other = pair
    bvh = rt.BVH(*MESH, other.precision)
    cost = bvh.stats.sah_cost
    moved = MESH[0] * [1, 2, 1] + 0.1
    bvh.refit(moved)
    bvh.validate()
    assert not bvh.divided
    assert bvh.stats.references == 1
    assert bvh.stats.growth == bvh.stats.sah_cost / cost > 1.2
    assert not differing(bvh, rt.BVH(moved, MESH[1], other.precision), O, D)
    nodes = children_of(bvh.tree.nodes)
    bvh.refit(MESH[0])
    assert np.array_equal(nodes, children_of(bvh.tree.nodes))
    assert bvh.stats.growth == bvh.stats.sah_cost / cost
    assert not differing(bvh, other, O, D)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_interpreted_and_compiled_trees_are_the_same(precision, monkeypatch):
    monkeypatch.setattr(building, "DIVIDED", 0)
    monkeypatch.setattr(dividing, "WORTH", -1.0)
    mesh = beams(30, 8, seed=4)
    compiled = rt.BVH(*mesh, precision)
    monkeypatch.setattr(spatial, "grow_spatial", interpreted(spatial.grow_spatial))
    plain = rt.BVH(*mesh, precision)
    assert compiled.stats.references > 1.05
    assert rays.same_bits(compiled.tree.nodes.child, plain.tree.nodes.child)
    assert rays.same_bits(compiled.tree.leaves.prim_id, plain.tree.leaves.prim_id)
