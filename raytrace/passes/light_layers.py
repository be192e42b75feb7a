"""Light layers: which of the light of path-traced samples is emission, direct or indirect.

- emission: lamps, environment and background, seen directly or through perfectly specular surfaces only;
- direct: light that arrives at the first surface that scatters, along its shadow ray or along the direction that was
  sampled there, with nothing in between but what shadow rays pass;
- indirect: all other light.

The passes that add light write to a buffer of its own, from which ``split`` adds to the radiance and to one layer. So
the radiance of a sample has the same bits as without layers.
"""

import numpy as np

from raytrace.accel.lanes import load, packet, packet_width, select, store
from raytrace.jit import kernel
from raytrace.passes.film import BINS, MAX_RADIANCE, SPLIT
from raytrace.passes.paths import ONLY_SPECULAR

STRAIGHT = 256  # bit of Paths.state: no surface has scattered before the last one that the path met
EMISSION, DIRECT, INDIRECT = range(3)


@kernel
def mark_first(paths, n):
    """Mark the paths whose present surface is the first that may scatter; called before the materials' passes."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        state = load(paths.state, i, like)
        first = (state & np.int32(ONLY_SPECULAR)) > np.int32(0)
        store(paths.state, i, select(first, state | np.int32(STRAIGHT), state & np.int32(~STRAIGHT)))


@kernel
def split(paths, n, seen: int, light, radiance, layers):
    """Add light to the radiance of samples and to their layers, and clear it.

    Parameters
    ----------
    paths : Paths
    n : int
        Their number.
    seen : int
        1: light that paths met where they arrived; 0: light along the shadow rays of their present surfaces.
    light : (3 rows,) f array
        Light that a pass added for these paths, by the samples that they belong to; is set to 0.
    radiance : (3 rows,) f array
    layers : (9 rows,) f array
        Red, green and blue of each layer.
    """
    rows = len(radiance) // 3
    for i in range(n):
        slot, state = paths.rays.slot[i], paths.state[i]
        layer = DIRECT if state & STRAIGHT != 0 else INDIRECT
        if seen != 0 and state & ONLY_SPECULAR != 0:
            layer = EMISSION
        for c in range(3):
            value = light[c * rows + slot]
            radiance[c * rows + slot] += value
            layers[(3 * layer + c) * rows + slot] += value
            light[c * rows + slot] = 0.0


@kernel
def accumulate_layers(layers, first: int, last: int, sums, begin: int, m: int):
    """Add the layers of samples to pixels, as ``accumulate`` adds their radiance, but to one sum each.

    Parameters
    ----------
    layers : (9n,) f array
        Red, green and blue of each layer; in each, m pixels for each sample. There may be more elements.
    first, last : int
        Number of the first sample, and of the one after the last.
    sums : (21, p) float64 array
        ``sums`` of a film with layers.
    begin, m : int
        The first pixel, and the number of pixels.
    """
    n, end = len(layers) // SPLIT, begin + m
    for sample in range(first, last):
        at = (sample - first) * m
        for k in range(SPLIT):
            channel, total = layers[k * n + at : k * n + at + m], sums[3 * BINS + k, begin:end]
            for j in range(m):
                total[j] += np.float64(channel[j])


@kernel
def develop_layers(sums, samples, at, first: int, most: int, light):
    """Write the means of the layers of pixels to their places in an image (m, 9), as ``develop`` writes those of light.

    ``sums`` and ``samples`` are those of a film; pixels with more than ``most`` samples are skipped.
    """
    for k in range(len(at)):
        i, j = first + k, at[k]
        if samples[i] > most:
            continue
        for c in range(SPLIT):
            mean = sums[3 * BINS + c, i] / max(samples[i], 1)
            light[j, c] = np.float32(MAX_RADIANCE if mean > MAX_RADIANCE else mean)
