"""Film: adds the radiance of samples to sums of pixels, in the order of the samples, however they are batched.

The samples of a pixel are summed in four bins, each a quarter of them where their number is a power of two. Bins 0
and 1 hold the first half, bins 2 and 3 the samples since then. When all are full, 0 and 1 are merged into 0, and 2 and
3 into 1. The pixel's error is estimated from the differences between the bins.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.jit import inlined, kernel

BINS = 4
SPLIT = 9  # sums of the light layers: three channels of emission, direct and indirect light
MAX_RADIANCE = float(np.finfo(np.float32).max)  # of an image
LUMINANCE = 0.2126, 0.7152, 0.0722  # of linear Rec. 709 primaries   [ITU-R BT.709-6, 3.2]


class Film(NamedTuple):
    """Samples and error estimates of the pixels of a window, padded to whole packets."""

    sums: NDArray[np.float64]  # (12, m): red, green, blue, bin after bin; or (21, m), with light layers
    samples: NDArray[np.int32]  # (m,)
    variance: NDArray[np.float64]  # (m,): of the mean luminance; NaN: unknown
    error: NDArray[np.float64]  # (m,): squared, of sRGB clipped to 0..1, averaged over channels; NaN: unknown


class Frame(NamedTuple):
    """Means and error estimates of the pixels of a window, row by row."""

    rgb: NDArray[np.float32]  # (m, 3): mean radiance, at most the largest float32; 0 without a sample
    var: NDArray[np.float32]  # (m, 3): variance of each of these means, at most the largest float32; NaN: unknown
    samples: NDArray[np.int32]  # (m,)
    variance: NDArray[np.float64]  # (m,): as of a film
    error: NDArray[np.float64]  # (m,): as of a film
    light: NDArray[np.float32]  # (m, 9): means of the light layers; (0, 9): they are not kept


def make_frame(pixels: int, light: bool = False) -> Frame:
    """Allocate a frame of so many pixels, with light layers or without."""
    (rgb, var), layers = np.empty((2, pixels, 3), np.float32), np.empty((pixels * light, SPLIT), np.float32)
    return Frame(rgb, var, np.empty(pixels, np.int32), *np.empty((2, pixels)), layers)


def blank_frame(pixels: int, light: bool = False) -> Frame:
    """Make a frame of so many pixels without samples."""
    frame = make_frame(pixels, light)
    frame.rgb[:], frame.samples[:], frame.light[:] = 0, 0, 0
    frame.var[:], frame.variance[:], frame.error[:] = np.nan, np.nan, np.nan
    return frame


def sums_of(light: bool) -> int:
    """Return the number of sums per pixel, with light layers or without."""
    return 3 * BINS + SPLIT * light


def make_film(pixels: int, light: bool = False) -> Film:
    """Make a film of so many pixels, padded to whole packets, without samples."""
    m = -(-pixels // PACKET) * PACKET
    return Film(np.zeros((sums_of(light), m)), np.zeros(m, np.int32), np.full(m, np.nan), np.full(m, np.nan))


def taken(film: Film, pixels: NDArray[np.int64]) -> Film:
    """Copy some pixels of a film: whole packets."""
    return Film(np.take(film.sums, pixels, axis=1), *(column[pixels] for column in film[1:]))


def put(film: Film, pixels: NDArray[np.int64], part: Film) -> None:
    """Write pixels that ``taken`` copied back to a film, without the padding of the last packet."""
    m = len(pixels)
    for row, values in zip(film.sums, part.sums, strict=True):
        row[pixels] = values[:m]
    for column, values in zip(film[1:], part[1:], strict=True):
        column[pixels] = values[:m]


def bin_counts(samples):
    """Number of samples in each bin, (4, m), for the numbers of samples (m,) of pixels."""
    samples = np.asarray(samples, np.int64)
    width = 1 << np.maximum(np.ceil(np.log2(np.maximum(samples, 1))).astype(np.int64) - 2, 0)
    return np.clip(samples - width * np.arange(BINS)[:, None], 0, width)


@inlined
def bin_of(sample):
    """Bin to which a sample is added: 2 or 3 for all but the first two."""
    while sample >= BINS:
        sample >>= 1
    return sample


@kernel
def accumulate(radiance, first: int, last: int, sums, begin: int, m: int):
    """Add the radiance of samples to pixels.

    Parameters
    ----------
    radiance : (3n,) f array
        All red, all green, all blue; in each, m pixels for each sample. There may be more elements.
    first, last : int
        Number of the first sample, and of the one after the last.
    sums : (12, p) float64 array
        Sums of red, green and blue of pixels, bin by bin.
    begin, m : int
        The first pixel, and the number of pixels.
    """
    n, end = len(radiance) // 3, begin + m
    for sample in range(first, last):
        at = (sample - first) * m
        if sample >= BINS and sample & (sample - 1) == 0:
            for k in range(3):
                for j in range(begin, end):
                    sums[k, j] += sums[3 + k, j]
                    sums[3 + k, j] = sums[6 + k, j] + sums[9 + k, j]
                    sums[6 + k, j] = sums[9 + k, j] = 0.0
        row = 3 * bin_of(sample)
        for k in range(3):
            channel, total = radiance[k * n + at : k * n + at + m], sums[row + k, begin:end]
            for j in range(m):
                total[j] += np.float64(channel[j])


@kernel
def develop(film: Film, at, first: int, most: int, weights, frame: Frame):
    """Write the means and error estimates of pixels of a film to their places in a frame.

    Parameters
    ----------
    film : Film
    at : (m,) int64 array
        Place of each of m pixels in the frame.
    first : int
        Number of the first of them in the film.
    most : int
        Pixels with more samples than this are skipped.
    weights : (s, 7) float64 array
        Row n: the factors of both sums of each contrast in pixels of n samples, as ``errors`` has them (estimate.py).
    frame : Frame
    """
    sums, samples, variance, error = film
    rgb, spread, numbers, variances, errors, _ = frame
    for k in range(len(at)):
        i, j = first + k, at[k]
        if samples[i] > most:
            continue
        w = weights[samples[i]]
        known = w[1] + w[3] + w[5] > 0.0
        for c in range(3):
            total = (sums[c, i] + sums[3 + c, i]) + (sums[6 + c, i] + sums[9 + c, i])
            mean = total / max(samples[i], 1)
            rgb[j, c] = np.float32(MAX_RADIANCE if mean > MAX_RADIANCE else mean)
            half = (sums[c, i] + sums[3 + c, i]) * w[1] - (sums[6 + c, i] + sums[9 + c, i]) * w[2]
            quarter, other = sums[c, i] * w[3] - sums[3 + c, i] * w[4], sums[6 + c, i] * w[5] - sums[9 + c, i] * w[6]
            square = half * half + quarter * quarter + other * other
            spread[j, c] = np.float32((MAX_RADIANCE if square > MAX_RADIANCE else square) if known else np.nan)
        numbers[j], variances[j], errors[j] = samples[i], variance[i], error[i]
