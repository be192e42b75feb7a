"""Noisy images: mean and variance of several images, and a statistical test of another one."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import LUMINANCE
from raytrace.image.metrics import ROUNDING


class Noise(NamedTuple):
    """Noise of the difference between an image and the mean of others."""

    deviation: NDArray[np.float64]  # (h, w): standard deviation of the difference of luminance
    freedom: int  # degrees of freedom


def mean_of(render: Callable[[int], Any], pictures: int, light: Callable[[Any], NDArray[np.float64]]) -> Any:
    """Mean light, and standard error of its luminance, of ``render(1)`` .. ``render(pictures)``.

    The variance is accumulated as in [Welford1962].
    """
    mean, spread = np.zeros(()), np.zeros(())
    luminance = np.zeros(())
    for k in range(1, pictures + 1):
        rgb = light(render(k))
        mean = mean + (rgb - mean) / k
        before = rgb @ LUMINANCE - luminance
        luminance = luminance + before / k
        spread = spread + before * (rgb @ LUMINANCE - luminance)
    return mean, np.sqrt(spread / (pictures - 1) / pictures)


def noise_of(rgb: NDArray[np.float64], stderr: NDArray[np.float64], pictures: int) -> Noise:
    """Noise of one image minus the mean of n = ``pictures`` images, whose standard error is s.

    A single image has variance n s^2, the mean has s^2.
    """
    light = np.abs(rgb @ LUMINANCE)
    deviation = np.sqrt(pictures + 1.0) * stderr
    return Noise(np.maximum(deviation, ROUNDING * (light + light.mean())), pictures - 1)


def in_deviations(difference: NDArray[np.float64], noise: Noise) -> NDArray[np.float64]:
    """Differences of luminance divided by their standard deviation; 0 / 0 is 0, and x / 0 is inf.

    >>> in_deviations(np.array([[0.0, -1.0, 1.0]]), Noise(np.array([[0.0, 0.0, 2.0]]), 3)).tolist()
    [[0.0, -inf, 0.5]]
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(difference == 0.0, 0.0, difference / noise.deviation)


def critical(noise: Noise, alpha: float, tests: int) -> float:
    """Critical value, in standard deviations: with probability alpha, at least one of ``tests`` exceeds it by chance.

    Student's t, two-sided, at the level 1 - (1 - alpha)^(1 / tests)   [Sidak1967].
    """
    from scipy.special import stdtrit  # comes with scikit-image

    level = -np.expm1(np.log1p(-alpha) / tests)
    return float(-stdtrit(noise.freedom, level / 2))
