"""The film of one image, and how it is cut into work items: in space by tiles, in samples by rounds."""

import math
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.parallel import share_out
from raytrace.passes.estimate import Model, estimate, weights_of
from raytrace.passes.film import Film, Frame, blank_frame, develop, make_film, make_frame, put, taken
from raytrace.records import Window

TILE = 32  # pixels: side of a tile
ALL = 2**31 - 1  # more samples than a pixel can have
LONG = 2.0  # seconds: a render that is expected to take longer works in rounds
FIRST = 0.25  # seconds that the first round should take at least; each round costs about 60 ns per pixel
LEAP = 8  # the largest factor by which a round may multiply the samples while they are few: fewer rounds cost less


class WorkItem(NamedTuple):
    """The same range of samples of some pixels, in an order that keeps neighbours together."""

    first: int
    last: int  # the one after the last
    pixels: slice | NDArray[np.int64]  # of the film; a slice holds whole packets; in the order of ``curve``


class FilmTile(NamedTuple):
    """The pixels of a work item, in whole packets, with the sums of the samples that they have so far."""

    x: NDArray[np.uint32]  # (n,) columns of the pixels
    y: NDArray[np.uint32]  # (n,) rows
    film: Film
    begin: int  # index of the first pixel in the film

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sums of the pixels (12, n), or (21, n) with light layers, a view of the film."""
        return self.film.sums[:, self.begin : self.begin + len(self.x)]


def blank(x: NDArray[np.uint32], y: NDArray[np.uint32], light: bool) -> FilmTile:
    """Return a tile without samples, in memory of its own, for whole packets of pixels, with light layers or not."""
    return FilmTile(x, y, make_film(len(x), light), 0)


class FilmTiles:
    """The film of a window; its pixels lie in the order of ``curve``.

    Parameters
    ----------
    window : Window
    model : Model
        Error model of the sampler.
    light : bool
        Whether to keep the light layers.

    Attributes
    ----------
    film : Film
    at : (m,) array of int
        Position of each pixel of the film in the window, row by row.
    """

    def __init__(self, window: Window, model: Model, light: bool = False) -> None:
        x, y = curve(window)
        self.at = y * window.width + x
        self.film = make_film(len(self.at), light)
        self._model, self._counts = model, {0}  # numbers of samples that pixels have had
        self._light = light
        self._last: Frame | None = None  # the image of the last complete round, of pixels that are in the next
        padding = 0, len(self.film.samples) - len(self.at)
        self._x, self._y = (
            np.pad((row + begin).astype(np.uint32), padding, "edge") for row, begin in ((x, window.x), (y, window.y))
        )

    def positions(self, pixels: NDArray[np.int64]) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Columns and rows of pixels of the film."""
        return self._x[pixels], self._y[pixels]

    def keep_rounds(self) -> None:
        """From now on, keep the value of each pixel before another round adds samples to it."""
        self._last = blank_frame(len(self.at), self._light)

    def get(self, item: WorkItem) -> FilmTile:
        """Return the tile of a work item: a view of the film, or a copy where the pixels are not contiguous packets."""
        pixels = item.pixels
        if isinstance(pixels, slice):
            if self._last and item.first:
                weights = weights_of({item.first}, self._model)
                self._develop(self.at[pixels], pixels.start, item.first, weights, self._last)
            return FilmTile(self._x[pixels], self._y[pixels], self.film, pixels.start)
        padded = np.append(pixels, np.repeat(pixels[-1:], -len(pixels) % PACKET))
        return FilmTile(self._x[padded], self._y[padded], taken(self.film, padded), 0)

    def merge(self, item: WorkItem, tile: FilmTile, samples: int) -> NDArray[np.float64]:
        """Merge a tile whose pixels now have so many samples; return their means as shown (3, n)."""
        n = len(tile.x)
        self._counts.add(samples)
        tile.film.samples[tile.begin : tile.begin + n] = samples
        shown = np.empty((3, n))
        estimate(tile.film, tile.begin, tile.begin + n, self._model, shown.reshape(-1))
        if not isinstance(item.pixels, slice):
            put(self.film, item.pixels, tile.film)
        return shown

    def fill(self, item: WorkItem, tile: FilmTile, sums: NDArray[np.float64]) -> None:
        """Copy sums into a tile. The sample counts change first, so that Ctrl-C never leaves new sums uncounted."""
        self._counts.add(item.last)
        tile.film.samples[tile.begin : tile.begin + len(tile.x)] = item.last
        tile.sums[:] = sums

    def develop(self, most: int = ALL, threads: int = 1) -> Frame:
        """Return the image; pixels with more than ``most`` samples have their value of the last complete round."""
        frame = self._last or (make_frame if most == ALL else blank_frame)(len(self.at), self._light)
        weights = weights_of(self._counts, self._model)

        def part(begin: int, end: int) -> None:
            self._develop(self.at[begin:end], begin, most, weights, frame)

        share_out(part, len(self.at), threads)
        return frame

    def _develop(
        self, at: NDArray[np.int64], first: int, most: int, weights: NDArray[np.float64], frame: Frame
    ) -> None:
        """Write pixels of the film, from ``first`` on, to their places; weights: those of their numbers of samples."""
        develop(self.film, at, first, most, weights, frame)
        if self._light:
            from raytrace.passes.light_layers import develop_layers

            develop_layers(self.film.sums, self.film.samples, at, first, most, frame.light)


def curve(window: Window) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns and rows of the pixels of a window, in the order of a Z curve through each tile, tile after tile.

    So any packet is a compact block   [Morton1966].
    """
    x, y = _curve_of_tile(TILE)
    tops, lefts = np.mgrid[0 : window.height : TILE, 0 : window.width : TILE].reshape(2, -1, 1)
    x, y = (lefts + x).ravel(), (tops + y).ravel()
    if window.width % TILE or window.height % TILE:
        inside = (x < window.width) & (y < window.height)
        x, y = x[inside], y[inside]
    return x, y


@cache
def _curve_of_tile(side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns and rows of the pixels of a tile, in the order of a Z curve."""
    y, x = np.mgrid[0:side, 0:side]
    code = sum(((x >> bit & 1) << 2 * bit) | ((y >> bit & 1) << 2 * bit + 1) for bit in range(side.bit_length() - 1))
    order = np.argsort(np.ravel(code))
    return x.ravel()[order], y.ravel()[order]


def inverse(order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The permutation that undoes another."""
    positions = np.empty_like(order)
    positions[order] = np.arange(len(order))
    return positions


def pieces(pixels: int, at_least: int) -> list[slice]:
    """Cut the pixels of a film into pieces of one tile, or of as many tiles as have ``at_least`` pixels."""
    step = TILE**2 * max(1, at_least // TILE**2)
    return [slice(k, min(k + step, pixels)) for k in range(0, pixels, step)]


def grown(
    pixels: NDArray[np.int64], samples: NDArray[np.int32], goal: NDArray[np.int32], at_least: int = 0
) -> Iterator[WorkItem]:
    """Work items for more samples of pixels: those with the same number of samples and the same goal go together."""
    kind = samples.astype(np.int64) << 32 | goal
    for each in np.unique(kind).tolist():
        same = pixels[kind == each]
        step = max(TILE**2, at_least)
        for k in range(0, len(same), step):
            yield WorkItem(each >> 32, each & 0xFFFFFFFF, same[k : k + step])


def first_round(spp: int, seconds: float) -> int:
    """Samples of each pixel in the first round, a power of two, or 0: all in one round.

    A render in rounds has a complete image after the first of them, with few samples, and then with more and more. So
    Ctrl-C and a time limit leave an image without black parts. The result is bit-identical: the samples of a pixel are
    summed in their order, in one round or in many.

    Parameters
    ----------
    spp : int
        Samples of each pixel in all.
    seconds : float
        The time that they are expected to take.

    >>> first_round(64, 1.9), first_round(64, 5.0), first_round(200, 9.0), first_round(8, 3600.0)
    (0, 4, 8, 1)
    """
    if seconds <= LONG:
        return 0
    return 1 << max(0, math.ceil(math.log2(spp * FIRST / seconds)))


def rounds(spp: int, first: int, leap: int = 2) -> list[tuple[int, int]]:
    """Ranges of samples: one for all of them, or rounds that grow, so that a complete image exists early.

    Parameters
    ----------
    spp : int
    first : int
        Samples in the first round; 0: all in one round.
    leap : int
        Each round doubles the samples, or multiplies them by up to 8 if ``leap`` allows it, up to 3/8 of all.

    >>> rounds(20, 4), rounds(20, 0), rounds(200, 8, 8)
    ([(0, 4), (4, 8), (8, 16), (16, 20)], [(0, 20)], [(0, 8), (8, 64), (64, 128), (128, 200)])
    """
    bounds = [0]
    while first and first < spp:
        bounds.append(first)
        first *= next(k for k in (8, 4, 2) if k == 2 or (k <= leap and 8 * k * first <= 3 * spp))
    return list(pairwise([*bounds, spp]))
