"""Sorted rays: the same answers in the same order, whatever the order in which they were traced."""

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace import cores
from raytrace.accel import reorder
from raytrace.accel.inputs import columns_of
from raytrace.records import Rays

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")


def batch(o, d, precision, tmax=np.inf):
    """Rays as kernels read them, and the arrays that they lie in."""
    arrays = [np.asarray(a, precision) for a in (o, d, 0.0, tmax)]
    return Rays(*(columns_of(a, len(d)) for a in arrays)), arrays


def scattered(n, seed, precision):
    return [a.astype(precision) for a in rays.anywhere(n, seed)]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_sorted_rays_get_the_same_bits_as_rays_traced_in_their_own_order(precision, monkeypatch):
    bvh = rt.BVH(*rays.soup(3000, seed=1, size=0.05), precision)
    o, d = scattered(5003, 2, precision)
    limits = np.random.default_rng(3).uniform(0.1, 3.0, 5003)
    answers = []
    for sample in (reorder.SAMPLE, 10**9):
        monkeypatch.setattr(reorder, "SAMPLE", sample)
        answers.append((*bvh.closest_hit(o, d, 0.01, limits), bvh.any_hit(o, d, 0.01, limits)))
    assert 0.05 < np.mean(answers[0][1] >= 0) < 0.95
    for first, second in zip(*answers, strict=True):
        assert rays.same_bits(first, second)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_keys_are_sorted_and_no_ray_is_lost(precision):
    bvh = rt.BVH(*rays.soup(3000, seed=1, size=0.05), precision)
    n = 5003
    o, d = scattered(n, 4, precision)
    scratch = reorder.make_sort_scratch(n, np.dtype(precision), bvh.pool_work())
    asked, kept = batch(o, d, precision)
    row = reorder.sort_rays(asked, n, bvh.grid, scratch)
    assert (np.diff(scratch.keys[row, :n]) >= 0).all()
    assert np.array_equal(np.sort(scratch.numbers[row, :n]), np.arange(n))
    assert len(kept) == 4


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_key_is_the_cell_of_the_origin_and_the_kind_of_the_direction(precision):
    """A cube of 4 x 4 x 4 cells; the numbers of a cell's bits alternate between the axes."""
    bvh = rt.BVH(*rays.cube(), precision)
    grid = reorder.Grid(np.full(3, -1.0).astype(precision), np.full(3, 2.0).astype(precision), 2)
    o = np.array([[-1, -1, -1], [0.99, -1, -1], [-1, -0.4, -1], [-1, -1, 0.1], [5, -7, 0], [0, 0, 0]])
    d = np.array([[3, 1, 2], [-3, 1, 2], [1, -3, 2], [1, 2, -3], [1, 1, 1], [0, 0, -0.0]])
    scratch = reorder.make_sort_scratch(len(o), np.dtype(precision), bvh.pool_work())
    asked, kept = batch(o, d, precision)
    reorder.sort_rays(asked, len(o), grid, scratch)
    got = np.empty(len(o), int)
    rows = [row for row in (0, 1) if sorted(scratch.numbers[row, : len(o)]) == list(range(len(o)))]
    got[scratch.numbers[rows[-1], : len(o)]] = scratch.keys[rows[-1], : len(o)]
    cells = [0, 0b001001, 0b000010, 0b100000, 0b101001, 0b111000]
    kinds = [0, 1, 8 + 2, 16 + 4, 0, 0]
    assert got.tolist() == [cell << 5 | kind for cell, kind in zip(cells, kinds, strict=True)]
    assert len(kept) == 4


@pytest.mark.parametrize("precision", PRECISIONS)
def test_rays_that_are_in_order_stay_in_it_and_others_are_sorted(precision, monkeypatch):
    """Rays of a camera, and rays from anywhere."""
    bvh = rt.BVH(*rays.icosphere(4), precision)
    y, x = np.mgrid[0:64, 0:64] / 32 - 1
    d = np.stack([x, y, np.full_like(x, -3)], -1).reshape(-1, 3)
    o = np.broadcast_to([0.0, 0, 3], d.shape)
    sorted_at, real = [], reorder._sorted

    def spy(rays, n, grid, scratch):
        sorted_at.append(n)
        return real(rays, n, grid, scratch)

    monkeypatch.setattr(reorder, "_sorted", spy)
    scratch = reorder.make_sort_scratch(len(d), np.dtype(precision), bvh.pool_work())
    asked, kept = batch(o, d, precision)
    assert reorder.changes(asked, len(d), bvh.grid, scratch)[0] < 0.2 * reorder.SAMPLE
    bvh.closest_hit(o, d)
    bvh.any_hit(o, d)
    assert sorted_at == []
    o, d = np.random.default_rng(5).permutation(bvh.vertices)[:2000], d[:2000]
    asked, kept = batch(o, d, precision)
    assert reorder.changes(asked, 2000, bvh.grid, scratch)[0] > 0.8 * reorder.SAMPLE
    bvh.closest_hit(o, d)
    bvh.any_hit(o, d)
    assert sum(sorted_at) == 4000  # chunk by chunk
    assert len(kept) == 4


@pytest.mark.parametrize("precision", PRECISIONS)
def test_changes_are_counted_between_neighbours_whatever_the_width_of_registers(precision):
    """Runs of 16 rays, spread evenly over all: the count is worked out from the rays' octants alone."""
    bvh = rt.BVH(*rays.cube(), precision)  # a grid of one cell
    n = 16 * reorder.SAMPLE
    signs = np.random.default_rng(8).choice([-1.0, 1.0], n)
    d = np.stack([signs, np.full(n, 0.5), np.full(n, 0.25)], axis=1)
    starts = [part * (n - rays.PACKET) // (reorder.SAMPLE // rays.PACKET - 1) for part in range(16)]
    expected = sum(np.count_nonzero(np.diff(signs[start : start + rays.PACKET])) for start in starts)
    scratch = reorder.make_sort_scratch(n, np.dtype(precision), bvh.pool_work())
    asked, kept = batch(0 * d, d, precision)
    assert reorder.changes(asked, n, bvh.grid, scratch) == (expected, expected)  # keys, and directions
    assert len(kept) == 4


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf, 3e38, -3e38])
def test_numbers_that_are_out_of_all_cells_do_no_harm(odd):
    bvh = rt.BVH(*rays.soup(500, seed=6))
    o, d = scattered(1000, 7, "float32")
    o[::3, 1], d[1::3, 2] = odd, odd
    hits = bvh.closest_hit(o, d)
    alone = [bvh.closest_hit(o[k : k + 100], d[k : k + 100]) for k in range(0, 1000, 100)]
    assert rays.same_hits(hits, rt.Hits(*(np.concatenate(columns) for columns in zip(*alone, strict=True))))


def test_scratch_memory_is_kept_for_later_queries(monkeypatch):
    bvh, dtype = rt.BVH(*rays.soup(3000, seed=1, size=0.05)), np.dtype("f4")
    o, d = scattered(5003, 12, "float32")
    monkeypatch.setattr(reorder, "spare", {})
    few = bvh.closest_hit(o[:2000], d[:2000], threads=1)
    (first,) = reorder.spare[dtype]
    assert rays.same_bits(bvh.closest_hit(o[:1000], d[:1000], threads=1).t, few.t[:1000])
    (second,) = reorder.spare[dtype]
    assert second.rays is first.rays
    bvh.any_hit(o, d, threads=1)
    (third,) = reorder.spare[dtype]
    assert len(third.occluded) >= 5003 > len(first.occluded)
    reorder.return_sort_scratch(dtype, [first] * 100)
    assert len(reorder.spare[dtype]) == cores.usable()
