"""A pool traces scattered rays as packets do: the same bits."""

import numba
import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.accel import query, reorder
from raytrace.accel.inputs import columns_of
from raytrace.accel.lanes import BITS, least_lane, load, peek_either, store, store_packed
from raytrace.accel.pool import suits_pool
from raytrace.records import Hits, Rays

pytestmark = pytest.mark.engine

N = 1000
pool_only = pytest.mark.skipif(BITS != 512, reason="only registers of 512 bits are packed, which a pool needs")


def batch(precision, seed=1):
    """Scattered rays: many end early, some begin late, some are not finite or have no direction."""
    o, d = rays.anywhere(N, seed)
    rng = np.random.default_rng(seed)
    tmin, tmax = rng.choice([0.0, 0.0, 0.3, -1.0], N), rng.choice([np.inf, np.inf, 1.0, 0.01], N)
    o[::97, 1], d[5::89, 0], d[7::101] = np.nan, np.inf, 0.0
    d *= 10.0 ** rng.choice([0, 0, -9, 9], N)[:, None]
    return Rays(*(columns_of(a.astype(precision), N) for a in (o, d, tmin, tmax)))


def traced(bvh, asked, work):
    """Nearest hits and occlusion, and how many nodes were visited for them."""
    dtype = bvh.triangles.dtype
    hits = Hits(np.empty(N, dtype), np.empty(N, np.int32), np.empty(N, dtype), np.empty(N, dtype))
    occluded = np.empty(N, np.bool_)
    query.closest_hit(bvh.tree, asked, hits, N, work)
    query.any_hit(bvh.tree, asked, occluded, N, work)
    return hits, occluded, work.counts[0]


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_pool_gives_the_bits_of_packets(precision, split):
    bvh = rt.BVH(*rays.soup(3000, seed=2), precision, split)
    asked = batch(precision)
    hits, occluded, nodes = traced(bvh, asked, bvh.pool_work())
    others, blocked, others_nodes = traced(bvh, asked, bvh.work())
    assert 0.2 < np.mean(hits.prim_id >= 0) < 0.9
    assert rays.same_hits(hits, others)
    assert np.array_equal(occluded, blocked)
    assert (nodes != others_nodes) == (BITS == 512)  # the two ways differ where there is a pool


def test_small_trees_have_none():
    bvh = rt.BVH(*rays.soup(60, seed=2))
    assert not suits_pool(bvh.tree)
    assert traced(bvh, batch("float32"), bvh.pool_work())[2] == traced(bvh, batch("float32"), bvh.work())[2]


@pool_only
def test_scattered_rays_are_not_sorted_for_it(monkeypatch):
    bvh = rt.BVH(*rays.soup(3000, seed=2))
    o, d = rays.anywhere(N, 3)
    scratch = reorder.make_sort_scratch(N, np.dtype("f4"), bvh.pool_work())

    def sorted_first(o, d):
        asked = Rays(*(columns_of(np.asarray(a, "f4"), N) for a in (o, d, np.zeros(N), np.ones(N))))
        return reorder.worth_sorting(bvh.tree, bvh.grid, asked, N, scratch)

    assert not sorted_first(o, d)
    assert sorted_first(o, np.tile([[0.1, 0.2, 1.0]], (N, 1)))  # these share packets once they are sorted


@numba.njit(error_model="numpy")
def choose(x, y, chosen, out, numbers):
    for i in range(0, len(x), 8):
        a, b = load(x, i, 8), load(y, i, 8)
        mask = (a < b) & load(chosen, i, 8)
        store_packed(out, i, mask, a)
        numbers[i] = least_lane(mask, a)
        numbers[i + 1] = peek_either(numbers[i] > 3, numbers, i, numbers, i + 2)
    store(out, len(x), load(x, 0, 8))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_operations_that_choose_among_lanes_are_compiled_to_their_meaning(dtype):
    rng = np.random.default_rng(4)
    x, y = rng.random((2, 400)).astype(dtype)
    x[::7], chosen = np.inf, rng.random(400) < 0.6
    chosen[:8], x[8:16], chosen[8:16] = False, 0.25, True
    out, numbers = np.zeros((2, 408), dtype), np.full((2, 400), -5)
    for k, function in enumerate((choose, choose.py_func)):
        function(x, y, chosen, out[k], numbers[k])
    assert np.array_equal(numbers[0], numbers[1])
    assert numbers[0, 0] == 7  # no lane
    for i in range(0, 400, 8):
        mask = (x[i : i + 8] < y[i : i + 8]) & chosen[i : i + 8]
        n = np.count_nonzero(mask)
        for k in range(2):
            assert np.array_equal(out[k, i : i + n], x[i : i + 8][mask])
        if n:
            assert x[i + numbers[0, i]] <= x[i : i + 8][mask].min() * (1 + 2.0**-18)
            assert mask[numbers[0, i]]
