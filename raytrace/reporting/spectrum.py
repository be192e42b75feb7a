"""The spectrum of noise: whether it is blue, white, or in large patches."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.intervals import Interval, of_mean

BINS = 24  # of frequencies from 0 to 1/2 cycle per pixel
LOW = 1 / 8  # cycles per pixel: frequencies below are low, features of more than eight pixels
TOLERANCE = 0.2  # a low-frequency power that differs from 1 by less counts as white


class Spectrum(NamedTuple):
    """Radially averaged power spectrum of the noise of one point."""

    name: str
    frequency: NDArray[np.float64]  # (BINS,): middles of the bins, cycles per pixel
    power: NDArray[
        np.float64
    ]  # (BINS,): averaged over pairs of renders; 1 everywhere: white noise. NaN: no frequency there
    low: float  # mean power of the low frequencies, averaged over pairs of renders
    interval: Interval  # of `low`, from the scatter between pairs

    @property
    def verdict(self) -> str:
        """What kind of noise it is, as far as the interval tells."""
        if not self.interval.known:
            return "unknown: too few renders"
        if self.interval.high < 1 - TOLERANCE:
            return "blue: fine-grained"
        if self.interval.low > 1 + TOLERANCE:
            return "red: in patches"
        if self.interval.low >= 1 - TOLERANCE and self.interval.high <= 1 + TOLERANCE:
            return "white"
        return "uncertain"


def radial_power(error: NDArray[np.floating]) -> tuple[NDArray[np.float64], float]:
    """Return the radially averaged power spectrum of noise, and its mean power of low frequencies.

    Parameters
    ----------
    error : (h, w) or (h, w, 3) array of float
        Difference of two renders with different seeds, which has twice the noise of each. Channels are averaged after
        the transform. The difference from a reference has a part besides noise: sRGB codes are not linear in light,
        so their mean over all seeds is off at edges, which looks like noise in patches.

    Returns
    -------
    power : (BINS,) array of float
        Mean power of the frequencies |f| in each bin, relative to the mean power of all frequencies but 0.
    low : float
        The same for 0 < |f| < 1/8 cycle per pixel.

    Notes
    -----
    The periodogram is ``P(f) = |sum_x e(x) exp(-2 pi i f x)|^2``. If the errors of different pixels are independent
    with mean 0, the mean of P(f) is the sum of their variances for every f: white noise is flat even where the variance
    differs from pixel to pixel, as it does at edges. Blue noise has little power at low frequencies [Ulichney1987]. A
    viewer, or a filter, averages it away.

    Examples
    --------
    >>> board = np.indices((16, 16)).sum(axis=0) % 2 - 0.5  # a checkerboard: the highest frequency
    >>> radial_power(board)[1]
    0.0
    """
    planes = np.asarray(error, np.float64).reshape(*error.shape[:2], -1)
    power = (np.abs(np.fft.fft2(planes, axes=(0, 1))) ** 2).mean(axis=2)
    height, width = power.shape
    f = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width))
    total = power[f > 0].mean() if f.size > 1 else 0.0
    if not total > 0.0:
        return np.full(BINS, np.nan), float("nan")
    inside = (f > 0) & (f < 0.5)
    row = (f[inside] * 2 * BINS).astype(int)
    count = np.bincount(row, minlength=BINS)
    summed = np.bincount(row, power[inside], BINS)
    low = (f > 0) & (f < LOW)
    with np.errstate(invalid="ignore"):
        radial = np.where(count > 0, summed / np.maximum(count, 1) / total, np.nan)
    return radial, float(power[low].mean() / total) if low.any() else float("nan")


def spectrum_of(name: str, spectra: Sequence[tuple[NDArray[np.float64], float]]) -> Spectrum:
    """Combine the spectra of several pairs of renders of one point."""
    lows = [low for _, low in spectra]
    power = np.mean([radial for radial, _ in spectra], axis=0)
    return Spectrum(name, (np.arange(BINS) + 0.5) / (2 * BINS), power, float(np.mean(lows)), of_mean(lows))
