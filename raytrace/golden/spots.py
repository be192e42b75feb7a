"""Regions where an image differs most from its golden image; the page of a failure shows them enlarged."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.metrics import TILE, Comparison

MARGIN = 8  # pixels around a region that are shown with it


class Spot(NamedTuple):
    """A rectangle of pixels."""

    title: str
    row: int
    column: int
    height: int
    width: int

    def grown(self, shape: tuple[int, ...]) -> "Spot":
        """The rectangle enlarged by `MARGIN`, within an image."""
        top, left = max(self.row - MARGIN, 0), max(self.column - MARGIN, 0)
        bottom = min(self.row + self.height + MARGIN, shape[0])
        right = min(self.column + self.width + MARGIN, shape[1])
        return Spot(self.title, top, left, bottom - top, right - left)

    def contains(self, other: "Spot") -> bool:
        """Whether another rectangle lies inside."""
        down, across = other.row - self.row, other.column - self.column
        return min(down, across) >= 0 and down + other.height <= self.height and across + other.width <= self.width

    @property
    def pixels(self) -> tuple[slice, slice]:
        """Index of its pixels."""
        return slice(self.row, self.row + self.height), slice(self.column, self.column + self.width)


def find(difference: NDArray[np.float64], finite: NDArray[np.bool_], comparison: Comparison) -> list[Spot]:
    """The worst tile, and the worst pixel: one that is not finite, or the one with the largest difference.

    ``difference`` and ``finite`` are (h, w).
    """
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
    """Difference of the worst channel of each pixel, (h, w) from (h, w, 3); luminance would hide a change of hue."""
    which = np.abs(difference).argmax(axis=2)[..., None]
    return np.take_along_axis(difference, which, axis=2)[..., 0]
