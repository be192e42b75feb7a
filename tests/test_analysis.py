"""Fits, fronts and interpolation on numbers whose answer is known."""

import numpy as np
import pytest
from scipy import stats

from raytrace.reporting.analysis import curves_of, fit_order, needed, orders_of, pareto
from raytrace.reporting.configurations import Configuration
from synthetic_points import DOUBLE, SOBOL, STRATIFIED, curve, point


def test_an_exact_power_is_found_exactly():
    spp = np.array([1, 2, 4, 8, 16])
    fit = fit_order(SOBOL, spp, 0.3 * spp**-0.75)
    assert (fit.order, fit.at_one, fit.points) == (pytest.approx(-0.75), pytest.approx(0.3), 5)
    assert fit.high - fit.low == pytest.approx(0.0, abs=1e-12)


def test_the_interval_is_that_of_a_linear_regression():
    rng = np.random.default_rng(3)
    spp = 2.0 ** np.arange(9)
    error = spp**-0.6 * np.exp(0.1 * rng.standard_normal(9))
    expected = stats.linregress(np.log(spp), np.log(error))
    half = stats.t(7).ppf(0.975) * expected.stderr
    fit = fit_order(SOBOL, spp, error)
    assert (fit.order, fit.at_one) == (pytest.approx(expected.slope), pytest.approx(np.exp(expected.intercept)))
    assert (fit.low, fit.high) == (pytest.approx(expected.slope - half), pytest.approx(expected.slope + half))


def test_the_interval_holds_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(1)
    spp = 2.0 ** np.arange(6)
    fits = [fit_order(SOBOL, spp, spp**-0.5 * np.exp(0.2 * rng.standard_normal(6))) for _ in range(2000)]
    held = np.mean([fit.low <= -0.5 <= fit.high for fit in fits])
    assert abs(held - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 2000)  # four standard errors: wrong once in 16,000


def test_two_points_have_an_order_and_no_interval():
    fit = fit_order(SOBOL, [1, 4], [1.0, 0.5])
    assert fit.order == pytest.approx(-0.5)
    assert np.isnan([fit.low, fit.high]).all()


def test_each_sampler_has_an_order_and_another_triangle_test_has_none():
    points = curve(SOBOL, lambda n: 1 / n, 1.0) + curve(STRATIFIED, lambda n: n**-0.5, 1.0)
    points += curve(Configuration("sobol", "float32", triangle="moller-trumbore"), lambda n: 1 / n, 1.0)
    points += curve(DOUBLE, lambda n: 1 / n, 1.0, (1, 4))  # two points are too few
    assert [(fit.configuration, round(fit.order, 9)) for fit in orders_of(points)] == [
        (SOBOL, -1.0),
        (STRATIFIED, -0.5),
    ]


def test_a_picture_without_error_has_no_logarithm_and_is_left_out_of_the_fit():
    fits = orders_of([*curve(SOBOL, lambda n: 1 / n, 1.0), point(SOBOL, 256, 256.0, 0.0)])
    assert [(round(fit.order, 9), fit.points) for fit in fits] == [(-1.0, 4)]


def test_the_front_holds_what_nothing_beats():
    quick, slow, beaten, twin = ((1.0, 0.5), (4.0, 0.1), (4.0, 0.2), (1.0, 0.5))
    points = [point(SOBOL, 1, *numbers) for numbers in (quick, slow, beaten, twin)]
    assert pareto(points) == [True, True, False, True]


def test_errors_that_differ_by_rounding_are_no_progress():
    points = [point(SOBOL, 1, 1.0, 0.1), point(SOBOL, 1, 2.0, 0.0999), point(SOBOL, 1, 3.0, 0.098)]
    assert pareto(points) == [True, False, True]


def test_no_front_has_a_point_that_is_slower_and_worse():
    rng = np.random.default_rng(7)
    points = [point(SOBOL, 1, *numbers) for numbers in rng.integers(1, 9, (60, 2)).astype(float)]
    front = pareto(points)
    for p, kept in zip(points, front, strict=True):
        better = [q for q in points if (q.seconds < p.seconds and q.rmse_srgb <= p.rmse_srgb) or
                  (q.seconds <= p.seconds and q.rmse_srgb < p.rmse_srgb)]  # fmt: skip
        assert kept == (not better)


def test_what_an_error_needs_lies_on_the_power_law_between_the_points():
    points = curve(SOBOL, lambda n: 0.1 / n, 0.5)
    assert needed(points, 0.1 / 8) == (pytest.approx(8), pytest.approx(4.0))
    assert needed(points, 0.5) == (1, 0.5)
    assert needed(points, 0.1 / 64) == (pytest.approx(64), pytest.approx(32.0))
    assert needed(points, 0.1 / 65) is None


def test_curves_keep_their_points_in_order():
    points = curve(SOBOL, lambda n: 1 / n, 1.0) + curve(DOUBLE, lambda n: 1 / n, 1.0)
    curves = curves_of(points)
    assert list(curves) == [SOBOL, DOUBLE]
    assert [p.spp for p in curves[SOBOL]] == [1, 4, 16, 64]
