"""Lists of rays that are images in rows: they are recognised, and traced in blocks with the same results."""

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.accel import ray_queries, reorder
from raytrace.accel.inputs import check_rays
from raytrace.accel.raster import width_of_list
from raytrace.parallel import MAX_RANGE

H, W = 384, 704
MESH = rays.soup(2000, seed=1, size=0.05)


@pytest.fixture(scope="module")
def bvh():
    return rt.BVH(*MESH)


def film(jitter=0.0, seed=1):
    """Directions of a pinhole camera, row by row: (H W, 3)."""
    y, x = np.divmod(np.arange(H * W), W)
    at = np.stack([x, y], 1) + np.random.default_rng(seed).uniform(-jitter, jitter, (H * W, 2))
    d = np.column_stack([(at - (W / 2, H / 2)) / W, np.full(H * W, -1.0)])
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype("f4")


def blocks():
    """Numbers of the pixels, block after block of 4 x 4."""
    y, x = np.mgrid[0:H, 0:W]
    return np.argsort(((y // 4 * (W // 4) + x // 4) * 16 + y % 4 * 4 + x % 4).ravel())


FILM, EYE = film(), np.float32([0, 0, 2])
IMAGES = {
    "directions": (EYE, FILM),
    "origins too": (np.tile(EYE, (H * W, 1)), FILM),
    "jittered": (EYE, film(0.4)),
    "float64": (EYE, FILM.astype("f8")),
    "column-major": (EYE, np.asfortranarray(FILM)),
    "backwards": (EYE, FILM[::-1]),
    "orthographic": (FILM * np.float32([1, 1, 0]), np.float32([0, 0, -1])),
    "orthographic, one direction per ray": (FILM * np.float32([1, 1, 0]), np.tile(np.float32([0, 0, -1]), (H * W, 1))),
}
OTHERS = {
    "random": (EYE, np.random.default_rng(2).normal(size=(H * W, 3)).astype("f4")),
    "blocks": (EYE, FILM[blocks()]),
    "all alike": (np.tile(EYE, (H * W, 1)), np.tile(FILM[:1], (H * W, 1))),
    "few": (EYE, FILM[: 64 * W]),
    "no whole rows": (EYE, FILM[: -W // 2]),
    "rows without misses": (EYE, FILM[np.random.default_rng(3).uniform(size=H * W) < 0.99]),
    "not finite": (EYE, np.full((H * W, 3), np.nan, "f4")),
}


def width(bvh, o, d):
    fields, shape = check_rays(o, d, 0.0, np.inf, np.dtype("f4"))
    return width_of_list(bvh.tree, fields, shape[0], MAX_RANGE)


@pytest.mark.parametrize("name", IMAGES)
def test_images_are_recognised(bvh, name):
    assert width(bvh, *IMAGES[name]) == W


@pytest.mark.parametrize("name", OTHERS)
def test_other_lists_are_not(bvh, name):
    assert width(bvh, *OTHERS[name]) == 0


def test_small_trees_need_no_blocks():
    assert width(rt.BVH(*rays.soup(8, seed=1)), EYE, FILM) == 0


def test_images_are_traced_in_blocks_with_the_same_results(bvh, monkeypatch):
    batches = []
    for name in "closest_hit", "any_hit":
        query = getattr(reorder, name)
        monkeypatch.setattr(reorder, name, lambda *args, query=query: (batches.append(args[4]), query(*args)))
    limit = np.linspace(1, 3, H * W, dtype="f4")
    hits, occluded = bvh.closest_hit(EYE, FILM, tmax=limit), bvh.any_hit(EYE, FILM, tmax=limit)
    assert {type(batch) for batch in batches} == {ray_queries.Pixels}
    assert sum(batch.width * batch.height for batch in batches) == 2 * H * W
    batches.clear()
    some = slice(H * W // 3, H * W // 3 + H * W // 2)  # too few to be searched
    few = bvh.closest_hit(EYE, FILM[some], tmax=limit[some])
    assert {type(batch) for batch in batches} == {int}
    for a, b in zip(hits, few, strict=True):
        assert a[some].tobytes() == b.tobytes()
    assert 0.1 < np.mean(occluded) < 0.9
    np.testing.assert_array_equal(occluded, hits.prim_id >= 0)
