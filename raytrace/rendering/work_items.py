"""Parts of a picture: what one thread draws before it asks for more."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Window

TILE = 32  # pixels: side of a tile


class WorkItem(NamedTuple):
    """The same samples of some pixels, neighbours beside each other."""

    first: int
    last: int  # the one after the last
    pixels: slice | NDArray[np.int64]  # of the film, whole packets of them if a slice; in the order of ``curve``


def curve(window: Window) -> NDArray[np.int64]:
    """Pixels of a window, row after row, in the order of a Z curve through each tile, one tile after the other.

    So any packet is a compact block   [Morton1966].
    """
    y, x = np.mgrid[0:TILE, 0:TILE]
    place = sum(((x >> bit & 1) << 2 * bit) | ((y >> bit & 1) << 2 * bit + 1) for bit in range(TILE.bit_length() - 1))
    order = np.argsort(np.ravel(place))
    x, y = x.ravel()[order], y.ravel()[order]
    tops, lefts = np.mgrid[0 : window.height : TILE, 0 : window.width : TILE].reshape(2, -1, 1)
    x, y = (lefts + x).ravel(), (tops + y).ravel()
    inside = (x < window.width) & (y < window.height)
    return y[inside] * window.width + x[inside]


def pieces(pixels: int, at_least: int) -> list[slice]:
    """Pixels of a film, as many together as a tile has, or as tiles with so many do."""
    step = TILE**2 * max(1, at_least // TILE**2)
    return [slice(k, min(k + step, pixels)) for k in range(0, pixels, step)]


def rounds(spp: int, first: int, leap: int = 2) -> list[tuple[int, int]]:
    """Ranges of samples: all at once, or ever more where time may run out, so that the whole picture is there early.

    Parameters
    ----------
    spp : int
    first : int
        Samples in the first range; 0: all at once.
    leap : int
        Each range doubles the samples, or multiplies them by up to 8 if ``leap`` allows it, up to 3/8 of all.

    >>> rounds(20, 4), rounds(20, 0), rounds(200, 8, 8)
    ([(0, 4), (4, 8), (8, 16), (16, 20)], [(0, 20)], [(0, 8), (8, 64), (64, 128), (128, 200)])
    """
    bounds = [0]
    while first and first < spp:
        bounds.append(first)
        first *= next(k for k in (8, 4, 2) if k == 2 or (k <= leap and 8 * k * first <= 3 * spp))
    return list(pairwise([*bounds, spp]))


def grown(
    pixels: NDArray[np.int64], samples: NDArray[np.int32], wanted: NDArray[np.int32], at_least: int = 0
) -> Iterator[WorkItem]:
    """More samples of pixels, in parts of pixels that have the same number of them and want the same."""
    kind = samples.astype(np.int64) << 32 | wanted
    for each in np.unique(kind).tolist():
        same = pixels[kind == each]
        step = max(TILE**2, at_least)
        for k in range(0, len(same), step):
            yield WorkItem(each >> 32, each & 0xFFFFFFFF, same[k : k + step])


def inverse(order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The permutation that undoes another."""
    places = np.empty_like(order)
    places[order] = np.arange(len(order))
    return places
