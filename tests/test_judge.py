"""The judge: answers that are right to rounding pass, and nothing else."""

import numpy as np
import pytest

import rays
from raytrace.hardcases.judge import BACKWARD, Judge, RayQuery, Verdict, merged
from raytrace.records import Hits

PRECISIONS = ("float32", "float64")
FLOOR = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])


def judge(mesh, o, d, precision="float64", tmin=0.0, tmax=np.inf, inside=False):
    o, d = (np.asarray(a, precision) for a in np.broadcast_arrays(np.atleast_2d(o), np.atleast_2d(d)))
    tmin, tmax = (np.full(len(o), limit, precision) for limit in (tmin, tmax))
    return Judge(RayQuery(mesh[0].astype(precision), mesh[1], o, d, tmin, tmax, np.full(len(o), inside), False))


def hits(t, prim, u=0.0, v=0.0):
    return Hits(*(np.atleast_1d(np.asarray(a)) for a in (t, prim, u, v)))


def right(judge):
    """The exact answer itself, rounded."""
    c, n = judge.crossings, len(judge.query.o)
    found = Hits(np.full(n, np.inf), np.full(n, -1), np.zeros(n), np.zeros(n))
    for k in np.lexsort((-c.prim, -c.t)):
        if judge.query.tmin[c.ray[k]] < c.t[k] < judge.query.tmax[c.ray[k]]:
            for column, value in zip(found, (c.t[k], c.prim[k], c.u[k], c.v[k]), strict=True):
                column[c.ray[k]] = value
    return found


MISS = hits(np.inf, -1)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", rays.CLOSED)
def test_exact_answers_are_right(name, precision):
    make, inside = rays.CLOSED[name]
    mesh = make()
    targets = rays.edge_points(mesh, precision, seed=1)
    targets = targets[:: -(-len(targets) // 100)]
    o, d = rays.towards([inside[1], [2.3, -1.7, 1.9]], targets)
    for start, within in ((0, True), (len(targets), False)):
        part = slice(start, start + len(targets))
        asked = judge(mesh, o[part], d[part], precision, inside=within)
        verdict = asked.hits(right(asked))
        assert not verdict.wrong.any()
        assert not verdict.leak.any()
        assert np.fmax(verdict.t_error, 0) < 1e-15
        assert not asked.occluded(right(asked).prim_id >= 0).wrong.any()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_hit_may_be_off_by_the_bound_and_no_more(precision):
    asked = judge(FLOOR, [1, 1, 3], [0, 0, -4], precision)  # t = 0.75; the farthest vertex is 19^(1/2) away
    bound = BACKWARD * np.finfo(precision).eps * 19**0.5 / 4
    for share, wrong in ((0, False), (0.9, False), (-0.9, False), (1.1, True), (-1.1, True), (1e6, True)):
        verdict = asked.hits(hits(0.75 + share * bound, 0, 0.25, 0.25))
        assert verdict.wrong.tolist() == [wrong]
        assert not verdict.leak.any()


def test_what_lies_off_its_triangle_is_wrong():
    floors = np.concatenate([FLOOR[0], FLOOR[0] + [0, 0, 1]]), np.array([[0, 1, 2], [3, 4, 5]])
    asked = judge(floors, [1, 1, 3], [0, 0, -1])
    assert not asked.hits(hits(2.0, 1)).wrong[0]
    assert asked.hits(hits(3.0, 0)).wrong[0]  # behind another
    assert asked.hits(hits(2.0, 0)).wrong[0]  # at the distance of another
    assert asked.hits(hits(3.0, 1)).wrong[0]


@pytest.mark.parametrize("answer", [(np.nan, 0), (0.75, 1), (0.75, -2), (np.inf, 0), (-0.75, 0), (1e300, 0)])
def test_answers_that_are_none_are_wrong(answer):
    assert judge(FLOOR, [1, 1, 3], [0, 0, -4]).hits(hits(*answer)).wrong[0]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_miss_is_wrong_but_beside_an_outline(precision):
    ulp = np.finfo(precision).eps
    x = np.array([1, 1e4 * ulp, 100 * ulp, ulp, 0, -ulp, -1])
    asked = judge(FLOOR, np.column_stack([x, 0 * x + 1, 0 * x + 3]), [0, 0, -4], precision)
    n = len(x)
    missed = asked.hits(Hits(np.full(n, np.inf), np.full(n, -1), np.zeros(n), np.zeros(n)))
    assert missed.wrong.tolist() == [True, True, False, False, False, False, False]
    assert not missed.leak.any()
    hit = asked.hits(Hits(np.full(n, 0.75), np.zeros(n, int), np.zeros(n), np.zeros(n)))
    assert hit.wrong.tolist() == [False] * 6 + [True]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_miss_between_neighbours_is_a_leak_unless_they_face_differently(precision):
    vertices, faces = rays.grid(4)
    targets = [[2, 2, 0], [2, 1.5, 0], [1.25, 1.25, 0]]  # a vertex, an edge, a diagonal
    outline = [[0, 0, 0], [4, 1.5, 0]]
    asked = judge((vertices, faces), np.array(targets + outline) + [0, 0, 3], [0, 0, -1], precision)
    verdict = asked.hits(Hits(np.full(5, np.inf), np.full(5, -1), np.zeros(5), np.zeros(5)))
    assert verdict.leak.tolist() == [True] * 3 + [False] * 2
    assert not verdict.wrong.any()
    roof = np.array([[0.0, 0, 1], [0, 1, 1], [1, 0, 0], [-1, 0, 0]]), np.array([[0, 2, 1], [0, 1, 3]])
    above = judge(roof, [0, 0.25, 3], [0, 0, -1], precision)  # the ridge from above: both sides face it
    assert above.hits(MISS).leak[0]
    beside = judge(roof, [3, 0.25, 1], [-1, 0, 0], precision)  # the same ridge, seen as an outline
    verdict = beside.hits(MISS)
    assert not verdict.leak[0]
    assert not verdict.wrong[0]


def test_a_patch_that_the_bound_blurs_to_its_rim_may_be_missed():
    """Seen from 1e12 in float32, a cube of side 2 is smaller than the bound."""
    mesh = rays.cube()
    asked = judge(mesh, [1e12, 0, 0], [-1, 0, 0], "float32")
    verdict = asked.hits(MISS)
    assert not verdict.leak[0]
    assert not verdict.wrong[0]
    assert judge(mesh, [1e3, 0, 0], [-1, 0, 0], "float32").hits(MISS).leak[0]


def test_no_ray_may_leave_a_closed_mesh_though_it_runs_to_an_outline():
    vertices, faces = rays.cube()
    o, d = [0, 0, 0], [1, 1, 1]
    assert judge((vertices, faces), o, d, inside=True).hits(MISS).leak[0]
    half = faces[:6]
    assert not judge((vertices, half), o, [1, 1, 1]).hits(MISS).leak[0]


def test_triangles_without_area_are_never_hit():
    needle = np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0]]), np.array([[0, 1, 2]])
    asked = judge(needle, [1, 1, 1], [0, 0, -1])
    assert asked.hits(hits(1.0, 0)).wrong[0]
    assert asked.occluded(np.array([True])).wrong[0]
    assert not asked.hits(MISS).wrong[0]


def test_rays_that_are_not_finite_hit_nothing():
    o, d = rays.bad_rays()
    asked = judge(FLOOR, o, d)
    n = len(o)
    assert asked.hits(Hits(np.full(n, 1.0), np.zeros(n, int), np.zeros(n), np.zeros(n))).wrong.all()
    assert asked.occluded(np.ones(n, bool)).wrong.all()
    assert not asked.occluded(np.zeros(n, bool)).wrong.any()


@pytest.mark.parametrize(
    ("tmin", "tmax", "hit"),
    [
        (0, 1, True),
        (-np.inf, np.inf, True),
        (0.8, 1, False),
        (0, 0.7, False),
        (1, 0.5, False),
        (np.nan, 1, False),
        (0.75, 1, None),
        (0, 0.75, None),
    ],
)
def test_hits_count_within_the_interval(tmin, tmax, hit):
    """At its very end they may be on either side of it; an empty one holds nothing, not even nearly."""
    asked = judge(FLOOR, [1, 1, 3], [0, 0, -4], tmin=tmin, tmax=tmax)
    allowed = {True, False} if hit is None else {hit}
    assert {answer for answer in (True, False) if not asked.occluded(np.array([answer])).wrong[0]} == allowed
    assert asked.hits(MISS).wrong[0] == (hit is True)
    assert asked.hits(hits(0.75, 0)).wrong[0] == (hit is False)


def test_what_only_grazes_an_outline_may_occlude():
    ulp = np.finfo("float64").eps
    for x, wrong in ((-4 * ulp, False), (-1e-6, True)):
        asked = judge(FLOOR, [x, 1, 3], [0, 0, -1])
        assert len(asked.crossings.ray) == 0
        assert asked.occluded(np.array([True])).wrong[0] == wrong


def test_errors_are_those_of_well_conditioned_hits():
    o = np.array([[1, 1, 3], [1, 1, 3]])
    d = np.array([[0, 0, -4], [2, 0, -3 + 2.9995]])  # the second comes in flat
    asked = judge(FLOOR, o, d, "float32")
    answers = right(asked)
    answers.t[:] *= [1 + 1e-7, 1 + 1e-3]
    answers.u[0] += 1e-6
    verdict = asked.hits(answers)
    np.testing.assert_allclose([verdict.t_error, verdict.uv_error], [1e-7, 1e-6], rtol=1e-6)
    assert np.isnan(asked.hits(Hits(*(a[:1].repeat(2) for a in MISS))).t_error)


def test_the_lowest_of_the_nearest_is_told():
    vertices = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [4, 4, 0], [0, 0, 1], [4, 0, 1], [0, 4, 1]])
    faces = np.array([[0, 1, 2], [4, 5, 6], [4, 6, 5], [4, 5, 6], [0, 1, 3]])
    asked = judge((vertices, faces), [[1, 1, 3], [3, 2, 3], [3, 9, 3]], [0, 0, -1])
    assert asked.lowest().tolist() == [1, 4, -1]


def test_a_ray_is_right_if_all_answers_are():
    one = Verdict(np.array([True, False, False]), np.array([False, False, False]), 1e-7, np.nan)
    two = Verdict(np.array([False, False, False]), np.array([False, True, False]), np.nan, np.nan)
    both = merged([one, two])
    assert both.wrong.tolist() == [True, False, False]
    assert both.leak.tolist() == [False, True, False]
    assert both.t_error == 1e-7
    assert np.isnan(both.uv_error)
