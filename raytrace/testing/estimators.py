"""``t_test``: whether means of independent estimates agree with a reference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import OptionError
from raytrace.record_display import displayed
from raytrace.testing.distributions import sidak, student_tails
from raytrace.testing.outcome import StatisticalError, check_level


@displayed
class TTest(NamedTuple):
    """Numbers of a t-test of one or many means."""

    p_value: float  # of the worst mean: probability of an error as large, if there is no bias
    t: float  # its error in standard errors
    degrees: float  # of freedom; inf where variances were given
    level: float  # below this p-value the test fails; corrected for all means and tests
    error: float  # of that mean: estimate minus reference
    at: tuple[int, ...]  # its position
    mean: NDArray[np.float64]  # all means
    stderr: NDArray[np.float64]  # their standard errors


def t_test(
    estimates: ArrayLike,
    reference: ArrayLike,
    *,
    variance: ArrayLike | None = None,
    reference_variance: ArrayLike = 0.0,
    tolerance: float = 0.0,
    level: float = 1e-3,
    tests: int = 1,
) -> TTest:
    """Test whether the mean of independent estimates is a reference value, by Student's t-test.

    Parameters
    ----------
    estimates : (k, ...) array-like
        k independent estimates, as images of k seeds; or, with ``variance``, their mean (...).
    reference : array-like
        The right value; its shape broadcasts to that of one estimate.
    variance : array-like, optional
        Variance of the mean, as of ``Render.var``. The test is then a z-test.
    reference_variance : array-like
        Variance of the reference, where that is an estimate too. It is added, which is exact where there is no bias
        and its own number of samples is large.
    tolerance : float
        Relative: an error up to this is not held against an estimate, as of a closed form that is an approximation.
    level : float
        Probability with which right estimates may fail all ``tests`` together, over all means of each.
    tests : int
        Number of tests of this kind that you make.

    Returns
    -------
    TTest
        Of the mean with the smallest p-value.

    Raises
    ------
    StatisticalError
        That p-value is below the level, corrected for the number of means and tests [Sidak1967].
    OptionError
        An argument is not allowed; shapes do not match.

    Notes
    -----
    Noise of few samples has longer tails than the normal distribution: average over pixels, or over tiles, before
    testing. Samples of one low-discrepancy sequence are not independent; images of different seeds are.

    Examples
    --------
    An estimator of the integral of x^2 over [0, 1], with 20 seeds:

    >>> import numpy as np, raytrace as rt
    >>> x = np.random.default_rng(0).random((20, 1000))
    >>> rt.testing.t_test((x**2).mean(axis=1), 1 / 3).p_value > 0.001
    True
    >>> rt.testing.t_test((1.05 * x**2).mean(axis=1), 1 / 3)
    Traceback (most recent call last):
    ...
    raytrace.testing.outcome.StatisticalError: biased: +0.01881 (+5.64 %), 9.3 standard errors: p = 1.8e-08, below 0.001
    """
    check_level(level, tests)
    given = np.asarray(estimates, np.float64)
    if variance is None:
        if given.ndim < 1 or len(given) < 2:
            raise OptionError("estimates: expected at least two independent ones, or one and its variance")
        degrees, mean = float(len(given) - 1), given.mean(axis=0)
        spread = given.var(axis=0, ddof=1) / len(given)
    else:
        degrees, mean, spread = float("inf"), given, np.asarray(variance, np.float64)
    try:
        right, spread, other = (
            np.broadcast_to(np.asarray(a, np.float64), mean.shape) for a in (reference, spread, reference_variance)
        )
    except ValueError:
        text = f"expected arrays that broadcast to {mean.shape}, the shape of one estimate"
        raise OptionError(f"reference, variance: {text}") from None
    if not (np.isfinite(mean) & np.isfinite(right) & (spread + other >= 0)).all() or mean.size == 0:
        raise OptionError("estimates: expected finite values, and variances of at least 0")
    stderr = np.sqrt(spread + other)
    return _judged(mean, right, stderr, tolerance, degrees, sidak(level, tests * mean.size))


def _judged(
    mean: NDArray[np.float64],
    right: NDArray[np.float64],
    stderr: NDArray[np.float64],
    tolerance: float,
    degrees: float,
    level: float,
) -> TTest:
    error = mean - right
    beyond = np.maximum(np.abs(error) - tolerance * np.abs(right), 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(beyond > 0, beyond / stderr, 0.0)
    at = np.unravel_index(int(np.argmax(t)), t.shape)
    place = tuple(map(int, at))
    worst = float(np.copysign(t[at], error[at]))
    p = student_tails(worst, degrees)
    result = TTest(p, worst, degrees, level, float(error[at]), place, mean, stderr)
    if not p >= level:
        relative = f" ({error[at] / abs(right[at]):+.2%})".replace("%", " %") if right[at] else ""
        where = f" at {place}" if place else ""
        text = f"biased{where}: {error[at]:+.4g}{relative}, {abs(worst):.1f} standard errors"
        raise StatisticalError(f"{text}: p = {p:.2g}, below {level:.2g}", result)
    return result
