"""``raytrace.compiled``: queries from code that users compile, bit for bit those of ``BVH``."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba import njit, prange

import raytrace as rt
from raytrace import compiled
from raytrace.jit import PLAIN
from raytrace.native.caller import LAYOUT

N = 16 if PLAIN else 400


@njit(nogil=True)
def one_by_one(scene, o, d, tmin, tmax):
    t, u, v = np.empty(len(o), np.float32), np.empty(len(o), np.float32), np.empty(len(o), np.float32)
    prim_id, occluded = np.empty(len(o), np.int32), np.empty(len(o), np.bool_)
    for i in range(len(o)):
        t[i], prim_id[i], u[i], v[i] = compiled.closest_hit(scene, o[i], (d[i, 0], d[i, 1], d[i, 2]), tmin[i], tmax[i])
        occluded[i] = compiled.any_hit(scene, o[i], d[i], tmin[i], tmax[i])
    return t, prim_id, u, v, occluded


@njit(nogil=True)
def together(scene, o, d, tmin, tmax):
    t, prim_id, u, v = compiled.closest_hit(scene, o, d, tmin, tmax)
    return t, prim_id, u, v, compiled.any_hit(scene, o, d, tmin, tmax)


@njit(parallel=True)
def in_parallel(scene, o, d):
    t = np.empty(len(o), np.float32)
    for i in prange(len(o)):
        t[i] = compiled.closest_hit(scene, o[i], d[i])[0]
    return t


@pytest.fixture(scope="module")
def bvh():
    rng = np.random.default_rng(5)
    vertices = rng.uniform(-1, 1, (300, 3)).repeat(3, axis=0) + rng.uniform(-0.6, 0.6, (900, 3))
    return rt.BVH(vertices, np.arange(900).reshape(-1, 3))


@pytest.fixture(scope="module")
def rays():
    """Rays of float64, some of them extreme."""
    rng = np.random.default_rng(6)
    o, d = rng.uniform(-1.5, 1.5, (N, 3)), rng.normal(size=(N, 3))
    d[:3] *= 1e-30
    d[3:6] *= 1e30
    d[8:12, 1:] = 0
    d[12], o[13], d[14, 0] = 0, np.nan, np.inf
    return o, d, rng.uniform(-0.1, 0.5, N), rng.choice([0.7, 3, np.inf], N)


def same_bits(found, bvh, rays):
    expected = *bvh.closest_hit(*rays, threads=1), bvh.any_hit(*rays, threads=1)
    return all(np.array_equal(a.view(np.uint8), b.view(np.uint8)) for a, b in zip(found, expected, strict=True))


def test_the_rays_hit_and_miss(bvh, rays):
    assert 0.2 < np.isfinite(bvh.closest_hit(*rays).t).mean() < 0.8


@pytest.mark.engine
@pytest.mark.parametrize("query", [one_by_one, together])
def test_results_are_those_of_the_tree(bvh, rays, query):
    assert same_bits(query(compiled.handle(bvh), *rays), bvh, rays)


def test_python_gets_the_same(bvh, rays):
    scene = compiled.handle(bvh)
    assert same_bits((*compiled.closest_hit(scene, *rays), compiled.any_hit(scene, *rays)), bvh, rays)
    single = [field[7] for field in rays]
    found = *compiled.closest_hit(scene, *single), compiled.any_hit(scene, *single)
    assert all(np.ndim(number) == 0 for number in found)
    assert same_bits([np.array([number]) for number in found], bvh, single)


def test_threads_may_share_a_handle(bvh, rays):
    scene = compiled.handle(bvh)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: one_by_one(scene, *rays), range(8)):
            assert same_bits(found, bvh, rays)


def test_prange_takes_a_handle(bvh, rays):
    o, d = rays[:2]
    assert np.array_equal(in_parallel(compiled.handle(bvh), o, d), bvh.closest_hit(o, d).t)


def test_a_row_is_shared_and_lengths_are_checked(bvh, rays):
    scene, (o, d, tmin, tmax) = compiled.handle(bvh), rays
    assert same_bits(together(scene, o[7:8], d, tmin, tmax), bvh, (o[7], d, tmin, tmax))
    with pytest.raises(ValueError, match="lengths do not match"):
        together(scene, o[:3], d, tmin, tmax)
    with pytest.raises(ValueError, match=r"expected 3 numbers or an \(n, 3\) array|got shape"):
        one_by_one(scene, np.ascontiguousarray(o[:, :2]), d, tmin, tmax)


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_code_of_another_layout_is_refused(bvh, rays):
    scene = compiled.handle(bvh)
    words = scene.closest.copy()
    words[LAYOUT] += 1
    with pytest.raises(RuntimeError, match="another release"):
        one_by_one(scene._replace(closest=words), *rays)


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_only_a_handle_is_a_scene(bvh):
    compiled_only = njit(lambda scene: compiled.any_hit(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    with pytest.raises(Exception, match="expected the result of"):
        compiled_only(bvh.tree)
