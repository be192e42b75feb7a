"""A preview in a notebook: the output of a cell shows the image while it is rendered."""

import sys
import threading
import time
from base64 import b64encode
from collections.abc import Callable
from functools import partial

from raytrace.image import png
from raytrace.rendering.preview import Preview
from raytrace.rendering.progress import Progress, speed

FIRST = 0.5  # seconds: a shorter render needs no preview
PAUSE = 0.25  # seconds between two previews, at least
SHARE = 0.02  # of the time: the most that previews may take
SIDE = 768  # pixels of a preview's longer side, at most
LONG = 1 << 26  # samples: some seconds; from here on, rounds and previews are worth a tenth more time in the worst case
QUICK = 1  # zlib level: a third of the time, one and a half times the bytes


def in_cell() -> bool:
    """Whether a notebook cell waits for this thread; in a notebook, IPython has a kernel, in a terminal it has none."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel") and threading.current_thread() is threading.main_thread()


class NotebookPreview(Preview):
    """A cell's output that shows the image so far, and is empty again when the image is complete."""

    def __init__(self) -> None:
        super().__init__()
        self._next = time.perf_counter() + FIRST
        self._update: Callable[[dict[str, str]], None] | None = None

    def early(self, samples: int) -> bool:
        """Whether the render takes long enough for a preview."""
        return samples > LONG

    def look(self, progress: Progress) -> None:
        """Show the image, if the last preview is long enough ago."""
        now = time.perf_counter()
        if now >= self._next:
            self._show(progress)
            self._next = time.perf_counter() + max(PAUSE, (time.perf_counter() - now) / SHARE)

    def end(self, state: str) -> None:
        """Clear the output, or say that the image has fewer samples than requested."""
        if self._update or state:
            self._say(state)

    def _show(self, progress: Progress) -> None:
        if progress.stage == "rendering":
            caption = f"rendering: {self.samples.mean():.3g} samples per pixel, {speed(progress)}"
            data = b64encode(png.encode(self.image(SIDE), {}, QUICK)).decode()
            self._say(caption, f'<img alt="" width="{self.window.width}" src="data:image/png;base64,{data}">')
        elif progress.stage == "compiling":
            self._say(f"compiling kernels (first run only): {progress.done} of {progress.total}")

    def _say(self, text: str, image: str = "") -> None:
        from IPython.display import display

        bundle = {"text/plain": text, "text/html": f"<div>{image}</div><small>{text}</small>" if text else ""}
        if self._update is None:
            self._update = partial(display(bundle, raw=True, display_id=True).update, raw=True)
        else:
            self._update(bundle)
