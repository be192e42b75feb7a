"""A thread that draws what was wanted last, better and better, until something else is wanted."""

import io
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import RaytraceError
from raytrace.limits import MAX_SIDE
from raytrace.records import Scene
from raytrace.rendering.preview import Preview
from raytrace.rendering.progress import Progress
from raytrace.rendering.rendering import render

GRACE = 0.08  # s after the first one, in which a hand that moves wants the next: the browser has the cores meanwhile
PAUSE = 0.2  # s between two frames of the same scene: they come with ever more samples
QUALITY = 85  # of JPEG, while the picture isn't done: an eighth of the bytes of a PNG


class Frame(NamedTuple):
    """A picture on its way to the screen."""

    data: bytes
    kind: str  # "image/jpeg"; "image/png" once all samples are there
    samples: float  # a pixel, on average


class _Stale(Exception):
    """Something else is wanted by now."""


class Artist:
    """Draws scenes in a thread of its own, which ends when there is nothing to do.

    Parameters
    ----------
    make : callable
        Gives the scene to draw, with its settings; is called in that thread.
    send : callable
        Takes a Frame, in that thread.
    fail : callable
        Takes what went wrong, in that thread.
    """

    def __init__(
        self, make: Callable[[], Scene], send: Callable[[Frame], None], fail: Callable[[Exception], None]
    ) -> None:
        self._make, self._send, self._fail = make, send, fail
        self._lock, self._wanted, self._busy = threading.Lock(), threading.Event(), False

    def draw(self) -> None:
        """Want a picture of what ``make`` gives now; what was begun before is dropped."""
        with self._lock:
            self._wanted.set()
            if not self._busy:
                self._busy = True
                threading.Thread(target=self._work, name="raytrace-artist", daemon=True).start()

    def stale(self, seconds: float = 0.0) -> bool:
        """Whether to drop what is being drawn: something else is wanted, within some seconds, or the process ends."""
        return self._wanted.wait(seconds) or not threading.main_thread().is_alive()

    def _work(self) -> None:
        while self._next():
            try:
                picture = render(self._make(), progress=_Easel(self))
                self._send(Frame(picture._repr_png_(), "image/png", picture.provenance["spp"]))
            except _Stale:
                continue
            except RaytraceError as error:
                self._fail(error)
            except Exception as error:
                self._busy = False  # this thread ends; the next picture has another
                self._fail(error)
                raise

    def _next(self) -> bool:
        with self._lock:
            self._busy = self._wanted.is_set()
            self._wanted.clear()
            return self._busy

    def send(self, picture: NDArray[np.uint8], samples: float) -> None:
        """Send a picture that isn't done."""
        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(picture).save(stream, "jpeg", quality=QUALITY)
        self._send(Frame(stream.getvalue(), "image/jpeg", samples))


class _Easel(Preview):
    """Shows a picture as soon as there is one sample a pixel, and then now and then; gives up if it is stale."""

    def __init__(self, artist: Artist) -> None:
        super().__init__()
        self._artist, self._next, self._wait = artist, 0.0, GRACE

    def look(self, progress: Progress) -> None:
        """Send the picture if it is time."""
        if progress.stage != "rendering":
            return
        if self._next and self._artist.stale():  # the first frame is worth its while: a hand that moves needs some
            raise _Stale
        if time.perf_counter() >= self._next and self.whole():
            self._artist.send(self.image(MAX_SIDE), float(self.samples.mean()))
            if self._artist.stale(self._wait):
                raise _Stale
            self._next, self._wait = time.perf_counter() + PAUSE, 0.0
