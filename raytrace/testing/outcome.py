"""What the statistical tests share: their error, checked arguments, and random numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.passes.sampling import mix

MOST = 1 << 24  # samples of one test


class StatisticalError(AssertionError):
    """A hypothesis that a test rejects.

    Parameters
    ----------
    text : str
        What is wrong, and how unlikely it would be by chance.
    result : record
        The numbers of the test.
    """

    def __init__(self, text: str, result: Any) -> None:
        super().__init__(text)
        self.result = result


def uniform(n: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Independent random numbers (n, dimensions) in [0, 1), 24 bits each: functions of seed, row and dimension."""
    rows = np.arange(n, dtype=np.uint32)
    start = mix(mix(np.full(1, seed, np.uint32)) + np.uint32(0x9E3779B9))
    columns = [mix(mix(mix(start + np.uint32(k)) ^ rows) + np.uint32(k)) for k in range(dimensions)]
    return np.stack([column >> np.uint32(8) for column in columns], axis=1) * 2.0**-24


def check_numbers(n: int, seed: int, level: float, tests: int) -> None:
    """Check the arguments that all tests have; an OptionError names the first that is wrong."""
    if not 100 <= n <= MOST:
        raise OptionError(f"n: expected from 100 to {MOST:,} samples, got {n!r}")
    if not 0 <= seed < 2**32:
        raise OptionError(f"seed: expected a whole number from 0 to 2**32 - 1, got {seed!r}")
    check_level(level, tests)


def check_level(level: float, tests: int) -> None:
    """Check the level of significance, and the number of tests."""
    if not 0 < level < 1:
        raise OptionError(f"level: expected a probability above 0 and below 1, got {level!r}")
    if not tests >= 1:
        raise OptionError(f"tests: expected a number of at least 1, got {tests!r}")
