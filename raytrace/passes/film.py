"""Film: radiance of samples to sums of pixels, in the order of the samples, whatever the batch.

A pixel's samples lie in four bins, quarters of them where their number is a power of two: 0 and 1 hold the first half,
2 and 3 what came since. When both are full, two bins become one each. What the bins disagree by is the pixel's error.
"""

import numpy as np

from raytrace.jit import inlined, kernel

BINS = 4
LUMINANCE = 0.2126, 0.7152, 0.0722  # of linear Rec. 709 primaries   [ITU-R BT.709-6, 3.2]


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
def accumulate(radiance, first, sums):
    """Add samples to pixels.

    Parameters
    ----------
    radiance : (3n,) f array
        Sample after sample, each of m pixels.
    first : int
        Number of the first sample.
    sums : (12, m) float64 array
        Of red, green and blue of m pixels, bin after bin.
    """
    n, m = len(radiance) // 3, sums.shape[1]
    for i in range(n // m):
        sample = first + i
        if sample >= BINS and sample & (sample - 1) == 0:
            for k in range(3):
                for j in range(m):
                    sums[k, j] += sums[3 + k, j]
                    sums[3 + k, j] = sums[6 + k, j] + sums[9 + k, j]
                    sums[6 + k, j] = sums[9 + k, j] = 0.0
        row = 3 * bin_of(sample)
        for k in range(3):
            channel, total = radiance[k * n + i * m : k * n + (i + 1) * m], sums[row + k]
            for j in range(m):
                total[j] += np.float64(channel[j])
