"""Noisy pictures: the mean and the variance of several, and a test of one more against them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import LUMINANCE
from raytrace.image.metrics import ROUNDING


class Noise(NamedTuple):
    """What the difference of a picture from the mean of others may be by chance."""

    deviation: NDArray[np.float64]  # (h, w): standard deviation of the difference of luminance
    freedom: int  # degrees of it


def mean_of(draw: Callable[[int], Any], pictures: int, light: Callable[[Any], NDArray[np.float64]]) -> Any:
    """Mean light and standard error of the luminance of ``draw(1)`` .. ``draw(pictures)``, one after the other.

    The squares of differences are summed as in [Welford1962].
    """
    mean, spread = np.zeros(()), np.zeros(())
    luminance = np.zeros(())
    for k in range(1, pictures + 1):
        rgb = light(draw(k))
        mean = mean + (rgb - mean) / k
        before = rgb @ LUMINANCE - luminance
        luminance = luminance + before / k
        spread = spread + before * (rgb @ LUMINANCE - luminance)
    return mean, np.sqrt(spread / (pictures - 1) / pictures)


def noise_of(rgb: NDArray[np.float64], stderr: NDArray[np.float64], pictures: int) -> Noise:
    """Noise of one more picture, against the mean of ``pictures``, whose standard error is s.

    One picture has the variance n s^2, the mean s^2.
    """
    light = np.abs(rgb @ LUMINANCE)
    deviation = np.sqrt(pictures + 1.0) * stderr
    return Noise(np.maximum(deviation, ROUNDING * (light + light.mean())), pictures - 1)


def in_deviations(difference: NDArray[np.float64], noise: Noise) -> NDArray[np.float64]:
    """Differences of luminance in deviations; where there is no deviation, none is 0, and any is inf.

    >>> in_deviations(np.array([[0.0, -1.0, 1.0]]), Noise(np.array([[0.0, 0.0, 2.0]]), 3)).tolist()
    [[0.0, -inf, 0.5]]
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(difference == 0.0, 0.0, difference / noise.deviation)


def critical(noise: Noise, alpha: float, tests: int) -> float:
    """How many deviations a difference may be off, if one of ``tests`` is to be beyond in a share alpha of cases.

    Student's t, two-sided, at the level 1 - (1 - alpha)^(1 / tests)   [Sidak1967].
    """
    from scipy.special import stdtrit  # comes with scikit-image

    level = -np.expm1(np.log1p(-alpha) / tests)
    return float(-stdtrit(noise.freedom, level / 2))
