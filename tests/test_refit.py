"""``BVH.refit``: the answers and triangles of a new tree, whatever the motion; errors leave the tree as it was."""

import copy
import pickle

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.accel.layout import boxes_of, children_of

RNG = np.random.default_rng(1)
VERTICES, FACES = rays.torus(16, 12)
VERTICES = VERTICES / np.abs(VERTICES).max()
O, D = rays.anywhere(1500, seed=2)  # noqa: E741
O = O / 2  # noqa: E741


def part_in_a_point(v):
    v = v.copy()
    v[: len(v) // 2] = v[0]
    return v


MOTIONS = {
    "none": lambda v: v,
    "shift": lambda v: v + [3, -2, 0.1],
    "noise": lambda v: v + RNG.normal(0, 0.1, v.shape),
    "scattered": lambda v: RNG.permutation(v),
    "reflected": lambda v: v * [1, -1, 1],
    "flattened": lambda v: v * [1, 0, 1],
    "in a point": lambda v: 0 * v + 0.25,
    "half in a point": part_in_a_point,
    "tiny": lambda v: v * 1e-12,
    "huge": lambda v: v * 1e12,
}


@pytest.fixture(scope="module", params=[("float32", "sah"), ("float64", "median")], ids="-".join)
def kind(request):
    return request.param


def same(bvh, new):
    """Whether two trees have the same triangles, and rays the same answers."""
    scale = float(np.abs(new.vertices).max()) or 1.0
    o, d = O * scale, D
    bvh.validate()
    assert np.array_equal(bvh.triangles, new.triangles, equal_nan=True)
    assert rays.same_hits(bvh.closest_hit(o, d), new.closest_hit(o, d))
    assert np.array_equal(bvh.any_hit(o, d), new.any_hit(o, d))
    assert bvh.stats.triangles == new.stats.triangles
    return (new.closest_hit(o, d).prim_id >= 0).mean()


def test_answers_are_those_of_a_new_tree_and_come_back(kind):
    bvh = rt.BVH(VERTICES, FACES, *kind)
    before = copy.copy(bvh)
    hit = {}
    for name, motion in MOTIONS.items():
        moved = motion(VERTICES)
        bvh.refit(moved)
        hit[name] = same(bvh, rt.BVH(moved, FACES, *kind))
        assert bvh.precision == kind[0]
    assert hit["in a point"] == hit["flattened"] * 0
    assert min(hit["noise"], hit["scattered"], hit["half in a point"], hit["tiny"], hit["huge"]) > 0.05
    bvh.refit(VERTICES)
    same(bvh, before)
    assert np.array_equal(bvh.tree.leaves.prim_id, before.tree.leaves.prim_id)  # the bits of all that leaves have
    assert np.array_equal(boxes_of(bvh.tree.nodes), boxes_of(before.tree.nodes))
    assert np.array_equal(children_of(bvh.tree.nodes), children_of(before.tree.nodes))
    assert bvh.stats == before.stats


def test_the_growth_of_the_cost_is_relative_to_the_tree_as_built():
    bvh = rt.BVH(VERTICES, FACES)
    cost = bvh.stats.sah_cost
    assert bvh.stats.growth == 1
    for _ in range(2):
        moved = RNG.permutation(VERTICES)
        bvh.refit(moved)
        assert bvh.stats.growth == bvh.stats.sah_cost / cost > 2
    assert rt.BVH(moved, FACES).stats.growth == 1


def test_leaves_keep_their_kind():
    moved = VERTICES * [1, -1, 2]
    bvh = rt.BVH(VERTICES, FACES, triangle="moller-trumbore")
    bvh.refit(moved)
    bvh.validate()
    new = rt.BVH(moved, FACES, triangle="moller-trumbore")
    assert type(bvh.tree.leaves) is type(new.tree.leaves)
    assert np.array_equal(bvh.triangles, new.triangles)


@pytest.mark.parametrize("count", [1, 64, 65])
def test_triangles_that_gain_an_area_are_hit(count):
    flat = np.zeros((3 * count, 3))
    moved = RNG.normal(0, 1, flat.shape)
    some = np.where(np.arange(3 * count)[:, None] % 6 < 3, moved, flat)
    faces = np.arange(3 * count).reshape(-1, 3)
    bvh = rt.BVH(flat, faces)
    for vertices in (some, moved, flat, moved):
        bvh.refit(vertices)
        same(bvh, rt.BVH(vertices, faces))


def test_refitted_trees_are_copied_and_pickled():
    bvh = pickle.loads(pickle.dumps(rt.BVH(VERTICES, FACES)))
    bvh.refit(VERTICES + 1)
    kept = copy.copy(bvh)
    again = pickle.loads(pickle.dumps(bvh))
    again.refit(VERTICES * 2)
    same(again, rt.BVH(VERTICES * 2, FACES))
    same(bvh, rt.BVH(VERTICES + 1, FACES))
    bvh.refit(VERTICES)
    same(kept, rt.BVH(VERTICES + 1, FACES))


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (VERTICES[:-1], "expected 192 rows, as many as the mesh has, got 191"),
        (np.where(np.arange(len(VERTICES))[:, None] == 5, np.nan, VERTICES), "row 5 is not finite"),
        (VERTICES * 1e39, "not finite in float32.*precision='float64'"),
        (VERTICES * 1e-30, "largest coordinate"),
        (VERTICES[:, :2], r"\(n, 3\)"),
        (None, "numbers"),
    ],
)
def test_wrong_vertices_leave_the_tree_as_it_was(vertices, message):
    bvh = rt.BVH(VERTICES, FACES)
    bvh.refit(VERTICES + 1)
    tree, points = bvh.tree, bvh.vertices
    with pytest.raises(ValueError, match=f"^vertices: .*{message}"):
        bvh.refit(vertices)
    assert bvh.tree is tree
    assert bvh.vertices is points
    same(bvh, rt.BVH(VERTICES + 1, FACES))


def test_many_triangles_are_refitted_on_threads(monkeypatch):
    from raytrace.accel import refit

    monkeypatch.setattr(refit, "FACES", 40)
    monkeypatch.setattr(refit, "LEAVES", 3)
    moved = VERTICES * [1, 2, 1]
    bvh = rt.BVH(VERTICES, FACES)
    bvh.refit(moved)
    same(bvh, rt.BVH(moved, FACES))
