"""Film: radiance of samples to sums of pixels, in the order of the samples, whatever the batch.

A pixel's samples lie in four bins, quarters of them where their number is a power of two: 0 and 1 hold the first half,
2 and 3 what came since. When both are full, two bins become one each. What the bins disagree by is the pixel's error.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.jit import inlined, kernel

BINS = 4
MOST = float(np.finfo(np.float32).max)  # radiance of a picture
LUMINANCE = 0.2126, 0.7152, 0.0722  # of linear Rec. 709 primaries   [ITU-R BT.709-6, 3.2]


class Film(NamedTuple):
    """What is known of the pixels of a window, which are whole packets of them."""

    sums: NDArray[np.float64]  # (12, m): red, green, blue of each bin, bin after bin
    samples: NDArray[np.int32]  # (m,)
    variance: NDArray[np.float64]  # (m,): of the mean luminance; NaN: unknown
    error: NDArray[np.float64]  # (m,): squared, as shown: of sRGB clipped to 0..1, mean of the channels; NaN: unknown


class Frame(NamedTuple):
    """What is known of the pixels of a window, row after row."""

    rgb: NDArray[np.float32]  # (m, 3): mean radiance, at most the largest float32; 0 without a sample
    samples: NDArray[np.int32]  # (m,)
    variance: NDArray[np.float64]  # (m,): as of a film
    error: NDArray[np.float64]  # (m,): as of a film


def make_frame(pixels: int) -> Frame:
    """Room for so many pixels."""
    return Frame(np.empty((pixels, 3), np.float32), np.empty(pixels, np.int32), *np.empty((2, pixels)))


def blank_frame(pixels: int) -> Frame:
    """So many pixels without a sample."""
    frame = make_frame(pixels)
    frame.rgb[:], frame.samples[:], frame.variance[:], frame.error[:] = 0, 0, np.nan, np.nan
    return frame


def make_film(pixels: int) -> Film:
    """Film of so many pixels, and as many more as fill the last packet; without a sample."""
    m = -(-pixels // PACKET) * PACKET
    return Film(np.zeros((3 * BINS, m)), np.zeros(m, np.int32), np.full(m, np.nan), np.full(m, np.nan))


def taken(film: Film, pixels: NDArray[np.int64]) -> Film:
    """Copy some pixels of a film, whole packets of them."""
    return Film(np.take(film.sums, pixels, axis=1), *(column[pixels] for column in film[1:]))


def put(film: Film, pixels: NDArray[np.int64], part: Film) -> None:
    """Write pixels that were taken back, but for those that fill the last packet."""
    m = len(pixels)
    for row, values in zip(film.sums, part.sums, strict=True):
        row[pixels] = values[:m]
    for column, values in zip(film[1:], part[1:], strict=True):
        column[pixels] = values[:m]


def bin_counts(samples):
    """Samples in each bin (4, m), for the numbers of samples (m,) of pixels."""
    samples = np.asarray(samples, np.int64)
    width = 1 << np.maximum(np.ceil(np.log2(np.maximum(samples, 1))).astype(np.int64) - 2, 0)
    return np.clip(samples - width * np.arange(BINS)[:, None], 0, width)


@inlined
def bin_of(sample):
    """Bin of a sample when it comes: 2 or 3 for all but the first two."""
    while sample >= BINS:
        sample >>= 1
    return sample


@kernel
def accumulate(radiance, first, last, sums, begin, m):
    """Add samples to pixels.

    Parameters
    ----------
    radiance : (3n,) f array
        Sample after sample, each of m pixels; there may be more.
    first, last : int
        Number of the first sample, and of the one after the last.
    sums : (12, p) float64 array
        Of red, green and blue of pixels, bin after bin.
    begin, m : int
        The first pixel, and how many.
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
def develop(film, at, first, most, frame):
    """Put what is known of the pixels of a film where they belong in a picture.

    Parameters
    ----------
    film : Film
    at : (m,) int64 array
        Place in the picture of each of m pixels.
    first : int
        The first of them in the film.
    most : int
        Pixels with more samples than this are left out.
    frame : Frame
    """
    sums, samples, variance, error = film
    rgb, numbers, variances, errors = frame
    for k in range(len(at)):
        i, j = first + k, at[k]
        if samples[i] > most:
            continue
        for c in range(3):
            total = (sums[c, i] + sums[3 + c, i]) + (sums[6 + c, i] + sums[9 + c, i])
            mean = total / max(samples[i], 1)
            rgb[j, c] = np.float32(MOST if mean > MOST else mean)
        numbers[j], variances[j], errors[j] = samples[i], variance[i], error[i]
