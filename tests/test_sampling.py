"""The samplers' kernels against their twins in plain integers, bit for bit."""

import math

import numpy as np
import pytest

import naive_sampling as twin
import rays
from raytrace.accel.lanes import load, packet, packet_width, store
from raytrace.jit import kernel
from raytrace.passes.sampling import Independent, Sobol, Stratified, film_sample, make_sampler, pixel_key

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")
SAMPLERS = ("sobol", "stratified", "independent")
SEEDS = (0, 1, 2**32 - 1)


@kernel
def draw(sampler, x, y, first, last, out):
    """Points (2, last - first, pixels) of the samples of pixels, into flat ``out``."""
    like = packet(out)
    pixels, samples = len(x), last - first
    for i in range(0, pixels, packet_width(out)):
        pixel = pixel_key(sampler.seed, load(x, i, like), load(y, i, like))
        for s in range(first, last):
            u, v = film_sample(sampler, pixel, s, like)
            store(out, (s - first) * pixels + i, u)
            store(out, (samples + s - first) * pixels + i, v)


def pixels():
    """Pixels of a film up to the largest, a multiple of every packet's width."""
    rng = np.random.default_rng(1)
    return np.concatenate([np.arange(16, dtype=np.uint32), rng.integers(0, 2**20, 16, np.uint32)]), np.concatenate(
        [np.zeros(16, np.uint32), rng.integers(0, 2**20, 16, np.uint32)]
    )


def drawn(sampler, precision, first, last):
    x, y = pixels()
    out = np.empty(2 * (last - first) * len(x), precision)
    draw(sampler, x, y, first, last, out)
    return out.reshape(2, last - first, len(x))


def expected(name, seed, spp, precision, first, last):
    """The twin's points, each operation rounded to the precision."""
    x, y = (a.astype(np.uint64) for a in pixels())
    s = np.arange(first, last, dtype=np.uint64)[:, None]
    if name == "sobol":
        return np.stack([twin.owen_sobol(seed, x, y, s, dim) for dim in (0, 1)]).astype(precision)
    jitter = np.stack([twin.uniform(seed, x, y, s, dim) for dim in (0, 1)]).astype(precision)
    if name == "independent":
        return jitter
    columns = int(np.ceil(np.sqrt(spp)))
    rows = -(-spp // columns)
    n = columns * rows
    step = max(k for k in range(1, max(round(n * (5**0.5 - 1) / 2), 1) + 1) if math.gcd(k, n) == 1)
    cell = (s % n * step + twin.key(seed, x, y, 2) % n) % n
    cells = np.stack([cell % columns, cell // columns]).astype(precision)
    points = (cells + jitter) / np.array([columns, rows], precision)[:, None, None]
    return np.minimum(points, np.array(1 - 2.0**-24, precision))


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")  # uint32 arithmetic wraps around
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", SAMPLERS)
def test_points_have_the_bits_of_the_twins(name, precision):
    for seed in SEEDS:
        for spp in (1, 5, 16):
            sampler = make_sampler(name, seed, spp)
            for first, last in ((0, spp), (7, 9)):
                points = drawn(sampler, precision, first, last)
                assert rays.same_bits(points, expected(name, seed, spp, precision, first, last))
                assert (points >= 0).all()
                assert (points < 1).all()


@pytest.mark.parametrize("name", SAMPLERS)
def test_points_of_far_samples_have_the_bits_of_the_twins(name):
    far = 2**20
    got = drawn(make_sampler(name, 3, far), "float64", far - 8, far)
    assert rays.same_bits(got, expected(name, 3, far, "float64", far - 8, far))


@pytest.mark.parametrize("spp", [1, 2, 6, 7, 12, 16])
def test_stratified_points_fill_each_cell_once(spp):
    sampler = make_sampler("stratified", 5, spp)
    columns, rows = int(sampler.columns), int(sampler.rows)
    assert columns * rows >= spp
    u, v = drawn(sampler, "float64", 0, columns * rows)
    cells = np.sort(np.floor(u * columns) + columns * np.floor(v * rows), axis=0)
    assert (cells == np.arange(columns * rows)[:, None]).all()
    if spp > 2:  # pixels begin with cells of their own
        assert len(np.unique(np.floor(u[0] * columns) + columns * np.floor(v[0] * rows))) > 1


@pytest.mark.parametrize("m", [1, 3, 6])
def test_sobol_points_fill_all_elementary_intervals(m):
    u, v = drawn(make_sampler("sobol", 6, 4**m), "float64", 0, 4**m)
    for columns in 4**m >> np.arange(2 * m + 1):
        cells = np.sort(np.floor(u * columns) * (4**m // columns) + np.floor(v * (4**m // columns)), axis=0)
        assert (cells == np.arange(4**m)[:, None]).all()


@pytest.mark.parametrize("m", [1, 2, 5, 8])
def test_sobol_points_come_in_pairs_that_mirror_each_other(m):
    points = drawn(make_sampler("sobol", 8, 2**m), "float64", 0, 2**m)
    np.testing.assert_array_equal(points[:, ::2] + points[:, 1::2], 1 - 2.0**-24)


@pytest.mark.parametrize("name", SAMPLERS)
def test_both_precisions_sample_the_same_places(name):
    sampler = make_sampler(name, 7, 16)
    difference = drawn(sampler, "float32", 0, 16) - drawn(sampler, "float64", 0, 16)
    assert np.abs(difference).max() <= (2.0**-24 if name == "stratified" else 0)  # its division is rounded


@pytest.mark.parametrize("precision", PRECISIONS)
def test_no_rounding_brings_a_point_to_one(precision):
    """The jitter of this sample is so near 1 that adding its cell rounds it up in float32."""
    x, y = np.full(16, 1269, np.uint32), np.full(16, 150, np.uint32)
    out = np.empty(32, precision)
    draw(make_sampler("stratified", 0, 64), x, y, 56, 57, out)
    assert out[-1] > 1 - 1e-6
    assert out[-1] < 1


@pytest.mark.nojit
def test_samplers_have_names():
    assert isinstance(make_sampler("sobol", 1, 9), Sobol)
    assert isinstance(make_sampler("independent", 1, 9), Independent)
    assert make_sampler("stratified", 1, 10) == Stratified(1, 4, 3, 7)
    with pytest.raises(KeyError):
        make_sampler("halton", 1, 9)
