"""Points on surfaces: how near the truth, and that rays from them never meet what they left."""

from fractions import Fraction

import numpy as np
import pytest

import exact
import naive
import rays
import raytrace as rt
from raytrace.passes.surface import surface
from raytrace.records import DIFFUSE, REFRACTIVE, Hits, Mesh, Points, Shading

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
PLACES = [(0.0, 1.0), (0.0, 1e-6), (0.0, 1e-3), (0.0, 1e3), (0.0, 1e6), (1e4, 1.0), (-1e4, 0.01), (1.0, 1e-3)]


def placed(count, place, seed, precision):
    """Triangles (count, 3, 3) of all shapes, some very long or along an axis, of a size, at a place."""
    rng = np.random.default_rng(seed)
    shift, scale = place
    corners = rng.normal(size=(count, 3, 3))
    corners[::4, 2] = corners[::4, 0] + 0.02 * (corners[::4, 2] - corners[::4, 0])  # slivers
    corners[1::4, :, 1] = 0.3  # in a plane of constant y
    corners[2::8, :, 1:] *= 1e-4  # along an axis
    large = corners[3::8] - corners[3::8].mean(axis=1, keepdims=True)  # 200 wide, its plane 1/1000 from the origin
    flat = np.cross(large[:, 1] - large[:, 0], large[:, 2] - large[:, 0])
    corners[3::8] = 100 * large + 1e-3 * (flat / np.linalg.norm(flat, axis=1, keepdims=True))[:, None]
    return (scale * corners + shift * np.array([1.0, -0.7, 0.4])).astype(precision)


def hits_on(bvh, corners, n, seed):
    """n rays at points of a triangle from both sides of it: those that hit, their directions."""
    rng = np.random.default_rng(seed)
    size = np.abs(corners - corners[0]).max()
    targets = rng.dirichlet([1] * 3, n) @ corners
    o = targets + size * rng.normal(size=(n, 3))
    d = (targets - o).astype(corners.dtype)
    hits = bvh.closest_hit(o.astype(corners.dtype), d)
    found = hits.prim_id == 0
    return Hits(*(column[found] for column in hits)), d[found]


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("place", PLACES)
def test_p_is_within_its_error_of_the_exact_point_and_plane(place, precision):
    checked, nearest = 0, 0.0
    for k, corners in enumerate(placed(12, place, 1, precision)):
        bvh = rt.BVH(corners, [[0, 1, 2]], precision)
        hits, _ = hits_on(bvh, corners, 12, k)
        found = bvh.surface(hits)
        v0, v1, v2 = (exact.exact(corner) for corner in corners)
        normal = exact.cross(exact.sub(v1, v0), exact.sub(v2, v0))
        length = Fraction(float(exact.dot(normal, normal)) ** 0.5)
        for u, v, p, error, ng in zip(hits.u, hits.v, *found, strict=True):
            u, v = Fraction(float(u)), Fraction(float(v))
            p, error = exact.exact(p), exact.exact(error)
            for axis in range(3):
                point = (1 - u - v) * v0[axis] + u * v1[axis] + v * v2[axis]
                assert abs(p[axis] - point) <= error[axis]
                nearest = max(nearest, float(abs(p[axis] - point) / error[axis]))
            off = abs(exact.dot(normal, exact.sub(p, v0))) / length
            assert off <= exact.dot(exact.exact(np.abs(ng)), error)
            checked += 1
    assert checked > 50
    assert nearest > 0.01  # the bound is not just huge


@pytest.mark.parametrize("precision", PRECISIONS)
def test_surfaces_of_misses_are_nan(precision):
    bvh = rt.BVH(*rays.torus(20, 10), precision)
    hits = bvh.closest_hit(*rays.anywhere(500, seed=2))
    for column in bvh.surface(hits):
        assert column.dtype == precision
        assert np.array_equal(np.isnan(column).all(axis=1), hits.prim_id < 0)
        assert np.array_equal(np.isnan(column).any(axis=1), hits.prim_id < 0)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_normals_are_unit_and_follow_the_winding(precision):
    vertices, faces = rays.icosphere(2)
    bvh = rt.BVH(vertices, faces, precision)
    found = bvh.surface(bvh.closest_hit([0, 0, 0], np.random.default_rng(3).normal(size=(500, 3))))
    eps = np.finfo(precision).eps
    np.testing.assert_allclose(np.linalg.norm(found.ng.astype(np.float64), axis=1), 1, atol=2 * eps)
    assert ((found.ng * found.p).sum(axis=1) > 0.9).all()  # seen from inside, they point outwards all the same


def leaving(ng, corners, p, seed):
    """Directions on the side of ng: anywhere, grazing, and grazing along the triangle itself."""
    rng = np.random.default_rng(seed)
    any_way = rng.normal(size=(12, *ng.shape))
    along = rng.dirichlet([1] * 3, (12, len(p))) @ corners.astype(np.float64) - p
    along /= np.linalg.norm(along, axis=2, keepdims=True) + 1e-300
    lift = 10.0 ** rng.uniform(-7, -1, (12, len(p), 1))
    d = np.concatenate([any_way, along + lift * ng, any_way - naive.dot(any_way, ng)[..., None] * ng * (1 - lift)])
    return np.where(naive.dot(d, ng)[..., None] < 0, -1.0, 1.0) * d


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("place", PLACES)
def test_a_ray_that_leaves_a_triangle_never_meets_it_again(place, precision):
    tried = 0
    for k, corners in enumerate(placed(40, place, 4, precision)):
        bvh = rt.BVH(corners, [[0, 1, 2]], precision)
        hits, _ = hits_on(bvh, corners, 12, k)
        p, p_error, ng = bvh.surface(hits)
        for side in (ng, -ng):
            d = leaving(side.astype(np.float64), corners, p.astype(np.float64), seed=k).astype(precision)
            o = rt.spawn_ray(*(np.broadcast_to(a, d.shape) for a in (p, p_error, ng)), d)
            assert o.dtype == precision
            again = bvh.any_hit(o.reshape(-1, 3), d.reshape(-1, 3))
            assert not again.any(), (corners, o.reshape(-1, 3)[again], d.reshape(-1, 3)[again])
            tried += again.size
    assert tried > 20_000


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_ray_that_goes_through_a_thin_wall_meets_its_other_side(precision):
    """Origins are pushed by so little that a wall of a thousandth of its own size is not skipped."""
    front = np.array([[0.0, 0, 0], [3, 0, 1], [0, 3, 1]])
    back = front - [0, 0, 3e-3]
    bvh = rt.BVH(np.concatenate([front, back]), [[0, 1, 2], [3, 4, 5]], precision)
    rng = np.random.default_rng(5)
    d = (rng.dirichlet([2] * 3, 500) @ front - [1, 1, 5]).astype(precision)
    hits = bvh.closest_hit([1, 1, 5], d)
    assert (hits.prim_id == 0).all()
    found = bvh.surface(hits)
    assert (bvh.closest_hit(rt.spawn_ray(*found, d), d).prim_id == 1).mean() > 0.99  # a few pass its edge


# --- the pass --------------------------------------------------------------------------------------------------------


def scene_of(precision, smooth):
    """A soup of diffuse, two-sided and refractive triangles, for the twin and for the kernel; rays and hits."""
    vertices, faces = rays.soup(60, seed=6)
    vertices = vertices.astype(precision)
    rng = np.random.default_rng(7)
    bvh = rt.BVH(vertices, faces, precision)
    corners = vertices.astype(np.float64)[faces]
    flat = naive.unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normals = naive.unit(flat[:, None] + 0.3 * rng.normal(size=(60, 3, 3))) if smooth else None
    material = rng.integers(0, 3, 60).astype(np.int32)
    mesh = Mesh(vertices.astype(np.float64), faces, normals, material, np.zeros(60, np.int32))
    table = np.array([[0.5, 0.5, 0.5, 1, 0, DIFFUSE], [0.5, 0.5, 0.5, 1, 1, DIFFUSE], [1, 1, 1, 1.5, 0, REFRACTIVE]])
    shading = Shading(bvh.triangles.ravel(), material, table.astype(precision).ravel())
    o, d = rays.anywhere(1024, seed=8)
    d = naive.unit(d).astype(precision)
    t, prim_id, u, v = naive.closest_hit(mesh.vertices, faces, o, d)
    return mesh, shading, d, Hits(t.astype(precision), prim_id, u.astype(precision), v.astype(precision))


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_pass_gives_the_twins_points_and_says_what_can_be_lit(precision, smooth):
    mesh, shading, d, hits = scene_of(precision, smooth)
    n, eps = len(d), np.finfo(precision).eps
    ng = np.full(3 * n, np.nan, precision)
    ns = np.full(3 * n, np.nan, precision) if smooth else ng
    points = Points(np.empty(3 * n, precision), ng, ns, np.empty(n, precision), np.empty(n, np.int32))
    normals = None if mesh.normals is None else mesh.normals.astype(precision).ravel()
    surface(shading, normals, d.T.ravel().copy(), hits, points)

    found = np.flatnonzero(hits.prim_id >= 0)
    twin = Hits(*(column[found].astype(np.float64) if column.dtype.kind == "f" else column[found] for column in hits))
    p, p_error, expected_ng, expected_ns = naive.surface(mesh, twin)
    front = naive.dot(d[found].astype(np.float64), expected_ng) < 0
    material = mesh.material_id[twin.prim_id]
    lit = np.full(n, False)
    lit[found] = (front & (material == 0)) | (material == 1)
    assert np.array_equal(points.offset >= 0, lit)
    assert (points.offset[~lit] == -1).all()
    assert 0.1 < lit.mean() < 0.9
    assert np.array_equal(points.material_id[found], material)
    side = np.where(front, 1.0, -1.0)[:, None]
    np.testing.assert_allclose(points.p.reshape(3, n).T[found], p, atol=8 * eps)  # coordinates up to 3
    np.testing.assert_allclose(points.ng.reshape(3, n).T[found], side * expected_ng, atol=2 * eps)
    # corners' normals are rounded, and their sum may be shorter than 1
    np.testing.assert_allclose(points.ns.reshape(3, n).T[found], side * expected_ns, atol=16 * eps)
    reach = naive.dot(np.abs(expected_ng), p_error) * (eps / np.finfo(np.float64).eps)
    np.testing.assert_allclose(points.offset[lit], reach[lit[found]], rtol=1e-5)
    assert rays.same_bits(points.offset[lit], points.offset[lit].astype(precision))
