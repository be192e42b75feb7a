"""The picture while it is drawn, for whoever wants to look."""

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Window
from raytrace.rendering.progress import Progress, ProgressListener
from raytrace.rendering.work_items import inverse


class Preview(ProgressListener):
    """A watcher that has the picture, as far as it is drawn.

    Attributes
    ----------
    samples : array of int32
        Of each pixel so far, of the film's and a few more.
    window : Window
        What is drawn of the film.
    """

    def __init__(self) -> None:
        super().__init__(self.look)
        self.samples, self.window = np.zeros(0, np.int32), Window(0, 0, 0, 0)

    def look(self, progress: Progress) -> None:
        """Hear how far it is; a good time to look."""

    def early(self, samples: int) -> bool:
        """A picture to look at is wanted early."""
        return True

    def begin(self, samples: NDArray[np.int32], at: NDArray[np.int64], window: Window) -> None:
        """Take paper of the size of the film."""
        self.samples, self._at, self.window = samples, at, window
        self._shown, self._blank = np.zeros((3, len(at))), np.ones(len(at), np.bool_)

    def show(self, pixels: slice | NDArray[np.int64], shown: NDArray[np.float64]) -> None:
        """Keep pixels; they are in one part at a time, so no other thread has them."""
        m = len(self._blank[pixels])
        for channel, values in zip(self._shown, shown, strict=True):
            channel[pixels] = values[:m]
        self._blank[pixels] = False

    def whole(self) -> bool:
        """Whether every pixel has been drawn at least once."""
        return not self._blank.any()

    def picture(self, side: int) -> NDArray[np.uint8]:
        """The picture so far, sRGB, (h, w, 3); black where nothing is drawn.

        Where it has more than so many pixels a side, it is every second, third ... of them.
        """
        height, width = self.window.height, self.window.width
        step = max(-(-max(height, width) // side), 1)
        at = inverse(self._at).reshape(height, width)[::step, ::step]
        return (255.0 * np.moveaxis(self._shown[:, at], 0, 2) + 0.5).astype(np.uint8)
