"""Parts of a picture: what one thread draws before it asks for more."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Window

TILE = 32  # pixels: side of a tile


class Part(NamedTuple):
    """The same samples of some pixels, neighbours beside each other."""

    first: int
    last: int  # the one after the last
    pixels: NDArray[np.int64]  # (m,), row after row of the window


def tiles(window: Window) -> list[NDArray[np.int64]]:
    """Pixels of each tile, along a Z curve: any packet is a compact block   [Morton1966]."""
    y, x = np.mgrid[0:TILE, 0:TILE]
    curve = sum(((x >> bit & 1) << 2 * bit) | ((y >> bit & 1) << 2 * bit + 1) for bit in range(TILE.bit_length() - 1))
    order = np.argsort(np.ravel(curve))
    x, y = x.ravel()[order], y.ravel()[order]
    parts = []
    for top in range(0, window.height, TILE):
        for left in range(0, window.width, TILE):
            inside = (x < window.width - left) & (y < window.height - top)
            parts.append((y[inside] + top) * window.width + (x[inside] + left))
    return parts


def rounds(spp: int, hasty: bool) -> list[tuple[int, int]]:
    """Ranges of samples: all at once, or ever more where time may run out, so that the whole picture is there early."""
    bounds = [0, spp]
    if hasty:
        bounds = [0, *(1 << k for k in range((spp - 1).bit_length())), spp]
    return list(pairwise(bounds))


def doubled(pixels: NDArray[np.int64], samples: NDArray[np.int32], cap: int) -> Iterator[Part]:
    """As many samples again for each pixel, in parts of pixels that have the same number of them."""
    for n in np.unique(samples).tolist():
        same = pixels[samples == n]
        yield from (Part(n, min(2 * n, cap), same[k : k + TILE**2]) for k in range(0, len(same), TILE**2))
