"""A preview: the image of a render that is still running."""

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Window
from raytrace.rendering.film_tiles import inverse
from raytrace.rendering.progress import Progress, ProgressListener


class Preview(ProgressListener):
    """A listener that keeps the image as far as it is rendered.

    Attributes
    ----------
    samples : array of int32
        Number of samples of each pixel so far; a few more elements than pixels.
    window : Window
        The part of the film that is rendered.
    """

    def __init__(self) -> None:
        super().__init__(self.look)
        self.samples, self.window = np.zeros(0, np.int32), Window(0, 0, 0, 0)

    def look(self, progress: Progress) -> None:
        """Receive a progress update; subclasses show the image here."""

    def early(self, samples: int) -> bool:
        """A preview always needs a complete image early."""
        return True

    def begin(self, samples: NDArray[np.int32], at: NDArray[np.int64], window: Window) -> None:
        """Allocate the preview's buffers."""
        self.samples, self._at, self.window = samples, at, window
        self._shown, self._blank = np.zeros((3, len(at))), np.ones(len(at), np.bool_)

    def show(self, pixels: slice | NDArray[np.int64], shown: NDArray[np.float64]) -> None:
        """Store pixels. They are in one work item at a time, so no other thread writes them."""
        m = len(self._blank[pixels])
        for channel, values in zip(self._shown, shown, strict=True):
            channel[pixels] = values[:m]
        self._blank[pixels] = False

    def whole(self) -> bool:
        """Whether every pixel has been rendered at least once."""
        return not self._blank.any()

    def image(self, side: int) -> NDArray[np.uint8]:
        """Return the image so far, sRGB, (h, w, 3); black where nothing is rendered.

        If a side has more than ``side`` pixels, only every second, third, ... pixel is returned.
        """
        height, width = self.window.height, self.window.width
        step = max(-(-max(height, width) // side), 1)
        at = inverse(self._at).reshape(height, width)[::step, ::step]
        return (255.0 * np.moveaxis(self._shown[:, at], 0, 2) + 0.5).astype(np.uint8)
