"""Hard rays through the tree, side by side and alone: no leak, the same bits, what exact arithmetic says."""

import functools

import numpy as np
import pytest

import exact
import rays
import raytrace as rt
from raytrace.accel.bundle import BUNDLE
from raytrace.accel.lanes import group_size, packet_width

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
NEAREST = 2.0**-10  # normals are rounded: where an origin lies in a triangle, t is only nearly 0
EVERY = [(name, precision) for name in rays.CLOSED for precision in PRECISIONS]


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize(("name", "precision"), EVERY)
def test_no_ray_leaks_out_of_a_closed_mesh(name, precision, split):
    make, inside = rays.CLOSED[name]
    mesh = make()
    o, d = rays.towards(inside, rays.edge_points(mesh, precision, seed=1))
    bvh = rt.BVH(*mesh, precision, split)
    for hits in rays.all_paths(bvh, o, d):
        assert np.count_nonzero(hits.prim_id < 0) == 0
    assert bvh.any_hit(o, d).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("move", [(0.0, 1e3), (1e4, 1.0), (1e-4, 1e-6), (0.0, 1e-15), (0.0, 1e15)])
def test_no_ray_leaks_wherever_the_mesh_lies_and_however_large_it_is(move, precision):
    shift, scale = move
    vertices, faces = rays.icosphere(2)
    mesh = vertices * scale + shift, faces
    o, d = rays.towards([[shift] * 3], rays.edge_points(mesh, precision, seed=2))
    bvh = rt.BVH(*mesh, precision)
    for hits in rays.all_paths(bvh, o, d):
        assert np.count_nonzero(hits.prim_id < 0) == 0


@pytest.mark.parametrize(("name", "precision"), EVERY)
def test_rays_side_by_side_and_alone_get_the_same_bits(name, precision):
    mesh = rays.CLOSED[name][0]()
    targets = rays.edge_points(mesh, precision, seed=3)[::7]
    o, d = rays.towards([[1.7, 0.4, -2.1], [-0.2, 2.5, 0.9]], targets)
    random = rays.anywhere(3000, seed=4)
    o, d = (np.concatenate([a, b.astype(precision)]) for a, b in zip((o, d), random, strict=True))
    bvh = rt.BVH(*mesh, precision)
    packed, *others = rays.all_paths(bvh, o, d)
    assert 0.1 < np.mean(packed.prim_id >= 0) < 1.0
    assert all(rays.same_hits(packed, hits) for hits in others)
    assert rays.same_hits(packed, bvh.closest_hit(o, d))


@pytest.mark.parametrize("triangle", ["watertight", "moller-trumbore"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_random_rays_side_by_side_and_alone_get_the_same_bits(precision, triangle):
    bvh = rt.BVH(*rays.soup(500, seed=5), precision, triangle=triangle)
    o, d = (a.astype(precision) for a in rays.anywhere(8000, seed=6))
    packed, *others = rays.all_paths(bvh, o, d)
    assert 0.3 < np.mean(packed.prim_id >= 0) < 1.0
    assert all(rays.same_hits(packed, hits) for hits in others)


@functools.cache
def lattice_scene():
    """Triangles and rays of small integers, and exact answers beyond t = NEAREST."""
    rng = np.random.default_rng(7)
    vertices = rng.integers(-2, 3, (24, 3)).astype(np.float64)
    faces = np.array([rng.choice(24, 3, replace=False) for _ in range(30)])
    o, d = rays.lattice(400, seed=8)
    expected = [exact.closest(vertices, faces, *ray, NEAREST) for ray in zip(o, d, strict=True)]
    kinds = {crossings[tied[0]].kind for t, tied, crossings in expected if t is not None}
    assert kinds == {"interior", "edge", "vertex"}
    return vertices, faces, o, d, expected


@pytest.mark.parametrize("precision", PRECISIONS)
def test_lattice_rays_hit_what_exact_arithmetic_says(precision):
    """Boxes touch, rays run in their planes and meet edges and vertices; nothing is rounded, so nothing is excused."""
    vertices, faces, o, d, expected = lattice_scene()
    bvh = rt.BVH(vertices, faces, precision)
    eps = np.finfo(precision).eps
    for hits in rays.all_paths(bvh, o.astype(precision), d.astype(precision), NEAREST):
        for i, (t, tied, crossings) in enumerate(expected):
            assert (hits.t[i] < np.inf) == (t is not None), (o[i], d[i])
            if t is None:
                continue
            # distances that are equal may differ by a rounding, as they come from different planes
            assert hits.prim_id[i] in tied
            crossing = crossings[hits.prim_id[i]]
            got = [hits.t[i], hits.u[i], hits.v[i]]
            np.testing.assert_allclose(got, [float(t), float(crossing.u), float(crossing.v)], rtol=8 * eps, atol=eps)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_along_axes_meet_vertices_whatever_the_signs_of_their_zeros(precision):
    vertices, faces = rays.grid(16)
    for axis in range(3):
        bvh = rt.BVH(np.roll(vertices, axis, axis=1), faces, precision)
        directions = rays.signed_axes().astype(precision)
        directions = directions[directions[:, (2 + axis) % 3] != 0]  # across the plane
        targets = np.roll(vertices[((vertices > 0) & (vertices < 16))[:, :2].all(axis=1)], axis, axis=1).astype(
            precision
        )
        o, d = (a.reshape(-1, 3) for a in np.broadcast_arrays(targets[:, None] - 3 * directions, directions))
        for hits in rays.all_paths(bvh, o, d):
            assert (hits.t == 3).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_in_the_planes_of_boxes_leave_a_cube_of_small_cubes(precision):
    """Every ray from a lattice point inside, along lattice directions, must meet the shell."""
    vertices, faces = rays.cube()
    cells = np.array(np.meshgrid(*[np.arange(-2.0, 3.0)] * 3)).reshape(3, -1).T
    corners = (vertices * 0.5 + cells[:, None]).reshape(-1, 3)
    bvh = rt.BVH(corners, (faces + 8 * np.arange(len(cells))[:, None, None]).reshape(-1, 3), precision)
    o, d = rays.lattice(4000, seed=9)
    o = np.clip(o, -2, 2) + np.random.default_rng(10).choice([-0.5, 0.0, 0.5], o.shape)
    inside = (np.abs(o) < 2.5).all(axis=1)
    for hits in rays.all_paths(bvh, o[inside].astype(precision), d[inside].astype(precision)):
        assert (hits.prim_id >= 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_interior_and_misses_agree_with_exact_arithmetic(precision):
    rng = np.random.default_rng(11)
    eps = np.finfo(precision).eps
    seen = {"interior": 0, "miss": 0}
    for _ in range(150):
        triangle = rng.normal(size=(3, 3)).astype(precision)
        target = rng.dirichlet([0.5] * 3, 6) @ triangle + rng.choice([0.0, 0.05], (6, 1)) * rng.normal(size=(6, 3))
        o = (3 * rng.normal(size=(6, 3))).astype(precision)
        d = (target - o).astype(precision)
        got = rt.BVH(triangle, [[0, 1, 2]], precision).any_hit(o, d)
        size = np.abs(np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])).max()
        for i in range(6):
            crossing = exact.classify(triangle, o[i], d[i])
            if crossing.t is None or crossing.kind not in seen:
                continue
            weights = [float(w) for w in (1 - crossing.u - crossing.v, crossing.u, crossing.v)]
            cosine = (
                abs(np.dot(np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0]), d[i])) / np.abs(d[i]).max()
            )
            # sheared vertices are off by a few eps of |v - o| < 16; weights by that, over the height seen by the ray
            if min(abs(w) for w in weights) < 1000 * eps * (1 + size) / cosine:
                continue
            seen[crossing.kind] += 1
            assert got[i] == (crossing.kind == "interior" and crossing.t > 0)
    assert min(seen.values()) > 100


@pytest.mark.parametrize("precision", PRECISIONS)
def test_neighbours_of_extreme_lengths_change_nothing(precision):
    bvh = rt.BVH(*rays.torus(30, 15), precision)
    o, d = (a.astype(precision) for a in rays.anywhere(2000, seed=12))
    order = np.argsort(rays.octant_and_axis(d), kind="stable")
    o, d = o[order], d[order]
    hits = bvh.closest_hit(o, d)
    for power in (-90, -40, 25, 60):
        scale = np.where(np.arange(2000) % 5 == 0, 2.0**power, 1).astype(precision)
        mixture = bvh.closest_hit(o, d * scale[:, None])
        assert rays.same_hits(mixture, hits._replace(t=hits.t / scale))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("precision", PRECISIONS)
def test_every_ray_of_a_narrow_bundle_hits_however_many_there_are(precision, axis, sign):
    """Parallel rays straight at a large triangle, with another far behind it: so narrow that they go as bundles."""
    triangle = np.array([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]])
    vertices = np.roll(np.concatenate([triangle, triangle - [0.0, 0.0, 50.0]]) * sign, axis, axis=1)
    bvh = rt.BVH(vertices, np.arange(6).reshape(2, 3), precision)
    for n in (*range(1, 40), 63, 64, 65, 127, 128, 129):
        o = np.zeros((n, 3))
        o[:, 0], o[:, 2] = np.linspace(-0.1, 0.1, n), 5.0
        o, d = np.roll(o * sign, axis, axis=1), np.roll(np.tile([0.0, 0.0, -sign], (n, 1)), axis, axis=1)
        hits = bvh.closest_hit(o, d)
        assert (hits.prim_id == 0).all()
        assert (hits.t == 5.0).all()
        assert bvh.any_hit(o, d).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_bundles_and_packets_share_their_way_and_others_go_alone(precision):
    """What the tests above stand on: nodes are counted once for a bundle, a packet, or a ray that goes alone."""
    bvh = rt.BVH(*rays.cube(), precision)  # of one node
    d = np.tile(np.array([[1.0, 0.5, 0.25]], precision), (BUNDLE * rays.PACKET, 1))

    def visited(query, **limits):
        work = bvh.work()
        bvh.work = lambda: work
        query(bvh, 0 * d, d, **limits)
        del bvh.work
        return work.counts[0]

    width = packet_width(bvh.triangles)
    assert visited(rays.packed) == len(d) // (group_size(bvh.triangles) * width)
    assert visited(rays.packed, tmin=-1.0) == len(d) // width  # a frustum begins where its rays do
    assert visited(rays.mixed) >= len(d)
    assert visited(rays.bundled) == len(d)
