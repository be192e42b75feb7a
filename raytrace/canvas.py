"""The film of one picture, and the parts of it that are handed out to be drawn on."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.parts import Part, curve
from raytrace.passes.estimate import Model, estimate
from raytrace.passes.film import Film, Frame, develop, make_film, make_frame, put, taken
from raytrace.records import Window


class Sheet(NamedTuple):
    """What a part is drawn on: whole packets of pixels, with the sums of the samples that they have."""

    x: NDArray[np.uint32]  # (n,) columns of the pixels
    y: NDArray[np.uint32]  # (n,) rows
    film: Film
    begin: int  # where the first pixel lies in the film

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sums of the pixels (12, n), as they lie in the film."""
        return self.film.sums[:, self.begin : self.begin + len(self.x)]


def blank(x: NDArray[np.uint32], y: NDArray[np.uint32]) -> Sheet:
    """A sheet of its own without a sample, for whole packets of pixels."""
    return Sheet(x, y, make_film(len(x)), 0)


class Canvas:
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
        self._model = model
        y, x = np.divmod(np.pad(self.at, (0, len(self.film.samples) - len(self.at)), "edge"), window.width)
        self._x, self._y = (x + window.x).astype(np.uint32), (y + window.y).astype(np.uint32)

    def lend(self, part: Part) -> Sheet:
        """The sheet of a part: the film itself, or a copy where its pixels do not lie side by side in whole packets."""
        pixels = part.pixels
        if isinstance(pixels, slice):
            return Sheet(self._x[pixels], self._y[pixels], self.film, pixels.start)
        padded = np.append(pixels, np.repeat(pixels[-1:], -len(pixels) % PACKET))
        return Sheet(self._x[padded], self._y[padded], taken(self.film, padded), 0)

    def take_back(self, part: Part, sheet: Sheet, samples: int) -> NDArray[np.float64]:
        """Take back a sheet whose pixels have so many samples now; their means as shown (3, n)."""
        n = len(sheet.x)
        sheet.film.samples[sheet.begin : sheet.begin + n] = samples
        shown = np.empty((3, n))
        estimate(sheet.film, sheet.begin, sheet.begin + n, self._model, shown.reshape(-1))
        if not isinstance(part.pixels, slice):
            put(self.film, part.pixels, sheet.film)
        return shown

    def develop(self) -> Frame:
        """What the film shows by now."""
        frame = make_frame(len(self.at))
        develop(self.film, self.at, frame)
        return frame
