"""Errors of the means of pixels, estimated from the differences between the bins of a pixel.

The four bins of a pixel (film.py) give three contrasts: half against half, and quarter against quarter in each half.
For independent samples the mean of each is sigma^2, and the pixel's variance V(n) is sigma^2 / n. The sample points of
one pixel avoid each other, so V falls as n^-order with an order above 1, and contrasts are too large by the factors

    half against half:        2^order - 1
    quarter against quarter:  2^order (2^order - 1) / 2

which follows from V(n / 2) = 2^order V(n) and exchangeable blocks. docs/error.md derives and measures them.
"""

from collections.abc import Collection
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import load, maximum, minimum, packet, packet_width, select, sqrt, store
from raytrace.jit import inlined, kernel
from raytrace.passes.film import LUMINANCE, Film, bin_counts


class Model(NamedTuple):
    """Convergence of the points of a sampler."""

    order: float  # V(n) ~ n^-order, measured; edges alone: 3/2 [He2015]
    block: int  # samples that belong together: bins of fewer samples count only where there are no others


MODELS = {"sobol": Model(1.6, 2), "stratified": Model(1.4, 1), "independent": Model(1.0, 1)}


def estimate(film: Film, first: int, last: int, model: Model, shown: NDArray[np.float64]) -> None:
    """Estimate pixels ``first`` .. ``last - 1`` of a film, whole packets that have the same number of samples.

    Parameters
    ----------
    film : Film
        Its variances and errors are updated.
    first, last : int
    model : Model
    shown : (3 (last - first),) array
        Output: their means as displayed, all red, all green, all blue.
    """
    weights = contrast_weights(int(film.samples[first]), model)
    errors(film.sums.reshape(-1), first, weights, shown, film.variance, film.error)
    if not weights[1:].any():
        film.variance[first:last] = film.error[first:last] = np.nan


def weights_of(counts: Collection[int], model: Model) -> NDArray[np.float64]:
    """Return a table of ``contrast_weights``: row n for each n of some numbers of samples, zeros for all others."""
    table = np.zeros((max(counts) + 1, 7))
    for n in counts:
        table[n] = contrast_weights(n, model)
    return table


@cache
def contrast_weights(samples: int, model: Model) -> NDArray[np.float64]:
    """Number of samples, and the factors of both sums of each contrast: the variance is the sum of squared contrasts.

    Two bins of na and nb samples estimate the variance of one sample as na nb / (na + nb) (mean a - mean b)^2.
    """
    a, b, c, d = bin_counts([samples])[:, 0].tolist()
    growth = 2.0**model.order
    pairs = [(a + b, c + d, 1.0), (a, b, growth / 2 if samples > 2 else 1.0), (c, d, growth / 2)]  # two: each is a half
    whole = [min(na, nb) >= model.block for na, nb, _ in pairs]
    known = [kept or (not any(whole) and min(na, nb) > 0) for kept, (na, nb, _) in zip(whole, pairs, strict=True)]
    weights = np.zeros(7)
    weights[0] = max(samples, 1)
    for k, ((na, nb, larger), kept) in enumerate(zip(pairs, known, strict=True)):
        if kept:
            scale = 1 / ((growth - 1) * larger * sum(known) * samples * na * nb * (na + nb))
            weights[1 + 2 * k : 3 + 2 * k] = np.sqrt(scale) * np.array([nb, na])
    return weights


@kernel
def errors(sums, first: int, weights, shown, variance, error):
    """Compute displayed means, variances and errors of pixels with the same number of samples.

    Parameters
    ----------
    sums : (12 m,) array
        ``sums`` of a film, flattened.
    first : int
        The first pixel.
    weights : (7,) array
        Result of ``contrast_weights``.
    shown : (3n,) array
        Output: the means of n pixels, as displayed.
    variance, error : (m,) arrays
        Of the film; the elements of these pixels are written.
    """
    like = packet(variance)
    m, n = len(variance), len(shown) // 3
    for i in range(0, n, packet_width(variance)):
        at = first + i
        half = quarter = other = off = like
        for k in range(3):
            a, b = load(sums, k * m + at, like), load(sums, (3 + k) * m + at, like)
            c, d = load(sums, (6 + k) * m + at, like), load(sums, (9 + k) * m + at, like)
            mean = ((a + b) + (c + d)) / weights[0]
            x = (a + b) * weights[1] - (c + d) * weights[2]
            y, z = a * weights[3] - b * weights[4], c * weights[5] - d * weights[6]
            half, quarter, other = half + x * LUMINANCE[k], quarter + y * LUMINANCE[k], other + z * LUMINANCE[k]
            deviation = sqrt(x * x + y * y + z * z)
            step = displayed(mean + deviation) - displayed(mean - deviation)
            off = off + step * step
            store(shown, k * n + i, displayed(mean))
        store(variance, at, half * half + quarter * quarter + other * other)
        store(error, at, off * (1 / 12))  # a step is twice the error; averaged over three channels


@inlined
def displayed(x):
    """Radiance as displayed: sRGB, 0 .. 1   [IEC 61966-2-1]. Uses no library's power function: their bits differ."""
    x = minimum(maximum(x, 0.0), 1.0)
    z = sqrt(maximum(x, 0.0031308))
    t = 0.358 + z * (1.162 - z * 0.551)  # z^(1/3), off by 10 %; then 6e-4, then 1e-10   [Halley]
    for _ in range(2):
        cube = t * t * t
        t = t * (cube + 2.0 * z) / (2.0 * cube + z)
    return select(x > 0.0031308, 1.055 * (t * sqrt(z)) - 0.055, 12.92 * x)


def root_mean(squares: NDArray[np.float64]) -> float:
    """Root of the mean of the finite elements; NaN if there are none."""
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(known.mean())) if len(known) else float("nan")
