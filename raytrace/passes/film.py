"""Film: radiance of samples to sums of pixels, in the order of the samples, whatever the batch."""

import numpy as np

from raytrace.jit import kernel

LUMINANCE = 0.2126, 0.7152, 0.0722  # of linear Rec. 709 primaries   [ITU-R BT.709-6, 3.2]


@kernel
def accumulate(radiance, sums):
    """Add samples to pixels.

    Parameters
    ----------
    radiance : (3n,) f array
        Sample number = sample * m + pixel.
    sums : (4, m) float64 array
        Of red, green, blue and squared luminance of m pixels.
    """
    n, m = len(radiance) // 3, sums.shape[1]
    for first in range(0, n, m):
        for k in range(3):
            channel, total = radiance[k * n + first : k * n + first + m], sums[k]
            for j in range(m):
                total[j] += np.float64(channel[j])
        red, green, blue = radiance[first:], radiance[n + first :], radiance[2 * n + first :]
        squares = sums[3]
        for j in range(m):
            y = LUMINANCE[0] * red[j] + LUMINANCE[1] * green[j] + LUMINANCE[2] * blue[j]
            squares[j] += y * y
