"""Progress of a render, and the objects that receive it. NumPy is not imported: the command line starts without it."""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from raytrace.errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from raytrace.records import Window


class Progress(NamedTuple):
    """One message of a running render."""

    stage: str  # "compiling", "building" or "rendering"
    done: int  # finished work items
    total: int  # all work items
    rays: int  # traced so far, of all kinds
    seconds: float  # since the stage began


def speed(progress: Progress) -> str:
    """Rays per second, as text.

    Examples
    --------
    >>> speed(Progress("rendering", 1, 2, rays=3_000_000, seconds=2.0))
    '1.5 M rays/s'
    """
    return f"{progress.rays / max(progress.seconds, 1e-9) / 1e6:.1f} M rays/s"


class ProgressListener:
    """Receives the progress of a render; this class reports it, and does not look at the image.

    Parameters
    ----------
    report : callable
        Is called, in the thread of the render's caller, with each Progress.
    """

    def __init__(self, report: Callable[[Progress], None]) -> None:
        self._report = report

    def __call__(self, progress: Progress) -> None:
        """Receive a progress update."""
        self._report(progress)

    def early(self, samples: int) -> bool:
        """Whether the listener needs a complete image early, of a render that takes so many samples."""
        return False

    def begin(self, samples: "NDArray[np.int32]", at: "NDArray[np.int64]", window: "Window") -> None:
        """Receive the film before it is rendered.

        Parameters
        ----------
        samples : array of int32
            Number of samples of each pixel, updated during the render; a few more elements than pixels.
        at : (m,) array of int
            Position of each pixel of the film in the window, row by row.
        window : Window
        """

    def show(self, pixels: "slice | NDArray[np.int64]", shown: "NDArray[np.float64]") -> None:
        """Receive means of pixels as shown, (3, m) and more columns; called in the thread that rendered them."""

    def end(self, state: str) -> None:
        """Receive the end: "" for a complete image, else why it ended and with how many samples."""


def listener_of(progress: Any) -> ProgressListener:
    """Return the listener of a render: the caller's, or a preview in a notebook cell, or one that does nothing.

    Raises
    ------
    OptionError
        ``progress`` is neither a function nor False.
    """
    if progress is None and "IPython" in sys.modules:
        from raytrace.rendering.notebook import NotebookPreview, in_cell

        if in_cell():
            return NotebookPreview()
    if progress is None or progress is False:
        return ProgressListener(lambda _: None)
    if not callable(progress):
        raise OptionError(f"progress: expected a function, or False, got {progress!r}")
    return progress if isinstance(progress, ProgressListener) else ProgressListener(progress)
