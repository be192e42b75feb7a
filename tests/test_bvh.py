"""``BVH`` against the twin that tries every triangle, and all that its door promises."""

from itertools import cycle

import numpy as np
import pytest

import naive
import rays
import raytrace as rt

PRECISIONS = ("float32", "float64")
FLOOR = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])  # z = 0
MESHES = {
    "soup": lambda: rays.soup(200, seed=1),
    "slivers": lambda: rays.soup(200, seed=2, size=2.0),
    "grid": lambda: (rays.grid(8)[0] / 4 - 1, rays.grid(8)[1]),
    "torus": lambda: rays.torus(16, 8),
}


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", MESHES)
def test_closest_hit_is_the_twins(name, precision, split):
    vertices, faces = MESHES[name]()
    vertices, o, d = rays.rounded(precision, vertices, *rays.anywhere(2000, seed=3))
    hits = rt.BVH(vertices, faces, precision, split).closest_hit(o, d)
    expected = naive.closest_hit(vertices, faces, o, d)
    eps = np.finfo(precision).eps
    weight, cosine, _ = rays.condition((vertices, faces), o, d)
    # sheared vertices are off by eps of at most |v - o| < 16, their areas by that times the height seen by the ray
    clear = (weight * cosine > 1e4 * eps).all(axis=1)
    assert clear.mean() > 0.1
    assert np.mean(expected.prim_id[clear] >= 0) > 0.05
    same = hits.prim_id == expected.prim_id
    # one of two triangles at nearly the same place is as good as the other
    crossing = np.isfinite(hits.t) & np.isclose(hits.t, expected.t, rtol=100 * eps, atol=0)
    assert (same | crossing)[clear].all()
    found = clear & same & (hits.prim_id >= 0)
    steep = cosine[found, hits.prim_id[found]] * np.linalg.norm(d[found], axis=1)
    np.testing.assert_array_less(np.abs(hits.t[found] - expected.t[found]), 32 * eps / steep)
    for got, twin in ((hits.u, expected.u), (hits.v, expected.v)):
        np.testing.assert_allclose(got[found], twin[found], atol=1e-3 if precision == "float32" else 1e-11)


@pytest.mark.parametrize("triangle", ["watertight", "moller-trumbore"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_any_hit_is_a_closest_hit_within_the_same_interval(precision, triangle):
    bvh = rt.BVH(*rays.soup(300, seed=5), precision, triangle=triangle)
    o, d = (a.astype(precision) for a in rays.anywhere(4000, seed=6))
    t = bvh.closest_hit(o, d).t
    some = np.where(np.isfinite(t), t, 1)
    rng = np.random.default_rng(7)
    ends = [0 * some, some, np.nextafter(some, 0), np.nextafter(some, 9), some * rng.uniform(0, 2, some.shape), -some]
    for tmin in ends:
        for tmax in [*ends, np.full_like(some, np.inf)]:
            tmin, tmax = tmin.astype(precision), tmax.astype(precision)
            hits = bvh.closest_hit(o, d, tmin, tmax)
            assert np.array_equal(bvh.any_hit(o, d, tmin, tmax), hits.prim_id >= 0)
            assert np.array_equal(np.isfinite(hits.t), hits.prim_id >= 0)
            found = hits.prim_id >= 0
            assert ((tmin < hits.t) & (hits.t < tmax))[found].all()


# --- ties ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_of_ten_thousand_equal_triangles_the_first_is_hit(precision, split):
    vertices, faces = FLOOR
    far = np.concatenate([vertices + [0, 0, -1], vertices])
    bvh = rt.BVH(far, np.concatenate([[[0, 1, 2]] * 7, np.repeat(faces + 3, 10_000, axis=0)]), precision, split)
    o, d = np.random.default_rng(8).uniform(0.1, 1.0, (64, 3)), [0.0, 0.0, -1.0]
    for hits in rays.both_paths(bvh, o.astype(precision), np.tile(d, (64, 1)).astype(precision)):
        assert (hits.prim_id == 7).all()


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_of_overlapping_triangles_in_a_plane_the_first_is_hit(precision, split):
    rng = np.random.default_rng(9)
    corners = rng.integers(-8, 9, (400, 3, 3)).astype(np.float64)
    corners[..., 2] = rng.choice([0.0, 0.0, -1.0], (400, 1))
    vertices, faces = corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3)
    o = np.column_stack([rng.integers(-9, 10, (1000, 2)), np.full(1000, 2.0)])
    d = np.tile([0.0, 0.0, -1.0], (1000, 1))  # straight down: t is exactly 2 or 3
    expected = naive.closest_hit(vertices, faces, o, d)
    assert len(np.unique(expected.prim_id)) > 20
    bvh = rt.BVH(vertices, faces, precision, split)
    for hits in rays.both_paths(bvh, o.astype(precision), d.astype(precision)):
        assert np.array_equal(hits.prim_id, expected.prim_id)
        assert np.array_equal(hits.t, expected.t)


# --- one answer ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", PRECISIONS)
def test_answers_do_not_depend_on_batch_tree_or_threads(precision):
    mesh = rays.torus(30, 15)
    bvh = rt.BVH(*mesh, precision)
    o, d = (a.astype(precision) for a in rays.anywhere(1000, seed=10))
    hits, blocked = bvh.closest_hit(o, d), bvh.any_hit(o, d)
    assert 0.1 < blocked.mean() < 0.9
    order = np.random.default_rng(11).permutation(1000)
    assert rays.same_hits(rays.scattered(bvh.closest_hit(o[order], d[order]), order, 1000), hits)
    assert rays.same_hits(rt.BVH(*mesh, precision, "median").closest_hit(o, d), hits)
    for i in range(0, 1000, 9):
        assert rays.same_hits(bvh.closest_hit(o[i], d[i]), rt.Hits(*(column[i : i + 1] for column in hits)))
        assert bvh.any_hit(o[i], d[i])[0] == blocked[i]
    many = 40  # batches that are dealt to threads
    for threads in (1, 2, 5):
        more = bvh.closest_hit(np.tile(o, (many, 1)), np.tile(d, (many, 1)), threads=threads)
        assert rays.same_hits(more, rt.Hits(*(np.tile(column, many) for column in hits)))
        assert np.array_equal(
            bvh.any_hit(np.tile(o, (many, 1)), np.tile(d, (many, 1)), threads=threads), np.tile(blocked, many)
        )


@pytest.mark.parametrize("precision", PRECISIONS)
def test_distances_count_directions_of_any_length(precision):
    bvh = rt.BVH(*rays.torus(30, 15), precision)
    o, d = (a.astype(precision) for a in rays.anywhere(1000, seed=12))
    hits = bvh.closest_hit(o, d)
    found = hits.prim_id >= 0
    assert 0.1 < found.mean() < 0.9
    for power in (-70, -66, -30, -1, 1, 30, 66):
        scale = np.array(2.0**power, precision)
        scaled = bvh.closest_hit(o, d * scale)
        assert rays.same_hits(scaled, hits._replace(t=hits.t / scale))
        assert np.array_equal(bvh.any_hit(o, d * scale, tmax=2 / scale), bvh.any_hit(o, d, tmax=2))
    for length in (1e-20, 1e-7, 0.3, 1e20):
        scaled = bvh.closest_hit(o, d * np.array(length, precision))
        same = scaled.prim_id == hits.prim_id
        assert same.mean() > 0.99  # directions are rounded, so a ray at an edge may change sides
        # a rounding of d moves the hit by eps / cosine: grazing rays are few
        ratio = scaled.t[found & same] * length / hits.t[found & same]
        np.testing.assert_allclose(np.quantile(np.abs(ratio - 1), 0.9), 0, atol=20 * np.finfo(precision).eps)


def test_the_shortest_directions_still_hit():
    bvh = rt.BVH(*FLOOR)
    d = np.array([[0, 0, -1e-44], [0, 0, -1e-40], [0, 0, -1e-38]], np.float32)  # the first two are denormal
    o = np.array([1, 1, 1e-10], np.float32)
    np.testing.assert_allclose(bvh.closest_hit(o, d).t, o[2] / -d[:, 2].astype(np.float64), rtol=1e-6)
    double = rt.BVH(*FLOOR, "float64").closest_hit([1, 1, 1e-10], [[0, 0, -1e-310]])
    np.testing.assert_allclose(double.t, 1e300, rtol=1e-12)


# --- intervals and bad rays ------------------------------------------------------------------------------------------


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy tells of the 1 / 0 that kernels are meant to compute
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_interval_is_open(precision):
    bvh = rt.BVH(*FLOOR, precision)
    ray = [1, 1, 3], [0, 0, -4]  # meets the floor at exactly 0.75
    below, above = (float(np.nextafter(np.array(0.75, precision), end, dtype=precision)) for end in (0, 1))
    intervals = [(0.75, 9), (0, 0.75), (below, above), (below, 0.75), (0.75, above), (0.9, 0.6), (0.75, 0.75)]
    intervals += [(-np.inf, np.inf), (-5, 0), (0.76, np.inf), (np.nan, 9), (0, np.nan), (np.inf, -np.inf)]
    expected = [a < 0.75 < b for a, b in intervals]
    assert sum(expected) == 2
    tmin, tmax = np.array(intervals).T
    hits = bvh.closest_hit(*ray, tmin, tmax)
    assert hits.t.tolist() == [0.75 if hit else np.inf for hit in expected]
    assert bvh.any_hit(*ray, tmin, tmax).tolist() == expected


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_negative_tmin_finds_what_lies_behind(precision):
    bvh = rt.BVH(*FLOOR, precision)
    up = [1, 1, 3], [0, 0, 4]
    assert bvh.closest_hit(*up).prim_id[0] == -1
    assert bvh.closest_hit(*up, tmin=-1).t[0] == -0.75
    assert bvh.closest_hit(*up, tmin=-1, tmax=-0.5).t[0] == -0.75
    assert not bvh.any_hit(*up, tmin=-0.75)[0]


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_that_are_not_finite_or_have_no_direction_miss(precision):
    bvh = rt.BVH(*FLOOR, precision)
    o, d = rays.bad_rays()
    assert bvh.any_hit([1, 1, 1], [-1, -1, -1], threads=1)[0]
    hits = bvh.closest_hit(o, d)
    assert (hits.prim_id == -1).all()
    assert (hits.t == np.inf).all()
    assert not bvh.any_hit(o, d).any()
    good = np.resize([False, True, True], len(o))  # beside good ones, they stay alone
    o[good], d[good] = (1, 1, 1), (0, 0, -1)
    assert np.array_equal(bvh.any_hit(o, d), good)
    assert np.array_equal(bvh.closest_hit(o, d).t, np.where(good, 1, np.inf))


def test_hits_may_lie_beyond_all_numbers_only_if_they_are_misses():
    bvh = rt.BVH(*FLOOR)
    o, d = np.array([[1, 1, 1]], np.float32), np.array([[0, 0, -1e-40]], np.float32)  # t = 1e40
    hits = bvh.closest_hit(o, d)
    assert np.array_equal(hits.prim_id >= 0, np.isfinite(hits.t))
    assert np.array_equal(bvh.any_hit(o, d), np.isfinite(hits.t))


# --- what goes in ----------------------------------------------------------------------------------------------------


def layouts(a):
    """The same (n, 3) numbers in ever other memory."""
    n, dtype = len(a), a.dtype
    yield "list", a.tolist()
    yield "columns first", np.asfortranarray(a)
    yield "every second row", np.repeat(a, 2, axis=0)[::2]
    yield "every second column", np.repeat(a, 2, axis=1)[:, ::2]
    yield "backwards", a[::-1].copy()[::-1]
    yield "backwards in both", a[::-1, ::-1].copy()[::-1, ::-1]
    locked = a.copy()
    locked.flags.writeable = False
    yield "read-only", locked
    record = np.zeros(n, [("flag", "i1"), ("a", dtype, 3)])
    record["a"] = a
    yield "packed record", record["a"]
    record = np.zeros(n, [("a", dtype, 3), ("b", dtype)])
    record["a"] = a
    yield "aligned record", record["a"]
    memory = np.zeros(a.nbytes + 1, np.uint8)
    unaligned = memory[1:].view(dtype).reshape(n, 3)
    unaligned[:] = a
    yield "unaligned", unaligned
    yield "other byte order", a.astype(dtype.newbyteorder())


@pytest.mark.parametrize("precision", PRECISIONS)
def test_memory_layout_changes_nothing(precision):
    vertices, faces = rays.torus(12, 6)
    vertices = vertices.astype(precision)
    o, d = (a.astype(precision) for a in rays.anywhere(203, seed=13))
    o *= 0.5
    tmax = np.linspace(1, 3, 203).astype(precision)
    bvh = rt.BVH(vertices, faces, precision)
    hits, blocked = bvh.closest_hit(o, d, tmax=tmax), bvh.any_hit(o, d, tmax=tmax)
    assert 0.1 < blocked.mean() < 0.9
    others = dict(layouts(d))
    for (name, origins), limits in zip(
        layouts(o), cycle([tmax.tolist(), np.repeat(tmax, 3)[::3], tmax[::-1].copy()[::-1]]), strict=False
    ):
        assert rays.same_hits(bvh.closest_hit(origins, others[name], tmax=limits), hits), name
        assert rays.same_hits(bvh.closest_hit(origins, d, tmax=tmax), hits), name
        assert np.array_equal(bvh.any_hit(o, others[name], tmax=limits), blocked), name
    for name, points in layouts(vertices):
        assert rays.same_hits(rt.BVH(points, faces, precision).closest_hit(o, d, tmax=tmax), hits), name
    for kind in ("u1", "i2", ">i4", "u8"):
        assert rays.same_hits(rt.BVH(vertices, faces.astype(kind), precision).closest_hit(o, d, tmax=tmax), hits), kind


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64", "int8", "uint16", "int64"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_numbers_of_every_type_are_taken(precision, dtype):
    vertices, faces = FLOOR
    o, d = np.array([[1, 1, 8], [3, 3, 8]]), np.array([[0, 0, 4], [0, 0, 2]])
    bvh = rt.BVH(vertices.astype(dtype), faces, precision)
    hits = bvh.closest_hit(o.astype(dtype), d.astype(dtype), tmin=np.array(-9, "i2"), tmax=np.array([0, 0], "f2"))
    assert hits.t.tolist() == [-2.0, np.inf]
    assert [column.dtype for column in hits] == [precision, "int32", precision, precision]


def test_one_origin_one_direction_or_one_limit_are_shared():
    bvh = rt.BVH(*rays.soup(100, seed=14), "float64")
    o, d = rays.anywhere(50, seed=15)
    tmax = np.linspace(0.5, 3, 50)
    for origins, directions, limits in [
        (o[0], d, 2.0),
        (o[:1], d, [2.0]),
        (o, d[0], 2.0),
        (o, d[:1], tmax),
        (o[0], d[0], tmax),
    ]:
        full = (np.broadcast_to(origins, (50, 3)).copy(), np.broadcast_to(directions, (50, 3)).copy())
        expected = bvh.closest_hit(*full, tmax=np.broadcast_to(limits, 50).copy())
        assert rays.same_hits(bvh.closest_hit(origins, directions, tmax=limits), expected)
        assert np.array_equal(bvh.any_hit(origins, directions, tmax=limits), expected.prim_id >= 0)


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_nothing_is_a_batch_and_a_mesh_too(precision):
    nothing = np.empty((0, 3))
    for bvh in (
        rt.BVH(*FLOOR, precision),
        rt.BVH(nothing, [], precision),
        rt.BVH(FLOOR[0], nothing.astype(int), precision),
    ):
        assert [len(column) for column in bvh.closest_hit(nothing, nothing)] == [0] * 4
        assert bvh.any_hit(nothing, [0, 0, -1]).shape == (0,)
        assert bvh.surface(bvh.closest_hit([0, 0, 0], nothing)).p.shape == (0, 3)
        hits = bvh.closest_hit([[1, 1, 1]], [[0, 0, -1]])
        assert hits.t.shape == (1,)
        assert bvh.any_hit([1, 1, 1], [0, 0, -1])[0] == (hits.prim_id[0] == 0) == (len(bvh.faces) == 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((FLOOR[0], [[0, 1, 2], [0, 1, 3]]), "faces: row 1 .*3 vertices"),
        ((FLOOR[0], [[0, 1, -1]]), "faces: row 0"),
        ((FLOOR[0], [[0.0, 1.0, 2.0]]), "faces: .*integers"),
        ((FLOOR[0], [[True, False, True]]), "faces: .*integers"),
        ((FLOOR[0], [[0, 1, 2, 0]]), r"faces: .*\(1, 4\)"),
        ((FLOOR[0], [0, 1, 2]), r"faces: .*\(3,\)"),
        (([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]]), "vertices: row 2 is not finite"),
        (([[0, 0, 0], [1, 0, 0], [0, -np.inf, 0]], [[0, 1, 2]]), "vertices: row 2 is not finite"),
        (([[0, 0, 0], [1e39, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "vertices: row 1 is not finite in float32"),
        (([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]]), r"vertices: .*\(3, 2\)"),
        (([[0, 0, 0], [1, 0]], [[0, 1, 0]]), "vertices: "),
        (([["a", "b", "c"]] * 3, [[0, 1, 2]]), "vertices: .*numbers"),
        ((FLOOR[0] * 1j, [[0, 1, 2]]), "vertices: .*numbers"),
        ((*FLOOR, "float16"), "precision: .*float32, float64.*float16"),
        ((*FLOOR, "float32", "best"), "split: .*sah, median.*best"),
        ((*FLOOR, "float32", "sah", "plane"), "triangle: .*watertight, moller-trumbore.*plane"),
    ],
)
def test_a_mesh_that_is_wrong_is_told_where(arguments, message):
    with pytest.raises(ValueError, match=message):
        rt.BVH(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((3, 3)), np.zeros((2, 3))), "origins.*3.*directions.*2"),
        ((np.zeros((3, 3)), np.zeros((0, 3))), "lengths"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(2)), "tmin.*2"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, np.zeros(4)), "tmax.*4"),
        ((np.zeros((3, 4)), np.zeros((3, 3))), r"origins: .*\(3, 4\)"),
        ((np.zeros((3, 3)), np.zeros(4)), r"directions: .*\(4,\)"),
        ((np.zeros((3, 3)), np.zeros((2, 3, 3))), r"directions: .*\(2, 3, 3\)"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 1))), r"tmin: .*\(3, 1\)"),
        (([[0, 0, 0], [0, 0]], np.zeros((2, 3))), "origins: "),
        (([["x", "y", "z"]], np.zeros((1, 3))), "origins: "),
        ((np.zeros((1, 3)), np.zeros((1, 3)) * 1j), "directions: "),
        ((np.zeros((1, 3)), np.zeros((1, 3)), "x"), "tmin: "),
        ((np.zeros((1, 3)), np.zeros((1, 3)), 0.0, None), "tmax: "),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, 1.0, 0), "threads"),
        ((np.zeros((3, 3)), np.zeros((3, 3)), 0.0, 1.0, -1), "threads"),
    ],
)
def test_rays_that_do_not_go_together_are_told_so(arguments, message):
    bvh = rt.BVH(*FLOOR)
    for query in (bvh.closest_hit, bvh.any_hit):
        with pytest.raises(ValueError, match=message):
            query(*arguments)
