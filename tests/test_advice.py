"""Sentences from points whose best answer is known, and from random tables."""

import re

import numpy as np
import pytest

from raytrace.reporting.advice import recommendations, recommended, seconds_text, setting
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.precision_floor import Floor
from synthetic_points import DOUBLE, SOBOL, STRATIFIED, curve, point

MOLLER, BRUTE = (
    Configuration("sobol", "float32", triangle="moller-trumbore"),
    Configuration("sobol", "float32", tree="none"),
)
PEER = Configuration("independent", "float32", renderer="Mitsuba")
ADAPTIVE = Configuration("sobol", "float32", adaptive=True)


def sentences(points, floor=None):
    return recommendations(points, floor)


def test_the_first_sentence_names_a_measured_setting_and_what_float64_costs():
    points = curve(SOBOL, lambda n: 0.1 / n, 0.01) + curve(DOUBLE, lambda n: 0.1 / n, 0.019)
    points += curve(STRATIFIED, lambda n: 0.1 / n**0.5, 0.01)
    assert sentences(points, Floor(1e-7, 2e-7, 64, 6))[0] == (
        "For RMSE 0.01 on this scene: sobol, 16 spp, float32, 0.16 s; "
        "float64 costs 1.9x and gains nothing: the floor of float32 is far below all measured errors."
    )


def test_a_quicker_sampler_wins_where_it_gets_there():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(STRATIFIED, lambda n: 0.1 / n, 0.1)
    assert all("spp, float32" in line and ": stratified" in line for line in sentences(points)[:3])


def random_table(rng):
    """Points of six configurations with round, often equal, times and errors."""
    ways = [SOBOL, STRATIFIED, DOUBLE, ADAPTIVE, MOLLER, PEER]
    points = []
    for _ in range(int(rng.integers(1, 25))):
        seconds, error = rng.choice([0.1, 0.2, 0.4, 0.8], 2)
        squares = tuple(error**2 * rng.choice([0.5, 1.0, 1.5], 6))
        made = point(ways[rng.integers(len(ways))], int(rng.integers(1, 9)), seconds, np.sqrt(np.mean(squares)))
        points.append(made._replace(squares=squares, times=tuple(seconds * rng.choice([0.5, 1.0, 3.0], 6))))
    return points


def test_no_measured_setting_beats_a_recommended_one_in_time_and_error():
    rng, told = np.random.default_rng(5), 0
    for _ in range(100):
        points = random_table(rng)
        own = [p for p in points if p.configuration.selectable]
        for error in (0.1, 0.2, 0.3, 0.5, 0.9):
            best = recommended(points, error)
            if best is None:  # no point is below the error with certainty
                assert not [p for p in own if p.error.high <= error]
                continue
            told += 1
            assert best in own
            assert best.rmse_srgb <= error
            better = [p for p in own if p.seconds <= best.seconds and p.rmse_srgb <= best.rmse_srgb]
            assert {(p.seconds, p.rmse_srgb) for p in better} == {(best.seconds, best.rmse_srgb)}
    assert told > 150


def test_sentences_name_rows_of_the_table():
    rng = np.random.default_rng(6)
    for _ in range(50):
        points = random_table(rng)
        own = [p for p in points if p.configuration.selectable]
        rows = {f"{setting(p)}, {seconds_text(p.seconds)}" for p in own}
        for line in sentences(points):
            if found := re.match(r"For RMSE \S+ on this scene: (.*? s)[.;( ]", line):
                assert found[1] in rows


def test_settings_that_the_measurement_cannot_tell_apart_are_named():
    points = [point(SOBOL, 4, 1.0, 0.01), point(STRATIFIED, 4, 1.1, 0.01), point(DOUBLE, 4, 9.0, 0.01)]
    assert "stratified, 4 spp, float32: the same time within the intervals" in sentences(points)[0]
    far = [points[0], points[1]._replace(times=(9.0,) * 6), points[2]]
    assert "same time" not in sentences(far)[0]


def test_only_what_a_user_can_choose_is_recommended():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(MOLLER, lambda n: 0.1 / n, 0.1)
    points += curve(BRUTE, lambda n: 0.1 / n, 7.0)
    told = sentences(points)
    assert "sobol, 16 spp, float32, 16.00 s" in told[0]
    assert told[-1] == "Compared with the default, moller-trumbore costs 0.1x, no tree costs 7x."


def test_a_test_that_loses_triangles_is_told_by_its_error():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(MOLLER, lambda n: 0.1, 1.0)
    assert (
        sentences(points)[-1]
        == "Compared with the default, moller-trumbore costs the same within the intervals and has 64x the error."
    )


def test_float64_is_recommended_where_float32_never_gets_there():
    points = curve(SOBOL, lambda n: 0.1, 1.0) + curve(DOUBLE, lambda n: 0.1 / n, 2.0)
    told = sentences(points, Floor(0.09, 0.1, 64, 6))
    assert "sobol, 16 spp, float64" in told[0]
    assert told[0].endswith("; float64 costs 2x and gains accuracy below RMSE 0.3, where the floor of float32 counts.")


@pytest.mark.parametrize(("floor", "told"), [
    (Floor(0.0, 1e-9, 64, 6), "gains nothing: the floor"),
    (Floor(0.0, 1e-2, 64, 6), "below RMSE 0.03 takes more renders"),
    (Floor(1e-2, float("nan"), 64, 1), "float64 costs 2x."),
    (None, "float64 costs 2x."),
])  # fmt: skip
def test_what_float64_gains_depends_on_the_floor(floor, told):
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0) + curve(DOUBLE, lambda n: 0.1 / n, 2.0)
    assert told in sentences(points, floor)[0]


def test_costs_that_scatter_around_one_are_the_same():
    points = curve(SOBOL, lambda n: 0.1 / n, 1.0)
    noisy = [p._replace(configuration=BRUTE, times=tuple(reversed(p.times))) for p in points]
    assert sentences(points + noisy)[-1] == "Compared with the default, no tree costs the same within the intervals."


def test_a_single_point_still_gets_a_sentence():
    assert sentences(curve(SOBOL, lambda n: 0.03, 0.5, (4,))) == [
        "For RMSE 0.03 on this scene: sobol, 4 spp, float32, 2.00 s."
    ]
