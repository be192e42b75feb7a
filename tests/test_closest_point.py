"""Closest points and signed distances: exact arithmetic, a plain twin, and the same bits however they are computed."""

from functools import cache

import numpy as np
import pytest

import exact_points
import raytrace as rt
from rays import same_bits
from raytrace.accel import nearest
from raytrace.hardcases import meshes
from raytrace.jit import PLAIN

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
COUNT = 4 if PLAIN else 48


def tree(corners, precision, **options):
    return rt.BVH(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), precision, **options)


@cache
def ball():
    return meshes.icosphere(4)


def around(n, seed=1):
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (n, 3))


def equal(first, second):
    return all(same_bits(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e12])
def test_points_distances_and_ties_are_those_of_exact_arithmetic(precision, scale):
    for seed, name in enumerate(exact_points.MESHES):
        corners = exact_points.usable(name, scale, precision)
        points = exact_points.aimed(corners, COUNT, seed, precision)
        verdict = exact_points.judge(corners, points, tree(corners, precision).closest_point(points), precision)
        assert verdict.p <= 4, name
        assert verdict.distance <= 4, name
        assert (verdict.not_rounded, verdict.not_lowest) == (0, 0), name


@pytest.mark.parametrize("precision", PRECISIONS)
def test_extreme_meshes_and_points(precision):
    """Smallest and largest meshes, tiny triangles in a large mesh, points whose squared distance overflows."""
    kind = np.finfo(precision)
    small, large = np.sqrt(float(kind.smallest_normal) / float(kind.eps)), np.sqrt(float(kind.max)) / 17
    cube = exact_points.usable("cube", 1.0, precision)
    cases = [(cube * small, 1.0), (cube * large, 1.0), (cube, 1e-3 / small), (cube, float(kind.max) / 8)]
    tiny = np.concatenate([cube, cube * np.sqrt(small), cube * small])  # within each other
    for corners, away in [*cases, (tiny, 1.0)]:
        corners = corners.astype(precision)
        points = exact_points.aimed(corners, COUNT // 3, 7, precision)
        points[::2] = (around(len(points[::2])) * np.abs(corners).max() * away).astype(precision)
        verdict = exact_points.judge(corners, points, tree(corners, precision).closest_point(points), precision)
        assert verdict.p <= 4
        assert verdict.distance <= 4
        assert verdict.not_lowest == 0


@pytest.mark.skipif(PLAIN, reason="too slow without machine code")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_no_triangle_is_lost_in_a_larger_mesh(precision):
    """The plain twin looks at every triangle; sorted points, threads and other trees give the same bits."""
    bvh = rt.BVH(*ball(), precision)
    points = around(4000).astype(precision)
    found = bvh.closest_point(points)
    corners = bvh.vertices[bvh.faces].astype(np.float64)
    for part in np.array_split(np.arange(120), 4):
        squares = exact_points.approximate(points[part].astype(np.float64), corners)
        assert np.allclose(np.sqrt(squares.min(axis=1)), found.distance[part], rtol=0, atol=4 * np.finfo(precision).eps)
    assert equal(found, bvh.closest_point(points, threads=2))
    assert equal(found, rt.BVH(*ball(), precision, "median").closest_point(points))
    backwards = bvh.closest_point(points[::-1])
    assert equal(found, [column[::-1] for column in backwards])
    alone = [bvh.closest_point(point) for point in points[:20]]
    assert equal([column[:20] for column in found], [np.concatenate(columns) for columns in zip(*alone, strict=True)])


def test_many_triangles_at_the_same_distance():
    """All triangles of a fan touch its top: more than there is room for at once, in whatever order."""
    vertices, faces = meshes.fan(3 * nearest.CANDIDATES if not PLAIN else 12)
    faces = faces[::-1]
    found = rt.BVH(vertices, faces).closest_point(vertices[0] + [0, 0, 1])
    assert found.prim_id == np.flatnonzero((faces == 0).any(axis=1))[0]
    assert np.array_equal(found.p[0], vertices[0].astype(np.float32))
    assert found.distance == 1.0


def test_neighbours_that_list_their_corners_in_another_order_tie():
    """Points so near an edge through the origin that only identical arithmetic gives identical distances."""
    side = np.round(np.array([0.1234567, 0.7654321, -0.3141593]) * 2**40) / 2**40
    corners = np.array([-3 * side, 5 * side, [0.4, 1.1, 0.6], [0.9, -0.8, 0.5]])
    points = np.concatenate([1e-24 * around(COUNT), around(COUNT)])
    first = rt.BVH(corners, [[0, 1, 3], [0, 1, 2]], "float64").closest_point(points)
    assert first.distance[:COUNT].max() < 4e-24
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]):
        faces = [np.take([0, 1, 2], order), [1, 0, 3], np.take([0, 1, 2], order[::-1])]
        found = rt.BVH(corners, faces, "float64").closest_point(points)
        assert np.array_equal(found.distance, first.distance)
        assert not (found.prim_id == 2).any()
        assert (found.prim_id[:COUNT] == 0).mean() > 0.3  # the distance of the edge, which both have, is the lowest
        assert np.array_equal(found.p, first.p)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_weights_give_the_point(precision):
    bvh = rt.BVH(*ball(), precision)
    found = bvh.closest_point(around(50 if not PLAIN else 2))
    v0, v1, v2 = bvh.vertices[bvh.faces[found.prim_id]].swapaxes(0, 1)
    u, v = found.u[:, None], found.v[:, None]
    assert np.allclose((1 - u - v) * v0 + u * v1 + v * v2, found.p, rtol=0, atol=8 * np.finfo(precision).eps)
    assert ((u >= 0) & (v >= 0) & (u + v <= 1 + 4 * np.finfo(precision).eps)).all()


def test_answers_have_the_leading_shape_of_the_points():
    bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    for shape, answer in (((3,), (1,)), ((5, 3), (5,)), ((2, 4, 3), (2, 4)), ((0, 3), (0,)), ((2, 0, 3), (2, 0))):
        found = bvh.closest_point(np.ones(shape))
        assert found.p.shape == (*answer, 3)
        assert all(column.shape == answer for column in found[1:])
        assert [column.dtype for column in found] == ["f4", "f4", "i4", "f4", "f4"]
    points = around(24).reshape(2, 4, 3, 3)
    strided = np.asfortranarray(points)[:, ::2].astype(">f8")
    assert equal(bvh.closest_point(points[:, ::2]), bvh.closest_point(strided))
    assert bvh.closest_point([]).distance.shape == (0,)


@pytest.mark.parametrize("points", [[1, 2], np.ones((3, 2)), 5.0, "abc", np.ones(3, complex)])
def test_what_is_not_an_array_of_points_is_refused(points):
    bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(ValueError, match=r"^points: expected "):
        bvh.closest_point(points)


def test_without_a_closest_point():
    """Meshes without an area, and points that are not finite in the precision of the tree."""
    flat = rt.BVH([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [1, 1, 0]])
    for bvh in (flat, rt.BVH(np.zeros((0, 3)), np.zeros((0, 3), int))):
        found = bvh.closest_point([[0, 0, 1], [0, 0, 0]])
        assert np.isposinf(found.distance).all()
        assert (found.prim_id == -1).all()
        assert np.isnan([*found.p[0], found.u[0], found.v[0]]).all()
    bvh = rt.BVH([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[3, 3, 3], [0, 1, 2]])
    found = bvh.closest_point([[np.nan, 0, 0], [0, -np.inf, 0], [0, 0, 1e39], [5, 5, 5]])
    assert np.isnan(found.distance[:3]).all()
    assert found.prim_id.tolist() == [-1, -1, -1, 1]  # triangles without area are ignored


def test_the_sign_is_negative_inside_and_zero_on_the_surface(monkeypatch):
    bvh = rt.BVH(*meshes.cube())
    if not hasattr(bvh, "contains"):
        monkeypatch.setattr(rt.BVH, "contains", lambda _, p, threads: (np.abs(p) <= 1).all(axis=-1), raising=False)
    points = np.array([[[0, 0, 0], [0.75, 0, 0]], [[1, 0.5, 0.25], [3, 0, 0]], [[1, 1, 1], [2, 2, 1]]])
    distance = bvh.signed_distance(points)
    assert distance.dtype == np.float32
    assert np.array_equal(distance, np.float32([[-1, -0.25], [0, 2], [0, np.sqrt(2)]]))
    assert not np.signbit(distance[1:, 0]).any()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_signed_distance_has_a_sign_next_to_the_surface(precision):
    """The smallest step from a face rounds to the distance 0, but the point is not on the surface."""
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    bvh = rt.BVH(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], precision=precision)
    step = np.finfo(precision).smallest_subnormal
    distance = bvh.signed_distance([[step, 0.25, 0.25], [0, 0.25, 0.25], [-step, 0.25, 0.25]])
    assert np.sign(distance).tolist() == [-1, 0, 1]
    assert np.abs(distance).max() < 1e-30
