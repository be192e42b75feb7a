"""Spectra of noise whose colour is known."""

import numpy as np
import pytest

from raytrace.reporting.crops import step_for, windows_of
from raytrace.reporting.spectrum import BINS, radial_power, spectrum_of
from synthetic_points import SOBOL, curve

SIZE = (64, 80, 3)


def noise(rng, colour):
    white = rng.standard_normal(SIZE)
    patches = sum(np.roll(white, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)) / 9
    return {"white": white, "red": patches, "blue": white - patches}[colour]


@pytest.mark.parametrize("colour", ["white", "red", "blue"])
def test_the_colour_of_noise_is_found(colour):
    rng = np.random.default_rng(1)
    found = spectrum_of(colour, [radial_power(noise(rng, colour)) for _ in range(6)])
    assert found.verdict.split(":")[0] == colour
    f = found.frequency * 2 * np.pi
    if colour == "white":
        np.testing.assert_allclose(found.power, 1.0, atol=0.25)
        assert found.interval.low < 1 < found.interval.high
    elif colour == "blue":  # along an axis, 1 minus the filter is about f^2 at low frequencies
        assert found.power[0] < 0.01
        assert found.power[0] < found.power[4] < found.power[8]
    assert len(f) == BINS


def test_white_noise_is_white_though_edges_have_more_of_it():
    rng = np.random.default_rng(2)
    envelope = np.zeros(SIZE)
    envelope[:, 30:33] = 1.0
    envelope[20:22] = 3.0
    found = spectrum_of("edges", [radial_power(envelope * rng.standard_normal(SIZE)) for _ in range(24)])
    assert found.interval.low < 1 < found.interval.high
    assert found.power[4:].mean() == pytest.approx(1.0, abs=0.1)


def test_the_mean_power_of_white_noise_lies_in_its_interval():
    rng = np.random.default_rng(3)
    found = [spectrum_of("", [radial_power(rng.standard_normal((16, 16))) for _ in range(6)]) for _ in range(200)]
    held = np.mean([each.interval.low <= 1 <= each.interval.high for each in found])
    assert held > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 200)


def test_a_constant_error_and_a_single_pixel_have_no_spectrum():
    assert np.isnan(radial_power(np.full((8, 8), 0.5))[1])
    assert np.isnan(radial_power(np.ones((1, 1, 3)))[1])
    assert spectrum_of("one", [radial_power(np.eye(8))]).verdict.startswith("unknown")


def test_windows_show_the_largest_errors_once_each():
    error = np.zeros((60, 90))
    error[40, 70], error[41, 72], error[5, 3] = 1.0, 0.5, 0.9
    (x, y, side), (u, v, _) = windows_of(error)
    assert side == 10
    assert x <= 70 < x + side
    assert y <= 40 < y + side
    assert (u, v) == (0, 0) or (u <= 3 < u + side and v <= 5 < v + side)
    assert abs(x - u) >= side or abs(y - v) >= side


def test_equal_time_takes_the_samples_that_fit():
    points = curve(SOBOL, lambda n: 0.1 / n, 0.01)
    assert step_for(points, 0.08) == 8
    assert step_for(points, 10.0) is None
    targets = [p._replace(configuration=SOBOL._replace(adaptive=True), step=0.01 * p.spp) for p in points]
    assert step_for(targets, 0.17) == pytest.approx(0.16)
