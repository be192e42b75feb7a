"""Rays of any shape: the results are those of the same rays in rows, and no field is copied whole."""

import tracemalloc

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace import parallel
from raytrace.accel import inputs, ray_queries
from raytrace.accel.batches import image_width, whole_blocks

MESH = rays.soup(300, seed=1)
F4 = np.dtype("f4")


@pytest.fixture(scope="module")
def bvh():
    return rt.BVH(*MESH)


def image(h, w, seed=2, dtype="f4"):
    """Rays of a camera, disturbed: (h, w, 3) origins and directions."""
    rng = np.random.default_rng(seed)
    y, x = np.meshgrid(np.linspace(-0.6, 0.6, h), np.linspace(-0.6, 0.6, w), indexing="ij")
    d = np.stack([x, y, np.full_like(x, -1)], -1) + rng.normal(0, 0.01, (h, w, 3))
    return (np.array([0, 0, 2]) + rng.normal(0, 0.1, (h, w, 3))).astype(dtype), d.astype(dtype)


def in_rows(bvh, o, d, tmin=0.0, tmax=np.inf):
    """Hits and occlusion of the same rays as rows, reshaped."""
    shape = np.broadcast_shapes(np.shape(o)[:-1], np.shape(d)[:-1], np.shape(tmin), np.shape(tmax))
    o, d = (np.broadcast_to(a, (*shape, 3)).reshape(-1, 3).copy() for a in (o, d))
    tmin, tmax = (np.broadcast_to(a, shape).reshape(-1).copy() for a in (tmin, tmax))
    hits = bvh.closest_hit(o, d, tmin, tmax)
    return rt.Hits(*(a.reshape(shape) for a in hits)), bvh.any_hit(o, d, tmin, tmax).reshape(shape)


ORIGINS, DIRECTIONS = image(7, 11)
LIMITS = np.linspace(1, 3, 77, dtype="f4").reshape(7, 11)
BATCHES = {
    "image": (ORIGINS, DIRECTIONS),
    "one origin": (ORIGINS[0, 0], DIRECTIONS),
    "one direction, an image of limits": (ORIGINS[0, 0], DIRECTIONS[0, 0], 0.0, LIMITS),
    "limits of columns": (ORIGINS, DIRECTIONS, LIMITS[0] / 9, LIMITS[0]),
    "limits of rows": (ORIGINS, DIRECTIONS, 0.0, LIMITS[:, :1]),
    "origins of rows, directions of columns": (ORIGINS[:, :1], DIRECTIONS[0]),
    "a stack": (np.stack([ORIGINS, ORIGINS + 0.1, ORIGINS - 0.1]), DIRECTIONS),
    "a stack of cameras": (ORIGINS[0, :3, None, None], DIRECTIONS),
    "five axes": (ORIGINS.reshape(7, 1, 11, 1, 3), DIRECTIONS[:, None, :1, None]),
    "columns first": (ORIGINS.transpose(1, 0, 2), DIRECTIONS.transpose(1, 0, 2)),
    "planes of components": (ORIGINS.transpose(2, 0, 1).copy().transpose(1, 2, 0), DIRECTIONS),
    "backwards": (ORIGINS[::-1, ::-1], DIRECTIONS[::-1, ::-1, :]),
    "every second": (ORIGINS[::2, ::2], DIRECTIONS[::2, ::2]),
    "another type": (ORIGINS.astype("f8"), DIRECTIONS.astype("f2").astype("i2") + DIRECTIONS.astype("f8")),
    "single rows in many axes": (ORIGINS[:1, :1], DIRECTIONS),
    "all alike": (ORIGINS[:1, :1], DIRECTIONS[:1, :1]),
    "no rays": (ORIGINS[:0], DIRECTIONS[:0]),
    "no columns": (ORIGINS[:, :0], DIRECTIONS[0, 0]),
    "one row against none": (np.zeros((0, 3)), DIRECTIONS[:1, 0]),
}


@pytest.mark.parametrize("name", BATCHES)
def test_any_shape_gives_the_hits_of_the_same_rays_in_rows(bvh, name):
    hits, blocked = in_rows(bvh, *BATCHES[name])
    for column in (got := bvh.closest_hit(*BATCHES[name])):
        assert column.shape == blocked.shape
    assert rays.same_hits(got, hits)
    assert np.array_equal(bvh.any_hit(*BATCHES[name]), blocked)


def test_single_rows_give_one_ray_and_numbers_are_broadcast(bvh):
    assert bvh.closest_hit(ORIGINS[0, 0], DIRECTIONS[0, 0]).t.shape == (1,)
    assert bvh.any_hit(ORIGINS[0, 0], DIRECTIONS[0, 0]).shape == (1,)
    assert bvh.any_hit(ORIGINS[:1, 0], DIRECTIONS[0, 0]).shape == (1,)
    assert bvh.any_hit(ORIGINS[:1, :1], DIRECTIONS[0, 0]).shape == (1, 1)


def test_surfaces_have_the_shape_of_their_hits(bvh):
    hits = bvh.closest_hit(ORIGINS, DIRECTIONS, tmax=LIMITS / 4)
    assert 0.1 < (hits.prim_id >= 0).mean() < 0.9
    rows = bvh.surface(rt.Hits(*(a.reshape(-1) for a in hits)))
    for got, row in zip(bvh.surface(hits), rows, strict=True):
        assert got.shape == (7, 11, 3)
        assert np.array_equal(got.reshape(-1, 3), row, equal_nan=True)


@pytest.mark.parametrize("shape", [(4, 16), (33, 50), (65, 131), (3, 10, 40), (200, 17)])
def test_images_give_the_hits_of_the_same_rays_in_rows(bvh, shape, monkeypatch):
    """In blocks, whole or cut off by an edge, on several ranges of rows, whatever the layout of the arrays."""
    for module in (ray_queries, parallel):
        monkeypatch.setattr(module, "MAX_RANGE", 1 << 10)
    o, d = (a.reshape(*shape, 3) for a in image(int(np.prod(shape[:-1])), shape[-1]))
    tmax = np.linspace(0.5, 3, shape[-1], dtype="f4")
    planes = np.moveaxis(np.moveaxis(d, -1, 0).copy(), 0, -1)
    hits, blocked = in_rows(bvh, o, d, 0.0, tmax)
    assert 0.1 < blocked.mean() < 0.95
    for directions in (d, planes, d.astype("f8")):
        assert rays.same_hits(bvh.closest_hit(o, directions, tmax=tmax, threads=2), hits)
        assert np.array_equal(bvh.any_hit(o, directions, tmax=tmax, threads=2), blocked)


def test_incoherent_images_are_sorted(bvh):
    o, d = (a.astype("f4").reshape(40, 50, 3) for a in rays.anywhere(2000, seed=4))
    hits, blocked = in_rows(bvh, o, d)
    assert rays.same_hits(bvh.closest_hit(o, d), hits)
    assert np.array_equal(bvh.any_hit(o, d), blocked)


def test_blocks_are_used_where_padding_is_small():
    widths = {(480, 640): 640, (3, 8, 16): 16, (1, 640): 0, (640, 1): 0, (5, 640): 0, (640, 5): 0, (640,): 0, (): 0}
    widths |= {(7, 640): 640, (0, 640): 0, (640, 0): 0, (640, 4): 4, (8, 30_000): 30_000, (8, 40_000): 0}
    assert {shape: image_width(shape, parallel.MAX_RANGE) for shape in widths} == widths
    assert [whole_blocks(width) for width in (0, 4, 640, 30_000)] == [1024, 1024, 2560, 120_000]


@pytest.mark.parametrize("name", BATCHES)
def test_pieces_are_the_rows_in_c_order(name):
    fields, shape = inputs.check_rays(*BATCHES[name], *(0.0, np.inf)[len(BATCHES[name]) - 2 :], F4)
    n = int(np.prod(shape))
    o = np.broadcast_to(BATCHES[name][0], (*shape, 3)).reshape(n, 3).astype(F4)
    ends = np.random.default_rng(5).integers(0, n + 1, (20, 2)) if n else []
    for begin, end in [(0, n), *np.sort(ends, axis=1)] if n else []:
        column = inputs.columns_in(fields, begin, end, F4)[0]
        at = column.start + column.row * np.arange(end - begin)[:, None] + column.axis * np.arange(3)
        assert np.array_equal(column.data[at], o[begin:end])


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_broadcast_fields_take_no_memory(bvh, dtype, monkeypatch):
    for module in (ray_queries, parallel):
        monkeypatch.setattr(module, "MAX_RANGE", 1 << 13)
    h, w = 300, 2000
    o, d = image(h, 1, dtype=dtype)[0], image(1, w, dtype=dtype)[1]
    bvh.any_hit(o[:20], d)  # compiled
    tracemalloc.start()
    try:
        blocked = bvh.any_hit(o, d, threads=2)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert blocked.shape == (h, w)
    assert peak < blocked.nbytes + 3e6  # whole, o and d would be 14e6 or 29e6


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_images_in_both_precisions(precision):
    bvh = rt.BVH(*MESH, precision)
    o, d = image(35, 50, dtype=precision)
    tmax = np.linspace(0.1, 2, 50)
    hits, blocked = in_rows(bvh, o, d, 0.0, tmax.astype(precision))
    assert 0.1 < blocked.mean() < 0.95
    assert rays.same_hits(bvh.closest_hit(o, d, tmax=tmax), hits)
