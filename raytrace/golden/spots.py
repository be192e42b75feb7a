"""Where an image differs most from its golden: the places that the page of a failure marks and enlarges."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.metrics import TILE, Comparison

MARGIN = 8  # pixels around a place that are enlarged with it


class Spot(NamedTuple):
    """A rectangle of pixels."""

    title: str
    row: int
    column: int
    height: int
    width: int

    def grown(self, shape: tuple[int, ...]) -> "Spot":
        """With the pixels around it that lie in an image."""
        top, left = max(self.row - MARGIN, 0), max(self.column - MARGIN, 0)
        bottom = min(self.row + self.height + MARGIN, shape[0])
        right = min(self.column + self.width + MARGIN, shape[1])
        return Spot(self.title, top, left, bottom - top, right - left)

    def holds(self, other: "Spot") -> bool:
        """Whether another lies in it."""
        down, across = other.row - self.row, other.column - self.column
        return min(down, across) >= 0 and down + other.height <= self.height and across + other.width <= self.width

    @property
    def pixels(self) -> tuple[slice, slice]:
        """Index of its pixels."""
        return slice(self.row, self.row + self.height), slice(self.column, self.column + self.width)


def find(difference: NDArray[np.float64], finite: NDArray[np.bool_], comparison: Comparison) -> list[Spot]:
    """Find the worst tile, and the worst pixel: one that isn't finite, or else that differs most; (h, w) both."""
    found = []
    if comparison.worst_tile > 0:
        height, width = (min(TILE, extent) for extent in difference.shape)
        found.append(Spot("worst tile", *comparison.worst_tile_at, height, width))
    off = np.where(finite, np.abs(difference), np.inf)
    row, column = np.unravel_index(np.argmax(off), off.shape)
    if off[row, column] > 0:
        found.append(Spot("worst pixel", int(row), int(column), 1, 1))
    return found


def largest_channel(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each pixel the channel that differs most: (h, w) of (h, w, 3). Luminance hides a change of hue."""
    which = np.abs(difference).argmax(axis=2)[..., None]
    return np.take_along_axis(difference, which, axis=2)[..., 0]
