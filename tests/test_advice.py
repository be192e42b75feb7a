"""Sentences from points whose best answer is known."""

import re

import pytest

from raytrace.reporting.advice import nice_errors, recommendations, useless_below
from raytrace.reporting.analysis import fit_order, needed, orders_of
from raytrace.reporting.configurations import Configuration
from synthetic_points import DOUBLE, SOBOL, STRATIFIED, curve

MOLLER, BRUTE = (
    Configuration("sobol", "float32", triangle="moller-trumbore"),
    Configuration("sobol", "float32", tree="none"),
)


def sentences(points, gaps=None):
    return recommendations(points, orders_of(points), gaps or {})


def test_the_first_sentence_names_the_quickest_way_and_what_float64_costs():
    points = curve(SOBOL, lambda n: 0.1 / n, 0.01) + curve(DOUBLE, lambda n: 0.1 / n, 0.019)
    points += curve(STRATIFIED, lambda n: 0.1 / n**0.5, 0.01)
    told = sentences(points, {64: 1e-5})
    # 0.1 / n = 0.02 needs 5 spp; a third of the error is the gap where 0.1 / n = 3e-5
    assert told[0] == (
        "For RMSE 0.02 on this scene: sobol, 5 spp, float32, 0.05 s; "
        "float64 costs 1.9x and gains nothing below 3,300 spp."
    )
    assert "The error shrinks: sobol as spp^-1.00, stratified as spp^-0.50." in told


def test_a_quicker_sampler_wins_where_it_gets_there():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(STRATIFIED, lambda n: 0.1 / n, 0.5)
    assert all("stratified" in line for line in sentences(points)[:3])


def test_no_point_that_was_measured_beats_the_advice():
    """Times are noisy: here 1 sample took longer than 4 did."""
    points = curve(SOBOL, lambda n: {1: 0.02, 4: 0.00287}.get(n, 0.001), 0.0)
    points += curve(STRATIFIED, lambda n: {1: 0.03, 4: 0.0049}.get(n, 0.002), 0.0)
    seconds = {(SOBOL, 1): 0.09, (SOBOL, 4): 0.0691, (STRATIFIED, 1): 0.06, (STRATIFIED, 4): 0.071}
    points = [point._replace(times=(seconds.get((point.configuration, point.spp), 0.5),)) for point in points]
    for error in (0.02, 0.01, 0.005, 0.003):
        for way in (SOBOL, STRATIFIED):
            mine = [point for point in points if point.configuration == way]
            reached = [point.seconds for point in mine if point.rmse_srgb <= error]
            assert needed(mine, error)[1] <= min(reached)
    (line,) = [line for line in sentences(points) if line.startswith("For RMSE 0.005 ")]
    assert "sobol, 4 spp" in line


def test_an_order_that_is_uncertain_says_so():
    points = [point for point in curve(SOBOL, lambda n: 0.1 / n, 0.01) if point.spp <= 16]
    noisy = [point._replace(rmse_srgb=point.rmse_srgb * f) for point, f in zip(points, (1, 2, 1) * 9, strict=False)]
    (line,) = [line for line in sentences(noisy[:3]) if line.startswith("The error shrinks")]
    assert re.search(r"sobol as spp\^-?[\d.]+ \(95 % interval -?[\d.]+ to -?[\d.]+, from 3 points\)", line)


def test_only_what_a_user_can_choose_is_recommended():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(MOLLER, lambda n: 0.1 / n, 0.1)
    points += curve(BRUTE, lambda n: 0.1 / n, 7.0)
    told = sentences(points)
    assert "sobol, 5 spp, float32, 5.00 s" in told[0]
    assert told[-1] == "Compared with the default, moller-trumbore costs 0.1x, no tree costs 7x."


def test_a_test_that_loses_triangles_is_told_by_its_error():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(MOLLER, lambda n: 0.1, 1.0)
    assert sentences(points)[-1] == "Compared with the default, moller-trumbore costs 1x and has 64x the error."


def test_float64_is_recommended_where_float32_never_gets_there():
    points = curve(SOBOL, lambda n: 0.1, 1.0) + curve(DOUBLE, lambda n: 0.1 / n, 2.0)
    told = sentences(points, {64: 0.1})
    assert "sobol, 5 spp, float64" in told[0]
    assert told[0].endswith("; float64 costs 2x and is needed: the error of float32 is larger than the noise.")


def test_equal_pictures_in_both_precisions_make_float64_useless():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(DOUBLE, lambda n: 0.1 / n, 2.0)
    assert sentences(points, {64: 0.0})[0].endswith("; float64 costs 2x and gains nothing.")


def test_one_ray_that_differs_does_not_make_float64_needed():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(DOUBLE, lambda n: 0.1 / n, 2.0)
    assert "nothing below 3,300 spp" in sentences(points, {1: 1e-5, 4: 1e-5, 16: 1e-5, 64: 1e-2})[0]
    assert sentences(points, {1: 1e-8, 4: 1e-8, 16: 1e-8})[0].endswith(
        "gains nothing."
    )  # past the most samples there are


@pytest.mark.parametrize("order", [-0.5, -1.0])
def test_the_difference_of_precisions_is_a_third_of_the_error_there(order):
    fit = fit_order(SOBOL, [1, 4, 16], [0.2 * n**order for n in (1, 4, 16)])
    spp = useless_below(fit, 1e-4)
    assert 0.2 * spp**order == pytest.approx(3e-4)


def test_errors_are_round_numbers_inside_what_was_measured():
    assert nice_errors(curve(SOBOL, lambda n: 0.1 / n, 1.0)) == [0.1, 0.02, 0.002]
    assert nice_errors(curve(SOBOL, lambda n: 0.03, 1.0)) == [0.03]
    assert nice_errors(curve(SOBOL, lambda n: 0.0, 1.0)) == []


def test_a_single_point_still_gets_a_sentence():
    assert sentences(curve(SOBOL, lambda n: 0.03, 0.5, (4,))) == [
        "For RMSE 0.03 on this scene: sobol, 4 spp, float32, 2.00 s."
    ]
