"""Where to look in images of equal time: the windows in which their errors are largest."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.analysis import nice_numbers
from raytrace.reporting.equal_cost import spp_at
from raytrace.reporting.measurements import EqualTime, Inset, Point

WINDOWS = 2
SHARE = 6  # a window's side is this part of the shorter side of the image


def time_of(points: Sequence[Point]) -> float:
    """A round time in the middle of the range of a configuration; NaN without points."""
    times = nice_numbers([point.seconds for point in points], 3)
    return times[len(times) // 2] if times else math.nan


def step_for(curve: Sequence[Point], seconds: float) -> float | None:
    """Samples per pixel that take a time; of adaptive sampling, the measured target whose time is closest.

    None: the configuration was not measured around this time (within a factor of two).
    """
    nearest = min(curve, key=lambda point: abs(math.log(point.seconds / seconds)))
    if not 0.5 <= nearest.seconds / seconds <= 2.0:
        return None
    if nearest.configuration.adaptive:
        return nearest.step
    spp = spp_at(curve, seconds)
    known = spp if math.isfinite(spp) else nearest.spp * seconds / nearest.seconds
    return float(max(round(known), 1))


def windows_of(error: NDArray[np.floating]) -> tuple[tuple[int, int, int], ...]:
    """Return the square windows around the places where an error (h, w) is largest; they do not overlap.

    Returns
    -------
    tuple of (x, y, side), pixels
        In their middle, or as near as the border allows, is the square of a third of their side with the largest sum.

    Examples
    --------
    >>> error = np.zeros((12, 12))
    >>> error[3, 8] = error[10, 2] = 1.0
    >>> windows_of(error)
    ((8, 3, 2), (2, 10, 2))
    """
    height, width = error.shape
    side = max(min(height, width) // SHARE, min(2, height, width))
    core = max(side // 3, 1)
    total = np.zeros((height + 1, width + 1))
    total[1:, 1:] = np.asarray(error, np.float64).cumsum(axis=0).cumsum(axis=1)
    sums = total[core:, core:] - total[:-core, core:] - total[core:, :-core] + total[:-core, :-core]
    found = []
    for _ in range(WINDOWS):
        y, x = divmod(int(sums.argmax()), sums.shape[1])
        if sums[y, x] < 0.0:
            break
        left = min(max(x - (side - core) // 2, 0), width - side)
        top = min(max(y - (side - core) // 2, 0), height - side)
        found.append((left, top, side))
        away = side + core  # of the next core: its window may not overlap
        sums[max(y - away, 0) : y + away, max(x - away, 0) : x + away] = -1.0
    return tuple(found)


def equal_time(seconds: float, insets: Sequence[Inset]) -> EqualTime:
    """Combine images of equal time; the first is the reference. The windows are where their mean error is largest."""
    mean = np.mean([inset.error for inset in insets[1:]], axis=0)
    return EqualTime(seconds, windows_of(mean), tuple(insets))
