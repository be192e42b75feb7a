"""Lists of rays in rows of any length: they are recognised, and traced run by run with the same results."""

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.accel import raster, ray_queries, reorder, runs
from raytrace.accel.inputs import check_rays, columns_of
from raytrace.accel.lanes import BITS
from raytrace.accel.raster import field_in_rows
from raytrace.records import Rays
from test_raster import EYE, FILM, H, W, blocks

pytestmark = pytest.mark.skipif(BITS < 256, reason="bundles are too small for runs")

GAPS = np.random.default_rng(3).uniform(size=H * W) < 0.9
SEEN = FILM[GAPS]
N = len(SEEN)
ON_PLANE = SEEN * (2 / -SEEN[:, 2:]).astype("f4")
LISTS = {
    "directions": (EYE, SEEN, 1),
    "one origin per ray": (np.tile(EYE, (N, 1)), SEEN, 1),
    "origins": (EYE + ON_PLANE, np.float32([3, 4, 5]) - (EYE + ON_PLANE), 0),
    "float64": (EYE, SEEN.astype("f8"), 1),
    "column-major": (EYE, np.asfortranarray(SEEN), 1),
    "random": (EYE, np.random.default_rng(2).permutation(SEEN), None),
    "blocks": (EYE, FILM[blocks()], None),
    "few": (EYE, SEEN[: 1 << 16], None),
    "all alike": (EYE, np.tile(SEEN[:1], (N, 1)), None),
    "broken": (EYE, np.where(np.arange(N)[:, None] // 5 % 2 == 0, SEEN, -SEEN), None),
    "not finite": (EYE, np.full((N, 3), np.nan, "f4"), None),
}


@pytest.fixture(scope="module")
def bvh():
    return rt.BVH(*rays.icosphere(5))


@pytest.fixture(autouse=True)
def narrow_rows_are_wide(monkeypatch):
    monkeypatch.setattr(raster, "WIDE", 1.0)


@pytest.mark.parametrize("name", LISTS)
def test_rows_are_recognised_where_they_are_wide(bvh, name, monkeypatch):
    o, d, field = LISTS[name]
    fields, shape = check_rays(o, d, 0.0, np.inf, np.dtype("f4"))
    assert field_in_rows(bvh.tree, fields, shape[0]) == field
    monkeypatch.setattr(raster, "WIDE", 100.0)
    assert field_in_rows(bvh.tree, fields, shape[0]) is None


def test_small_trees_need_no_order():
    fields, shape = check_rays(EYE, SEEN, 0.0, np.inf, np.dtype("f4"))
    assert field_in_rows(rt.BVH(*rays.soup(8, seed=1)).tree, fields, shape[0]) is None


@pytest.mark.parametrize("layout", ["rows", "columns", "spread"])
def test_answers_are_those_of_rays_in_their_own_order(bvh, layout, monkeypatch):
    """With an origin and a range of each ray, in every layout of memory that kernels read."""
    o, d = np.tile(EYE, (N, 1)), SEEN.copy()
    limits = np.linspace(1, 2, N, dtype="f4")
    if layout == "columns":
        o, d = np.asfortranarray(o), np.asfortranarray(d)
    elif layout == "spread":
        o, d = (np.pad(a, ((0, 0), (0, 2)))[:, :3] for a in (o, d))
        limits = np.repeat(limits, 2)[::2]
    batches = []
    for name in "closest_hit", "any_hit":
        query = getattr(runs, name)
        monkeypatch.setattr(runs, name, lambda *args, query=query: (batches.append(args[4]), query(*args)))
    answers = []
    for _ in range(2):
        answers.append((*bvh.closest_hit(o, d, tmax=limits), bvh.any_hit(o, d, tmax=limits)))
        assert {batch.field for batch in batches} == {1}
        assert sum(batch.n for batch in batches) == 2 * N
        monkeypatch.setattr(ray_queries, "field_in_rows", lambda *_: None)
    assert N % runs.RUN != 0
    assert 0.05 < np.mean(answers[0][-1]) < 0.95
    for first, second in zip(*answers, strict=True):
        assert first.tobytes() == second.tobytes()


def test_runs_are_sorted_by_the_cells_where_they_are(bvh):
    """Two rows of eight runs, one above the other: each bundle has half of both."""
    n = 8 * runs.RUN
    x, y = np.tile(np.arange(n), 2), np.repeat([0.0, 0.5], n)
    o = np.column_stack([x, y, 0 * x]).astype("f4")
    scratch = reorder.make_sort_scratch(2 * n, np.dtype("f4"), bvh.pool_work())
    row = runs.sort_runs(columns_of(o, 2 * n), 16, scratch)
    number = scratch.numbers[row, :16]
    assert sorted(number[:8].tolist()) == [0, 1, 2, 3, 8, 9, 10, 11]
    assert sorted(number.tolist()) == list(range(16))


def test_numbers_out_of_all_cells_and_the_last_rays_are_not_lost(bvh):
    o, d = np.full((6, 3), 5, "f4"), np.arange(18, dtype="f4").reshape(6, 3)
    o[2], o[4] = np.nan, np.inf
    arrays = [np.asarray(a, "f4") for a in (o, d, 0.0, np.arange(6))]
    scratch = reorder.make_sort_scratch(6, np.dtype("f4"), bvh.pool_work())
    numbers, taken = runs._sorted(Rays(*(columns_of(a, 6) for a in arrays)), runs.Runs(6, 0), scratch)
    assert numbers[0] == 0
    for column, array in zip(taken, arrays, strict=True):
        if array.ndim > 0:
            places = column.start + np.arange(6)[:, None] + np.arange(array.size // 6) * column.axis
            np.testing.assert_array_equal(column.data[places], array.reshape(6, -1))
