"""How far a render is, and who is told."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Window


class Progress(NamedTuple):
    """One message of a running render."""

    stage: str  # "compiling", "building" or "rendering"
    done: int  # finished parts
    total: int  # all parts
    rays: int  # traced so far, of all kinds
    seconds: float  # since the stage began


class ProgressListener:
    """Whoever is told of a render; this one is told how far it is, and does not look at the picture.

    Parameters
    ----------
    tell : callable
        Is called, in the thread of the render's caller, with each Progress.
    """

    def __init__(self, tell: Callable[[Progress], None]) -> None:
        self._tell = tell

    def __call__(self, progress: Progress) -> None:
        """Hear how far it is."""
        self._tell(progress)

    def early(self, samples: int) -> bool:
        """Whether the whole picture is wanted early and then ever better, if it takes so many samples."""
        return False

    def begin(self, samples: NDArray[np.int32], at: NDArray[np.int64], window: Window) -> None:
        """Hear that the film begins.

        Parameters
        ----------
        samples : array of int32
            Of each pixel so far, while they grow; a few more than there are in the window.
        at : (m,) array of int
            Places in the window, row after row, of the film's pixels.
        window : Window
        """

    def show(self, pixels: slice | NDArray[np.int64], shown: NDArray[np.float64]) -> None:
        """See means of pixels of the film as shown, (3, m), and more; in the thread that drew them."""

    def end(self, state: str) -> None:
        """Hear that the picture is done, or with how many samples it was ended: "" if it is complete."""
