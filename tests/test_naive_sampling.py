"""The twins of the samplers, against SciPy and what the theory promises."""

import numpy as np
import pytest

import naive_sampling as twin

PIXELS = [(0, 0, 0), (7, 3, 1), (2**32 - 1, 511, 300)]  # seed, x, y


def points(sampler, seed, x, y, n):
    return twin.film_points(sampler, seed, n, (x, y, 1, 1))[0, 0] - [x, y]


def test_raw_points_are_those_of_scipy():
    qmc = pytest.importorskip("scipy.stats.qmc")
    theirs = qmc.Sobol(2, scramble=False).random(256)
    index = np.arange(256, dtype=np.uint64)
    index ^= index >> np.uint64(1)  # SciPy walks in Gray code order
    ours = np.stack([twin.to_unit(twin.sobol_raw(index, dim)) for dim in (0, 1)], axis=1)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("pixel", PIXELS)
@pytest.mark.parametrize("m", [1, 4, 8])
def test_scrambled_points_keep_one_in_every_elementary_interval(pixel, m):
    n = 2**m
    u = points("sobol", *pixel, n)
    for k in range(m + 1):  # boxes of 2^-k x 2^-(m-k): a (0, m, 2)-net
        cells = np.floor(u * [2**k, 2 ** (m - k)]).astype(int)
        assert len({tuple(cell) for cell in cells}) == n


def test_scrambling_differs_between_pixels_and_seeds():
    sets = [points("sobol", *pixel, 16) for pixel in PIXELS]
    assert len(np.unique(np.concatenate(sets), axis=0)) == 48


@pytest.mark.parametrize("spp", [1, 4, 6, 7, 16])
@pytest.mark.parametrize("pixel", PIXELS)
def test_stratified_points_share_no_cell(pixel, spp):
    u = points("stratified", *pixel, spp)
    nx = int(np.ceil(np.sqrt(spp)))
    ny = int(np.ceil(spp / nx))
    cells = np.floor(u * [nx, ny] + 2.0**-20).astype(int)
    assert len({tuple(cell) for cell in cells}) == spp


@pytest.mark.parametrize("cells", [2, 4, 8, 16])
@pytest.mark.parametrize("sampler", ["independent", "sobol", "stratified"])
def test_one_sample_may_lie_anywhere_in_its_pixel(sampler, cells):
    """x and y together, of the first sample of 2^16 pixels: no net hides a place that is preferred."""
    u = twin.film_points(sampler, 9, 1, (0, 0, 256, 256)) % 1
    counts, _, _ = np.histogram2d(u[..., 0].ravel(), u[..., 1].ravel(), bins=cells, range=[(0, 1), (0, 1)])
    chi2, freedom = np.sum((counts - counts.mean()) ** 2) / counts.mean(), cells**2 - 1
    assert (chi2 - freedom) / np.sqrt(2 * freedom) < 4.4  # normal for many degrees; for 3 of them alpha is 1e-4


@pytest.mark.parametrize("cells", [2, 4, 8, 16])
@pytest.mark.parametrize("dim", [0, 1])
@pytest.mark.parametrize("step", [(1, 0), (0, 1)])
def test_first_samples_of_neighbours_know_nothing_of_each_other(step, dim, cells):
    x, y = np.meshgrid(*[np.arange(256, dtype=np.uint64)] * 2)
    here = twin.owen_sobol(4, x, y, np.uint64(0), dim)
    there = twin.owen_sobol(4, x + np.uint64(step[0]), y + np.uint64(step[1]), np.uint64(0), dim)
    counts, _, _ = np.histogram2d(here.ravel(), there.ravel(), bins=cells, range=[(0, 1), (0, 1)])
    chi2, freedom = np.sum((counts - counts.mean()) ** 2) / counts.mean(), cells**2 - 1
    assert (chi2 - freedom) / np.sqrt(2 * freedom) < 4.4


@pytest.mark.parametrize("pixel", PIXELS)
def test_sobol_points_come_in_pairs_that_mirror_each_other(pixel):
    u = points("sobol", *pixel, 64)
    np.testing.assert_array_equal(u[::2] + u[1::2], 1 - 2.0**-24)


@pytest.mark.parametrize("sampler", ["independent", "sobol", "stratified"])
def test_numbers_are_uniform_over_the_film(sampler):
    u = twin.film_points(sampler, 5, 4, (0, 0, 64, 64)) % 1
    counts, _, _ = np.histogram2d(u[..., 0].ravel(), u[..., 1].ravel(), bins=8, range=[(0, 1), (0, 1)])
    chi2 = np.sum((counts - counts.mean()) ** 2) / counts.mean()
    assert chi2 < 133  # 63 degrees of freedom; of mirrored pairs 32, each twice: alpha is 1e-5


def test_neighbours_in_every_argument_are_uncorrelated():
    base = twin.uniform(3, *np.meshgrid(*[np.arange(64, dtype=np.uint64)] * 2), np.uint64(0), 0)
    for seed, dx, s, dim in ((4, 0, 0, 0), (3, 1, 0, 0), (3, 0, 1, 0), (3, 0, 0, 1)):
        x, y = np.meshgrid(np.arange(64, dtype=np.uint64) + np.uint64(dx), np.arange(64, dtype=np.uint64))
        r = np.corrcoef(base.ravel(), twin.uniform(seed, x, y, np.uint64(s), dim).ravel())[0, 1]
        assert abs(r) < 3.9 / 64  # standard error 1 / sqrt(4096), alpha = 1e-4


def test_mix_is_a_bijection_on_a_sample_and_integers_agree_with_arrays():
    h = np.arange(2**16, dtype=np.uint64) * np.uint64(65521)
    assert len(np.unique(twin.mix(h & np.uint64(twin.MASK)))) == 2**16
    for seed, x, y in PIXELS:
        for draw, extra in ((twin.uniform, ()), (twin.owen_sobol, ()), (twin.stratified, (6,))):
            one = draw(seed, x, y, 5, 1, *extra)
            assert one == draw(seed, *(np.array([a], np.uint64) for a in (x, y, 5)), 1, *extra)[0]


# --- how fast means converge -----------------------------------------------------------------------------------------

COUNTS = 4, 16, 64, 256


def half_planes(count, seed=1):
    """Edges (cos, sin, c) at any angle and place: white where cos x + sin y < c; and how much of the pixel that is."""
    rng = np.random.default_rng(seed)
    angle, c = rng.uniform(0, np.pi / 2, count), rng.uniform(0, 1, count)
    cos, sin = np.cos(angle), np.sin(angle)
    c = c * (cos + sin)
    # twice the triangle below the line, without its corners beyond the square
    area = (c**2 - np.maximum(c - cos, 0) ** 2 - np.maximum(c - sin, 0) ** 2) / (2 * cos * sin)
    return np.stack([cos, sin, c]), area


def order(sampler, integrate):
    """Slope of log RMSE over log samples, over 1024 pixels; integrate gives the errors of points (pixels, n, 2)."""
    rmse = [np.sqrt(np.mean(integrate(twin.film_points(sampler, 2, n, (0, 0, 32, 32)) % 1) ** 2)) for n in COUNTS]
    return np.polyfit(np.log(COUNTS), np.log(rmse), 1)[0]


def edge_errors(points):
    edges, area = half_planes(32)
    return np.stack([(points @ e[:2] < e[2]).mean(axis=-1) - a for e, a in zip(edges.T, area, strict=True)])


def smooth_errors(points):
    return np.exp(points.sum(axis=-1)).mean(axis=-1) - (np.e - 1) ** 2


@pytest.mark.parametrize(
    ("sampler", "edge", "smooth"),
    [("independent", -0.5, -0.5), ("stratified", -0.75, -1.0), ("sobol", -0.75, -1.33)],
)
def test_errors_converge_as_theory_has_it(sampler, edge, smooth):
    """Nets: n^-3/4 for edges [He2015], n^-3/2 log(n)^1/2 for what is smooth [Owen1997], -1.33 here. Jitter: n^-1."""
    assert order(sampler, edge_errors) == pytest.approx(edge, abs=0.05)
    assert order(sampler, smooth_errors) == pytest.approx(smooth, abs=0.1)


def test_mirrored_pairs_leave_no_error_on_a_slope():
    points = twin.film_points("sobol", 2, 2, (0, 0, 16, 16)) % 1
    assert np.abs((points @ [1.0, 0.7]).mean(axis=-1) - 0.85).max() < 1e-7
