"""Mean, variance and levels of noisy pictures, against NumPy and SciPy."""

import numpy as np
import pytest
from scipy import stats

from raytrace.golden.noise import Noise, critical, mean_of, noise_of
from raytrace.image.files import LUMINANCE


def draw(seed):
    return np.random.default_rng(seed).uniform(size=(5, 4, 3))


def test_mean_and_error_are_those_of_numpy():
    rgb, stderr = mean_of(draw, 7, np.asarray)
    pictures = np.array([draw(seed) for seed in range(1, 8)])
    np.testing.assert_allclose(rgb, pictures.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(stderr, (pictures @ LUMINANCE).std(axis=0, ddof=1) / np.sqrt(7), rtol=1e-13)


def test_a_picture_is_off_the_mean_by_its_own_noise_and_that_of_the_mean():
    stderr = np.full((2, 2), 0.1)
    noise = noise_of(np.ones((2, 2, 3)), stderr, 16)
    np.testing.assert_allclose(noise.deviation, np.sqrt(0.1**2 * 16 + 0.1**2))
    assert noise.freedom == 15


@pytest.mark.parametrize("tests", [1, 36, 10_000])
def test_the_level_is_corrected_for_the_number_of_tests(tests):
    level = 1 - 0.99 ** (1 / tests)
    assert critical(Noise(np.ones((1, 1)), 63), 0.01, tests) == pytest.approx(stats.t.isf(level / 2, 63), rel=1e-6)


def test_one_test_of_many_is_beyond_in_a_share_alpha_of_cases():
    rng = np.random.default_rng(3)
    largest = np.abs(rng.standard_t(15, size=(4000, 200))).max(axis=1)
    share = (largest > critical(Noise(np.ones((1, 1)), 15), 0.05, 200)).mean()
    assert share == pytest.approx(0.05, abs=0.012)  # 3.5 standard deviations of a share of 4000
