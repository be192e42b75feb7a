"""The film of one picture, and the parts of it that are handed out to be drawn on."""

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.passes.estimate import Model, estimate
from raytrace.passes.film import Film, Frame, blank_frame, develop, make_film, make_frame, put, taken
from raytrace.records import Window
from raytrace.rendering.work_items import WorkItem, curve

ALL = 2**31 - 1  # more samples than a pixel has


class FilmTile(NamedTuple):
    """What a part is drawn on: whole packets of pixels, with the sums of the samples that they have."""

    x: NDArray[np.uint32]  # (n,) columns of the pixels
    y: NDArray[np.uint32]  # (n,) rows
    film: Film
    begin: int  # where the first pixel lies in the film

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sums of the pixels (12, n), as they lie in the film."""
        return self.film.sums[:, self.begin : self.begin + len(self.x)]


def blank(x: NDArray[np.uint32], y: NDArray[np.uint32]) -> FilmTile:
    """A sheet of its own without a sample, for whole packets of pixels."""
    return FilmTile(x, y, make_film(len(x)), 0)


class FilmTiles:
    """The film of a window, its pixels in the order of ``curve``.

    Parameters
    ----------
    window : Window
    model : Model
        Of the sampler: what errors are estimated by.

    Attributes
    ----------
    film : Film
    at : (m,) array of int
        Places of the film's pixels in the window, row after row.
    """

    def __init__(self, window: Window, model: Model) -> None:
        self.at = curve(window)
        self.film = make_film(len(self.at))
        self._model, self._last = (
            model,
            cast(Frame | None, None),
        )  # the frame of the last pass, for pixels that are drawn on in the next
        y, x = np.divmod(np.pad(self.at, (0, len(self.film.samples) - len(self.at)), "edge"), window.width)
        self._x, self._y = (x + window.x).astype(np.uint32), (y + window.y).astype(np.uint32)

    def places(self, pixels: NDArray[np.int64]) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Columns and rows of pixels of the film."""
        return self._x[pixels], self._y[pixels]

    def keep_passes(self) -> None:
        """From now on, remember what each pixel showed before it is drawn on in another pass."""
        self._last = blank_frame(len(self.at))

    def lend(self, part: WorkItem) -> FilmTile:
        """The sheet of a part: the film itself, or a copy where its pixels do not lie side by side in whole packets."""
        pixels = part.pixels
        if isinstance(pixels, slice):
            if self._last and part.first:
                develop(self.film, self.at[pixels], pixels.start, part.first, self._last)
            return FilmTile(self._x[pixels], self._y[pixels], self.film, pixels.start)
        padded = np.append(pixels, np.repeat(pixels[-1:], -len(pixels) % PACKET))
        return FilmTile(self._x[padded], self._y[padded], taken(self.film, padded), 0)

    def take_back(self, part: WorkItem, sheet: FilmTile, samples: int) -> NDArray[np.float64]:
        """Take back a sheet whose pixels have so many samples now; their means as shown (3, n)."""
        n = len(sheet.x)
        sheet.film.samples[sheet.begin : sheet.begin + n] = samples
        shown = np.empty((3, n))
        estimate(sheet.film, sheet.begin, sheet.begin + n, self._model, shown.reshape(-1))
        if not isinstance(part.pixels, slice):
            put(self.film, part.pixels, sheet.film)
        return shown

    def fill(self, part: WorkItem, sheet: FilmTile, sums: NDArray[np.float64]) -> None:
        """Put sums on a sheet, in a thread that may be interrupted: its pixels count as drawn on from the start."""
        sheet.film.samples[sheet.begin : sheet.begin + len(sheet.x)] = part.last
        sheet.sums[:] = sums

    def develop(self, most: int = ALL) -> Frame:
        """What the film shows; pixels with more samples than ``most`` are as they were before they were drawn on."""
        pixels = len(self.at)
        frame = self._last or (make_frame if most == ALL else blank_frame)(pixels)
        develop(self.film, self.at, 0, most, frame)
        return frame
