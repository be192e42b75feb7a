"""All hits and crossings of rays: exact oracle, a twin with one tree per triangle, every path through the tree."""

import itertools
from fractions import Fraction

import numpy as np
import pytest

import exact
import rays
import raytrace as rt
from raytrace import memory
from raytrace.accel import expansions, hit_lists
from raytrace.accel.undecided import decide_pairs
from raytrace.errors import MemoryLimitError
from raytrace.hardcases import tracers
from raytrace.hardcases.closed_meshes import CLOSED_MESHES, aimed_points, aimed_rays
from raytrace.hardcases.query_oracle import INSIDE, SURFACE, HitJudge, inside_exactly
from raytrace.jit import interpreted

PRECISIONS = ["float32", "float64"]
COLUMNS = "t", "prim_id", "u", "v"
FLOOR = [[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 2]]


def some_rays(mesh, precision, seed=17):
    o, d = rays.anywhere(300, seed)
    aimed = rays.towards([[1.7, 0.4, -2.1], [0.01, 0.02, 0.03]], rays.edge_points(mesh, precision, 18)[::3])
    return tuple(np.concatenate(pair).astype(precision) for pair in zip((o, d), aimed, strict=True))


def same_lists(a, b):
    return all(rays.same_bits(x, y) for x, y in zip(a, b, strict=True))


def ray_of(hits):
    return np.repeat(np.arange(len(hits.start) - 1), np.diff(hits.start))


# --- all hits --------------------------------------------------------------------------------------------------------


@pytest.mark.engine
@pytest.mark.parametrize("precision", PRECISIONS)
def test_all_hits_are_those_of_every_triangle_on_its_own(precision):
    mesh = rays.soup(40, 5)
    bvh = rt.BVH(*mesh, precision)
    o, d = some_rays(mesh, precision)
    each = [rt.BVH(bvh.vertices, [face], precision).closest_hit(o, d, -1.0, 2.0) for face in bvh.faces]
    row, prim = np.nonzero(np.stack([hits.prim_id >= 0 for hits in each], axis=1))
    t, u, v = (np.stack([getattr(hits, name) for hits in each], axis=1)[row, prim] for name in ("t", "u", "v"))
    order = np.lexsort((prim, t, row))
    hits = bvh.all_hits(o, d, -1.0, 2.0)
    assert len(hits.t) > 500
    assert np.array_equal(ray_of(hits), row[order])
    assert all(np.array_equal(a, b[order]) for a, b in zip(hits[:4], (t, prim, u, v), strict=True))
    assert [column.dtype.name for column in hits] == [precision, "int32", precision, precision, "int64"]


@pytest.mark.engine
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_first_hit_is_the_closest_and_intervals_are_windows(precision):
    mesh = rays.icosphere(2)
    bvh = rt.BVH(*mesh, precision)
    o, d = some_rays(mesh, precision)
    for scale in (1.0, 2.0**-70, 2.0**60):
        whole = bvh.all_hits(o, d * np.array(scale, precision), -np.inf)
        number = np.diff(whole.start)
        picked = whole.t[np.minimum(whole.start[:-1], len(whole.t) - 1)]
        for tmin, tmax in ((0.0, np.inf), (picked, np.inf), (-np.inf, picked), (np.nextafter(picked, -np.inf), np.inf)):
            hits = bvh.all_hits(o, d * np.array(scale, precision), tmin, tmax)
            low, high = (np.broadcast_to(np.asarray(a, precision), len(o)) for a in (tmin, tmax))
            keep = (whole.t > low[ray_of(whole)]) & (whole.t < high[ray_of(whole)])
            assert all(rays.same_bits(getattr(hits, name), getattr(whole, name)[keep]) for name in COLUMNS)
            assert np.array_equal(np.diff(hits.start), np.bincount(ray_of(whole)[keep], minlength=len(number)))
            closest = bvh.closest_hit(o, d * np.array(scale, precision), tmin, tmax)
            found = closest.prim_id >= 0
            assert np.array_equal(found, np.diff(hits.start) > 0)
            first = hits.start[:-1][found]
            assert all(rays.same_bits(getattr(closest, name)[found], getattr(hits, name)[first]) for name in COLUMNS)


@pytest.mark.engine
@pytest.mark.parametrize("crossings", [False, True])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_every_path_through_the_tree_counts_the_same(precision, crossings):
    mesh = rays.torus(16, 10)
    bvh = rt.BVH(*mesh, precision)
    o, d = some_rays(mesh, precision)

    def ask(o, d, tmin=0.0, tmax=np.inf):
        return bvh.count_hits(o, d, tmin, tmax, crossings=crossings)

    expected = ask(o, d)
    assert expected.max() > 2
    for path in (tracers.packed, tracers.alone, tracers.bundled, tracers.shuffled):
        assert np.array_equal(path(ask, o, d), expected)
    many = -(-40_000 // len(o))
    tiled = [np.tile(a, (many, 1)) for a in (o, d)]
    whole = [bvh.all_hits(*tiled, crossings=crossings, threads=threads) for threads in (1, 2)]
    assert same_lists(*whole)
    assert np.array_equal(np.diff(whole[0].start), np.tile(expected, many))
    one = bvh.all_hits(o, d, crossings=crossings)
    assert all(rays.same_bits(np.tile(getattr(one, name), many), getattr(whole[0], name)) for name in COLUMNS)


def test_moller_trumbore_counts_too():
    bvh = rt.BVH(*FLOOR, triangle="moller-trumbore")
    assert bvh.count_hits([1, 1, 3], [0, 0, -1]).tolist() == [1]
    assert bvh.count_hits([1, 1, 3], [0, 0, -1], crossings=True).tolist() == [1]


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_in_edges_and_bad_rays(precision):
    vertices, faces = rays.cube()
    bvh = rt.BVH(vertices, faces, precision)
    o = [[0, 0, 3], [1, 1, 3], [0, 0, 0], [-1, 0, 5], [3, 3, 3], [0, 0, 1], [np.nan, 0, 0], [0, 0, 0]]
    d = [[0, 0, -1], [0, 0, -1], [1, 0, 0], [0, 0, -1], [-1, -1, -1], [0, 0, -1], [0, 0, 1], [0, 0, 0]]
    crossings = bvh.count_hits(o, d, crossings=True)
    assert (crossings % 2).tolist() == [0, 0, 1, 0, 0, 1, 0, 0]
    assert crossings[[0, 2]].tolist() == [2, 1]
    assert bvh.count_hits(o[:1], d[:1]).tolist() == [4]  # the diagonal of both sides
    assert bvh.count_hits([0.5, 0.2, 3], [0, 0, -1]).tolist() == [2]
    hits = bvh.all_hits([0.5, 0.2, 3], [0, 0, -1])
    assert hits.t.tolist() == [2, 4]


def test_ten_thousand_equal_triangles_are_sorted():
    n = 10_000
    order = np.random.default_rng(1).permutation(n)
    heights = np.repeat(np.arange(n // 100), 100)[order].astype(float)
    corners = np.array([[-1.0, -1, 0], [3, -1, 0], [-1, 3, 0]]) + heights[:, None, None] * [0, 0, 1]
    bvh = rt.BVH(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    hits = bvh.all_hits([[0, 0, -1], [9, 9, 9]], [0, 0, 1])
    assert hits.start.tolist() == [0, n, n]
    assert np.array_equal(hits.prim_id, np.lexsort((np.arange(n), heights)))
    assert np.array_equal(hits.t, np.sort(heights) + 1)


def test_too_many_hits_are_refused_as_soon_as_there_are_too_many(monkeypatch):
    bvh = rt.BVH(*rays.icosphere(2))
    o, d = np.tile([0.1, 0.2, 3], (3000, 1)), np.array([0, 0, -1])
    monkeypatch.setattr(hit_lists, "UNCHECKED", 1000)
    monkeypatch.setattr(memory, "free", lambda: 50_000.0)
    with pytest.raises(
        MemoryLimitError,
        match=r"1,024 of 3,000 rays have 2,048 hits; .* fewer rays at a time, or a smaller tmax$",
    ):
        bvh.all_hits(o, d, threads=1)
    assert bvh.all_hits(o[:100], d).start[-1] == 200
    assert bvh.count_hits(o, d).sum() == 6000
    assert issubclass(MemoryLimitError, ValueError)


def test_no_rays_and_no_triangles():
    empty = rt.BVH(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert empty.all_hits([0, 0, 0], [0, 0, 1]).start.tolist() == [0, 0]
    assert empty.contains([[0, 0, 0]]).tolist() == [False]
    bvh = rt.BVH(*FLOOR)
    assert bvh.all_hits(np.zeros((0, 3)), np.zeros((0, 3))).start.tolist() == [0]
    assert bvh.count_hits(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


# --- exact oracle ----------------------------------------------------------------------------------------------------


@pytest.mark.engine
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", ["cubes that touch", "torus", "turned slivers", "filled junctions", "three times"])
def test_aimed_rays_and_points_are_judged_exactly(name, precision):
    vertices, faces = CLOSED_MESHES[name]()
    for scale, n in ((1.0, 120), (1e-9, 60)):
        bvh = rt.BVH(vertices * scale, faces, precision)
        corners, seed = bvh.vertices[bvh.faces], len(name)
        o, d = aimed_rays((vertices * scale, faces), precision, seed, n)
        judge = HitJudge(corners, o, d)
        crossings = judge.of_crossings(bvh.all_hits(o, d, crossings=True))
        assert crossings[:4] == (0, 0, 0, 0)
        assert crossings.t_error < 0.25
        assert judge.of_hits(bvh.all_hits(o, d))[:4] == (0, 0, 0, 0)
        points = aimed_points((vertices * scale, faces), precision, seed + 1, n)
        side = inside_exactly(corners, points)
        assert np.array_equal(bvh.contains(points), (side == INSIDE) | (side == SURFACE))
        assert {*side.tolist()} >= ({0, 2} if name == "three times" else {0, 1, 2}) - ({1} if scale < 1 else set())


def test_the_judge_finds_planted_faults():
    vertices, faces = rays.cube()
    bvh = rt.BVH(vertices, faces, "float64")
    o, d = np.array([[0.5, 0.2, 3], [0.1, 0.3, 0.0]]), np.array([[0.0, 0, -1], [0, 0, 1]])
    judge = HitJudge(vertices[faces], o, d)
    right = bvh.all_hits(o, d, crossings=True)
    assert judge.of_crossings(right)[:4] == judge.of_hits(right)[:4] == (0, 0, 0, 0)
    lost = right._replace(**{name: getattr(right, name)[1:] for name in COLUMNS}, start=np.array([0, 1, 2]))
    assert judge.of_crossings(lost)[:2] == (1, 1)
    assert judge.of_hits(lost).lost == 1
    other = right._replace(prim_id=(right.prim_id + 1) % 12)
    assert judge.of_crossings(other).false > 0
    assert judge.of_hits(other).false > 0
    assert judge.of_hits(right._replace(t=right.t + 1e-9)).false == 3
    assert judge.of_crossings(right._replace(t=right.t[[1, 0, 2]])).order > 0


@pytest.mark.parametrize("small", [1e-300, 5e-324, 1e-120])
def test_numbers_of_very_different_sizes_are_decided_by_fractions(monkeypatch, small):
    decided = []

    def noted(bvh, traced, counts, work):
        decided.append(int(work.state[2]))
        decide_pairs(bvh, traced, counts, work)

    monkeypatch.setattr(hit_lists, "decide_pairs", noted)
    vertices, faces = rays.cube()
    bvh = rt.BVH(vertices, faces, "float64")
    signs = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=2)))
    d = np.column_stack([signs * small, np.ones(9)])
    o = np.column_stack([signs[::-1] * small, np.full(9, -3.0)])
    o, d = np.concatenate([o, o + [0, 0, 3], o + [1, 1, 0]]), np.tile(d, (3, 1))
    judge = HitJudge(vertices[faces], o, d)
    hits = bvh.all_hits(o, d, crossings=True)
    assert judge.of_crossings(hits)[:4] == (0, 0, 0, 0)
    assert sum(decided) > 20
    points = np.concatenate([o, [[1, 1 - 2**-53, small], [1, small, -small], [1 + 2**-52, small, 0]]])
    exactly = inside_exactly(vertices[faces], points) != 0
    assert np.array_equal(bvh.contains(points), exactly)
    order = np.random.default_rng(2).permutation(30 * len(points))  # so many, out of order, are sorted
    assert np.array_equal(bvh.contains(np.tile(points, (30, 1))[order]), np.tile(exactly, 30)[order])


def test_distances_that_overflow_or_underflow_are_counted_still():
    vertices, faces = rays.cube()
    bvh = rt.BVH(vertices, faces)
    for length in (1e-44, 1e-40, 1e38):
        hits = bvh.all_hits([0, 0.1, 1e-10], [[0, 0, length], [0, 0, -length]], crossings=True)
        assert hits.start.tolist() == [0, 1, 2]
        assert (hits.t > 0).all()
        assert np.isfinite(hits.t).all()


# --- exact arithmetic ------------------------------------------------------------------------------------------------


def test_expansions_are_exact():
    rng = np.random.default_rng(3)
    x = np.zeros(3 * expansions.VECTOR + expansions.TERMS)
    for _ in range(50):
        a, b, c, o = np.ldexp(rng.integers(-9, 10, (4, 3)) + rng.uniform(-1, 1, (4, 3)), rng.integers(-60, 60, (4, 3)))
        for place, vector in enumerate((a, b, c)):
            interpreted(expansions.write_difference)(x, 6 * place, vector, o)
        n = expansions.triple_product(x, 18, 0, 6, 12)
        parts = [exact.sub(exact.exact(vector), exact.exact(o)) for vector in (a, b, c)]
        product = exact.dot(parts[0], exact.cross(parts[1], parts[2]))
        assert sum(map(Fraction, x[18 : 18 + n])) == product
        assert expansions.sign_of(x, 18, n) == (product > 0) - (product < 0)
        assert expansions.value_of(x, 18, n) == pytest.approx(float(product), rel=1e-14)


def test_crossings_along_subnormal_directions_keep_their_t():
    """A direction below the normal numbers still has finite t close to the surface."""
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    bvh = rt.BVH(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], precision="float64")
    hits = bvh.all_hits([0.25, 0.25, 2.0**-52], [0, 0, -(2.0**-1060)], crossings=True)
    assert hits.t.tolist() == [2.0**1008]
