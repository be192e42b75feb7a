"""``BackgroundRenderer``: a thread that renders the latest requested scene progressively."""

import io
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import RaytraceError
from raytrace.image.files import srgb8
from raytrace.limits import MAX_SIDE
from raytrace.records import Scene
from raytrace.rendering.preview import Preview
from raytrace.rendering.progress import Progress
from raytrace.rendering.rendering import render
from raytrace.scene.seen_backs import expect_backs

GRACE = 0.08  # s of waiting for a new request after the first frame: the browser needs the cores to display it
PAUSE = 0.2  # s between two frames of the same scene, each with more samples
QUALITY = 85  # JPEG quality of unfinished images: an eighth of the size of a PNG


class EncodedImage(NamedTuple):
    """An encoded image for the browser."""

    data: bytes
    kind: str  # "image/jpeg"; "image/png" with all samples
    samples: float  # per pixel, averaged over the image


class _OutdatedError(Exception):
    """There is a newer request."""


class BackgroundRenderer:
    """Renders scenes in a thread of its own, which ends when there are no requests.

    Parameters
    ----------
    make : callable
        Returns the scene to render, with its settings; called in that thread.
    send : callable
        Called with each EncodedImage, in that thread.
    fail : callable
        Called with each exception, in that thread.
    size : (width, height), pixels, optional
        Of the first image of each scene, with 1 sample per pixel: small enough to follow the user's movements. Default:
        the size of the scene.
    """

    def __init__(
        self,
        make: Callable[[], Scene],
        send: Callable[[EncodedImage], None],
        fail: Callable[[Exception], None],
        size: tuple[int, int] | None = None,
    ) -> None:
        self._make, self._send, self._fail, self._size = make, send, fail, size
        self._lock, self._requested, self._busy = threading.Lock(), threading.Event(), False

    def request(self) -> None:
        """Request an image of the scene that ``make`` returns now; earlier requests are cancelled."""
        with self._lock:
            self._requested.set()
            if not self._busy:
                self._busy = True
                threading.Thread(target=self._work, name="raytrace-viewer", daemon=True).start()

    def outdated(self, seconds: float = 0.0) -> bool:
        """Whether to cancel the render: a new request comes within some seconds, or the process ends."""
        return self._requested.wait(seconds) or not threading.main_thread().is_alive()

    def _work(self) -> None:
        while self._next():
            try:
                scene = self._make()
                expect_backs(scene)
                larger = self._size is not None and scene.settings.size != self._size
                if larger:
                    self._send_small(scene)
                image = render(scene, progress=_PreviewSender(self, cancel=larger))
                self._send(EncodedImage(image._repr_png_(), "image/png", image.provenance["spp"]))
            except _OutdatedError:
                continue
            except RaytraceError as error:
                self._fail(error)
            except Exception as error:
                self._busy = False  # this thread ends; the next request starts another
                self._fail(error)
                raise

    def _send_small(self, scene: Scene) -> None:
        """Send the first image; then wait for a new request, because the image at rest takes longer."""
        image = render(scene, spp=1, size=self._size, progress=False)
        self.send_preview(srgb8(image.rgb), 1.0)
        if self.outdated(GRACE):
            raise _OutdatedError

    def _next(self) -> bool:
        with self._lock:
            self._busy = self._requested.is_set()
            self._requested.clear()
            return self._busy

    def send_preview(self, pixels: NDArray[np.uint8], samples: float) -> None:
        """Send an unfinished image."""
        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, "jpeg", quality=QUALITY)
        self._send(EncodedImage(stream.getvalue(), "image/jpeg", samples))


class _PreviewSender(Preview):
    """Sends previews, the first at one sample per pixel; stops the render if it is outdated.

    Parameters
    ----------
    renderer : BackgroundRenderer
    cancel : bool
        Whether to stop even before the first preview; else it is always sent, because the user sees it while dragging.
    """

    def __init__(self, renderer: BackgroundRenderer, cancel: bool) -> None:
        super().__init__()
        self._renderer, self._cancel = renderer, cancel
        self._next, self._wait = 0.0, 0.0 if cancel else GRACE

    def look(self, progress: Progress) -> None:
        """Send a preview if the last one is old enough."""
        if progress.stage != "rendering":
            return
        if (self._cancel or self._next) and self._renderer.outdated():
            raise _OutdatedError
        if time.perf_counter() >= self._next and self.whole():
            self._renderer.send_preview(self.image(MAX_SIDE), float(self.samples.mean()))
            if self._renderer.outdated(self._wait):
                raise _OutdatedError
            self._next, self._wait = time.perf_counter() + PAUSE, 0.0
