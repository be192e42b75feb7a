"""What a film's sums say: the mean of each pixel, and how far it may be from the truth.

The four bins of a pixel (passes/film.py) give three contrasts: half against half, and quarter against quarter in each
half. Of independent samples each would have the mean sigma^2, and the pixel's variance V(n) would be sigma^2 / n. The
points of one pixel avoid each other, so that V falls as n^-order with an order above 1, and contrasts are too large by

    half against half:        2^order - 1
    quarter against quarter:  2^order (2^order - 1) / 2

which follows from V(n / 2) = 2^order V(n) and blocks that are exchangeable. docs/error.md derives and measures it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.passes.film import BINS, LUMINANCE, bin_counts

ORDER = {"sobol": 1.6, "stratified": 1.4, "independent": 1.0}  # V(n) ~ n^-order, measured; edges alone: 3/2 [He2015]
CHUNK = 1 << 13  # pixels estimated at a time: bounds the memory of it


class Film(NamedTuple):
    """Sums of the samples of every pixel of a window."""

    sums: NDArray[np.float64]  # (12, m): red, green, blue of each bin, bin after bin
    samples: NDArray[np.int32]  # (m,)


class Estimate(NamedTuple):
    """What is known of m pixels."""

    rgb: NDArray[np.float64]  # (m, 3): mean radiance; 0 without a sample
    variance: NDArray[np.float64]  # (m,): of the mean luminance; NaN with fewer than two samples
    shown: NDArray[np.float64]  # (m,): squared error as shown: of sRGB clipped to 0..1, mean of the channels; or NaN


def estimate(film: Film, order: float) -> Estimate:
    """Mean and error of every pixel.

    Parameters
    ----------
    film : Film
    order : float
        Of convergence of the variance: one of ``ORDER``.
    """
    parts = [
        _estimate(film.sums[:, k : k + CHUNK], film.samples[k : k + CHUNK], order)
        for k in range(0, len(film.samples), CHUNK)
    ]
    return Estimate(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _estimate(sums: NDArray[np.float64], samples: NDArray[np.int32], order: float) -> Estimate:
    if len(samples) and (samples == samples[0]).all():
        samples = samples[:1]  # the same arithmetic on fewer numbers
    counts = bin_counts(samples)[:, None].astype(np.float64)
    bins = sums.reshape(BINS, 3, -1)
    mean = ((bins[0] + bins[1]) + (bins[2] + bins[3])) / np.maximum(samples, 1)
    light = LUMINANCE[0] * bins[:, 0] + LUMINANCE[1] * bins[:, 1] + LUMINANCE[2] * bins[:, 2]
    variance, deviation = _variance(light[:, None], counts, order)[0], np.sqrt(_variance(bins, counts, order))
    shown = (displayed(mean + deviation) - displayed(mean - deviation)) / 2
    return Estimate(mean.T, variance, np.square(shown, dtype=np.float64).mean(axis=0))


def displayed(radiance: NDArray[np.float64]) -> NDArray[np.float32]:
    """Radiance as it is shown: sRGB, 0..1. float32 is exact to 1e-7, far below what can be seen."""
    x = np.clip(radiance, 0.0, 1.0).astype(np.float32)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055)  # [IEC 61966-2-1]


def _variance(bins: NDArray[np.float64], counts: NDArray[np.float64], order: float) -> NDArray[np.float64]:
    """Variance of the mean of all bins (4, c, m) of sums; counts are (4, 1, m), or (4, 1, 1)."""
    total, growth = counts.sum(axis=0), 2.0**order
    known = np.minimum(total - 1, 1) + (counts[2] > 0) + (counts[3] > 0)  # contrasts
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(known > 0, 1 / ((growth - 1) * known * total), np.nan)
    pair = scale * np.where(total > 2, 2 / growth, 1.0)  # two samples: each of them is a half
    variance = _contrast(bins[0] + bins[1], counts[0] + counts[1], bins[2] + bins[3], counts[2] + counts[3], scale)
    variance += _contrast(bins[0], counts[0], bins[1], counts[1], pair)
    variance += _contrast(bins[2], counts[2], bins[3], counts[3], pair)
    return variance


def _contrast(
    a: NDArray[np.float64],
    na: NDArray[np.float64],
    b: NDArray[np.float64],
    nb: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> NDArray[np.float64]:
    """What two bins say of the variance of a sample, na nb / (na + nb) (mean a - mean b)^2, times a scale.

    Nothing where a bin is empty.
    """
    weight = np.sqrt(scale / np.maximum(na * nb * (na + nb), 1)) * (na * nb > 0)
    difference = (nb * weight) * a
    difference -= (na * weight) * b
    difference *= difference
    return difference


def root_mean(squares: NDArray[np.float64]) -> float:
    """Root of the mean of what is known; NaN where nothing is."""
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(known.mean())) if len(known) else float("nan")
