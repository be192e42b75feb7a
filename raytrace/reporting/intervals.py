"""Confidence intervals of the times and errors of repeated renders."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CONFIDENCE = 0.95  # of intervals


class Interval(NamedTuple):
    """A confidence interval of a positive number; NaN at both ends: unknown."""

    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether there were enough renders for an interval."""
        return self.low == self.low and self.high == self.high


UNKNOWN = Interval(math.nan, math.nan)


def student(renders: int) -> float:
    """Return the quantile of Student's t for a 95 % interval of the mean of a number of renders.

    >>> round(student(6), 3)
    2.571
    """
    from scipy.special import stdtrit  # comes with scikit-image

    return float(stdtrit(renders - 1, (1 + CONFIDENCE) / 2))


def of_median(values: Sequence[float]) -> Interval:
    """Return a confidence interval of the median of a distribution, from independent values of it.

    Parameters
    ----------
    values : sequence of float

    Returns
    -------
    Interval
        Unknown with fewer than six values.

    Notes
    -----
    Two order statistics: the k-th smallest and the k-th largest of n values. The median lies below the k-th smallest
    only if fewer than k values are below it, and the number of these is binomial (n, 1/2). So the interval holds the
    median with probability ``1 - 2 P(B < k) = 1 - 2^(1 - n) sum_(j < k) C(n, j)``, for every continuous distribution.
    k is the largest number for which this is 0.95 or more: 1 for 6 to 8 values, 4 for 16 [David2003, section 7.1].

    Examples
    --------
    >>> of_median([3.0, 1.0, 2.0, 6.0, 5.0, 4.0])
    Interval(low=1.0, high=6.0)
    """
    n, ordered = len(values), sorted(values)
    k, below = 0, 0.0  # `below`: P(B < k)
    while k < n and 1 - 2 * (below + math.comb(n, k) / 2.0**n) >= CONFIDENCE:
        below += math.comb(n, k) / 2.0**n
        k += 1
    return Interval(ordered[k - 1], ordered[n - k]) if k else UNKNOWN


def of_root_mean(squares: Sequence[float]) -> Interval:
    """Return a confidence interval of the RMSE, from the MSE of independent images.

    Parameters
    ----------
    squares : sequence of float
        Mean squared error of each image.

    Returns
    -------
    Interval
        Unknown with fewer than two images.

    Notes
    -----
    An MSE is a mean over all pixels, and so nearly normal. The interval of the mean m of n of them has the relative
    half-width ``h = t(n - 1) s / (m sqrt(n))``. The RMSE is sqrt(m), so its logarithm has half of it (the delta
    method): the interval is ``sqrt(m) exp(-h / 2)`` to ``sqrt(m) exp(h / 2)``.

    Examples
    --------
    >>> of_root_mean([0.04, 0.04, 0.04])
    Interval(low=0.2, high=0.2)
    """
    n = len(squares)
    if n < 2:
        return UNKNOWN
    mean = float(np.mean(squares))
    if mean == 0.0:
        return Interval(0.0, 0.0)
    half = student(n) * float(np.std(squares, ddof=1)) / (mean * math.sqrt(n)) / 2
    return Interval(math.sqrt(mean) * math.exp(-half), math.sqrt(mean) * math.exp(half))


def of_mean(values: Sequence[float]) -> Interval:
    """Return a confidence interval of a mean: ``m +- t(n - 1) s / sqrt(n)``, Student's t; unknown with one value."""
    n = len(values)
    if n < 2:
        return UNKNOWN
    half = student(n) * float(np.std(values, ddof=1)) / math.sqrt(n)
    mean = float(np.mean(values))
    return Interval(mean - half, mean + half)


def log_half_width(interval: Interval) -> float:
    """Half of the width of an interval in natural logarithms: about the relative uncertainty; NaN: unknown."""
    if not interval.known:
        return math.nan
    return 0.0 if interval.low <= 0.0 else math.log(interval.high / interval.low) / 2
