"""Intervals, local slopes, costs and floors from synthetic renders whose truth is known."""

import math

import numpy as np
import pytest

from raytrace.reporting.equal_cost import costs_of, error_at, spp_at, time_to
from raytrace.reporting.intervals import UNKNOWN, log_half_width, of_mean, of_median, of_root_mean
from raytrace.reporting.precision_floor import PrecisionPairs, floor_of
from raytrace.reporting.slopes import slope_between, slopes_of
from synthetic_points import DOUBLE, SOBOL, STRATIFIED, curve, point

TRIALS = 1000


def covers(held, level=0.95):
    """Whether a share agrees with a probability: four standard errors, wrong once in 16,000."""
    return abs(held - level) < 4 * math.sqrt(level * (1 - level) / TRIALS)


@pytest.mark.parametrize(("n", "k", "level"), [(6, 1, 1 - 2 / 64), (8, 1, 1 - 2 / 256), (16, 4, 0.97874)])
def test_the_median_lies_in_its_interval_as_often_as_the_binomial_says(n, k, level):
    rng = np.random.default_rng(n)
    times = np.exp(rng.standard_exponential((TRIALS, n)))  # other work only adds time: skewed, with a long tail
    found = [of_median(row) for row in times]
    assert tuple(found[0]) == (np.sort(times[0])[k - 1], np.sort(times[0])[n - k])
    assert covers(np.mean([a <= math.exp(math.log(2)) <= b for a, b in found]), level)


def test_five_times_have_no_interval():
    assert of_median([1.0] * 5) is UNKNOWN
    assert of_root_mean([1.0]) is UNKNOWN
    assert of_mean([1.0]) is UNKNOWN
    assert math.isnan(log_half_width(UNKNOWN))


@pytest.mark.parametrize("n", [6, 16])
def test_the_error_lies_in_its_interval_in_95_of_100_reports(n):
    rng = np.random.default_rng(n)
    squares = 0.01**2 * (1 + 0.1 * rng.standard_normal((TRIALS, n)))
    assert covers(np.mean([a <= 0.01 <= b for a, b in map(of_root_mean, squares)]))


def renders(way, spp, error, factors):
    """A point whose renders have these MSE, relative to the square of its error."""
    squares = tuple(float(error**2 * f) for f in factors)
    return point(way, spp, 0.01 * spp, math.sqrt(np.mean(squares)))._replace(squares=squares)


def test_a_slope_is_exact_without_scatter_and_its_interval_covers():
    few, many = (renders(SOBOL, n, 0.3 * n**-0.75, [1.0] * 6) for n in (16, 32))
    assert slope_between(few, many).slope == pytest.approx(-0.75)
    rng, held, width = np.random.default_rng(2), 0, []
    for _ in range(TRIALS):
        shared = 0.15 * rng.standard_normal(6)  # equal seeds: most of the variance is common to both
        scatter = [1 + shared + 0.05 * rng.standard_normal(6) for _ in range(2)]
        found = slope_between(*(renders(SOBOL, n, n**-0.75, s) for n, s in zip((16, 32), scatter, strict=True)))
        held += found.interval.low <= -0.75 <= found.interval.high
        width.append(found.interval.high - found.interval.low)
    assert covers(held / TRIALS)
    # t(5) = 2.57, s = 0.05 sqrt(2): pairs cancel what is common
    assert np.mean(width) == pytest.approx(2 * 2.571 * 0.05 * math.sqrt(2 / 6) / math.log(4), rel=0.1)


def test_a_slope_with_a_wide_interval_is_withheld():
    noisy = [renders(SOBOL, n, 1 / n, (0.5, 2, 0.7, 1.4, 1, 0.4)[:: 1 if n == 1 else -1]) for n in (1, 2)]
    assert not slope_between(*noisy).certain
    alone = [p._replace(squares=p.squares[:1]) for p in noisy]
    assert slope_between(*alone).interval is UNKNOWN
    assert not slope_between(*alone).certain


def test_local_slopes_follow_a_bent_curve():
    bent = curve(STRATIFIED, lambda n: 1 / n if n <= 4 else 0.5 * n**-0.5, 1.0)
    found = slopes_of([*bent, *curve(SOBOL._replace(adaptive=True), lambda n: 1 / n, 1.0)])
    assert [(each.spp, round(each.slope, 9)) for each in found] == [((1, 4), -1.0), ((4, 16), -0.5), ((16, 64), -0.5)]
    assert all(each.certain for each in found)


def test_costs_lie_on_the_power_law_between_the_points():
    points = curve(SOBOL, lambda n: 0.1 / n, 0.5)
    assert time_to(points, 0.1 / 8).value == pytest.approx(4.0)
    assert error_at(points, 4.0).value == pytest.approx(0.1 / 8)
    assert spp_at(points, 4.0) == pytest.approx(8)
    assert time_to(points, 0.1 / 64).value == pytest.approx(32.0)
    assert [math.isnan(time_to(points, e).value) for e in (0.2, 0.1 / 65)] == [True, True]
    table = costs_of([*points, *curve(DOUBLE, lambda n: 0.1 / n, 1.0)])
    assert table.targets == tuple(sorted(table.targets, reverse=True))
    for one, two in zip(table.rows[0].times, table.rows[1].times, strict=True):
        assert two.value == pytest.approx(2 * one.value)


def test_the_interval_of_an_interpolated_time_has_the_true_time():
    """Errors scatter by a tenth of their square, times by a tenth; half-widths of neighbours add up, so it is wider."""
    rng, held = np.random.default_rng(3), 0
    for _ in range(TRIALS // 4):
        points = [
            renders(SOBOL, n, 0.1 / n, 1 + 0.1 * rng.standard_normal(6))._replace(
                times=tuple(n * np.exp(0.1 * rng.standard_normal(6)))
            )
            for n in (4, 8)
        ]
        interval = time_to(points, 0.1 / 5.6).interval
        held += interval.low <= 5.6 <= interval.high
    assert held >= 0.95 * TRIALS // 4


def test_a_floor_is_found_below_noise_that_is_much_larger():
    rng = np.random.default_rng(4)
    bias = 1e-4 * rng.standard_normal((32, 32, 3))
    found = floor_of([bias + 5e-4 * rng.standard_normal(bias.shape) for _ in range(6)], 256)
    actual = math.sqrt(np.mean(bias**2))
    assert found.rmse_srgb == pytest.approx(actual, rel=0.15)
    assert actual < found.high < 2 * actual
    nothing = [floor_of([5e-4 * rng.standard_normal(bias.shape) for _ in range(6)], 256) for _ in range(40)]
    assert np.mean([each.rmse_srgb**2 for each in nothing]) < (5e-5) ** 2  # noise alone: ten times smaller, or zero
    assert any(each.rmse_srgb == 0.0 for each in nothing)
    assert all(each.high < 1e-4 for each in nothing)


def test_precisions_are_paired_by_samples_and_seed():
    pairs = PrecisionPairs()
    for number, spps in enumerate([(1, 4), (4,), (4,)]):
        for spp in spps:
            pairs.add("float32", spp, number, np.full((2, 2, 3), 0.5 + 0.1 / spp))
            pairs.add("float64", spp, number, np.full((2, 2, 3), 0.5))
    assert pairs.gaps == pytest.approx({1: 0.1, 4: 0.025})
    assert (pairs.floor.spp, pairs.floor.renders) == (4, 3)
    assert pairs.floor.rmse_srgb == pytest.approx(0.025, rel=1e-6)
    assert PrecisionPairs().floor is None
