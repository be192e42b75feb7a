"""The person at a notebook, who sees a cell's picture while it is drawn."""

import sys
import threading
import time
from base64 import b64encode
from collections.abc import Callable
from functools import partial
from typing import Any

from raytrace.errors import OptionError
from raytrace.image import png
from raytrace.rendering.preview import Preview
from raytrace.rendering.progress import Progress, ProgressListener, speed

FIRST = 0.5  # s: a picture that is done sooner needs no preview
PAUSE = 0.25  # s between two looks, at least
SHARE = 0.02  # of the time: what looks may take
SIDE = 768  # pixels of a preview's longer side, at most
LONG = 1 << 26  # samples: seconds; then rounds over the whole film and looks take a tenth more of the quickest scene
QUICK = 1  # level of zlib: a third of the time, half as much again of bytes


def listener_of(progress: Any) -> ProgressListener:
    """Who watches a render: what its caller says, else whoever runs a notebook's cell.

    Raises
    ------
    OptionError
        ``progress`` is neither a function nor False.
    """
    if progress is None and in_cell():
        return NotebookPreview()
    if progress is None or progress is False:
        return ProgressListener(lambda _: None)
    if not callable(progress):
        raise OptionError(f"progress: expected a function, or False, got {progress!r}")
    return progress if isinstance(progress, ProgressListener) else ProgressListener(progress)


def in_cell() -> bool:
    """Whether a cell of a notebook waits for this thread; a notebook's IPython has a kernel, a terminal's has none."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel") and threading.current_thread() is threading.main_thread()


class NotebookPreview(Preview):
    """The output of a cell that shows the picture so far, and is empty again when the picture is there."""

    def __init__(self) -> None:
        super().__init__()
        self._next = time.perf_counter() + FIRST
        self._update: Callable[[dict[str, str]], None] | None = None

    def early(self, samples: int) -> bool:
        """Ask for the whole picture early where it takes long enough to be looked at."""
        return samples > LONG

    def look(self, progress: Progress) -> None:
        """Show the picture, if it is time."""
        now = time.perf_counter()
        if now >= self._next:
            self._show(progress)
            self._next = time.perf_counter() + max(PAUSE, (time.perf_counter() - now) / SHARE)

    def end(self, state: str) -> None:
        """Make room for the picture, or tell that it has fewer samples than were asked for."""
        if self._update or state:
            self._say(state)

    def _show(self, progress: Progress) -> None:
        if progress.stage == "rendering":
            caption = f"rendering: {self.samples.mean():.3g} samples a pixel, {speed(progress)}"
            data = b64encode(png.encode(self.picture(SIDE), {}, QUICK)).decode()
            self._say(caption, f'<img alt="" width="{self.window.width}" src="data:image/png;base64,{data}">')
        elif progress.stage == "compiling":
            self._say(f"compiling kernels (first run only): {progress.done} of {progress.total}")

    def _say(self, text: str, picture: str = "") -> None:
        from IPython.display import display

        bundle = {"text/plain": text, "text/html": f"<div>{picture}</div><small>{text}</small>" if text else ""}
        if self._update is None:
            self._update = partial(display(bundle, raw=True, display_id=True).update, raw=True)
        else:
            self._update(bundle)
