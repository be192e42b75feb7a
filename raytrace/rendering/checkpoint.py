"""What is finished of a picture, on disk while it is drawn, so that a killed render goes on where it was.

A checkpoint is a journal. Its title says of which picture it is, one record how that is cut into parts; each other one
holds the sums of one finished part. So every part is written once, where a snapshot of the film would write all that is
finished again and again: 96 bytes a pixel, 1.6 GB for 4096 x 4096.

Sums are added in a fixed order, and which parts there are depends on the picture alone; so it has the same bits however
often it was begun anew. Parts are numbered in their order: a film that is drawn round after round is replayed.
"""

import contextlib
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError
from raytrace.passes.film import BINS
from raytrace.rendering import checkpoint_header
from raytrace.rendering.job import Job, Tiling, identity
from raytrace.rendering.journal import Journal

SUFFIX = ".checkpoint"  # after the name of the picture
FORMAT = 2
LAYOUT = 0xFFFFFFFF  # number of the record that says how the picture is cut into parts; theirs count from 0
EVERY = 2.0  # seconds between two writes at least
SHARE = 0.05  # of the time spent on drawing that may go into keeping parts; those that would exceed it are not kept
ROOM = 1 << 25  # bytes that wait to be written at most
FOREIGN = "not a checkpoint of this image; starting over"
QUIET = 10.0  # seconds of drawing of which nothing is kept unless it is asked for: a short picture pays nothing


class Checkpoint:
    """The finished parts of one picture, kept in a file.

    Parameters
    ----------
    path : Path
    resume : bool
        Go on from a file that is there. Else that is left alone for `QUIET` seconds of drawing, then gives way to a
        new one.
    tell : callable, optional
        Is given a line of text when there is something to say: that parts were found, that nothing can be written. By
        default the logger "raytrace" is.
    """

    def __init__(self, path: Path, resume: bool = True, tell: Callable[[str], None] | None = None) -> None:
        self.path, self.resume, self._tell = path, resume, tell or _log
        self._journal = Journal(path)
        self._waiting: list[tuple[int, bytes]] = []  # numbers of parts and their sums
        self._balance = 0.0  # seconds that may still go into keeping parts
        self._ours = False  # the file on disk is of this picture
        self._stopped = False
        self._lock = threading.Lock()  # of what waits: nobody holds it for long
        self._turn = threading.Lock()  # of whoever writes

    def begin(self, job: Job) -> Tiling | None:
        """Open the file of a picture; the layout of the parts in it, None where there are none.

        Raises
        ------
        FileError
            The file is of another picture, or no checkpoint, or in use, or can't be read or written.
        """
        self._job = job
        try:
            found = self._journal.title()
        except FileError as error:
            if self.resume:
                raise
            self._give_up(str(error))
            return None
        if found is not None and not checkpoint_header.is_one(found, self._title()):
            self._tell(f"{self.path}: {FOREIGN}")
            found = None
        if found is not None:
            return self._look(found["picture"])
        if self.resume:
            self._create()
        return None

    def _look(self, picture: dict[str, Any]) -> Tiling | None:
        """Go on from a file with a sound title, or leave it alone."""
        different = checkpoint_header.differences(self._title(), picture)
        self._ours = not different
        if not self.resume:
            if self._ours:
                self._tell(f"{self.path}: holds a part of this picture, from which --resume goes on; this begins anew")
            return None
        if different:
            raise FileError(f"{self.path}: is of another picture ({different}); delete it to begin this one")
        self._journal.open()
        places = self._journal.places
        layout = checkpoint_header.layout_of(self._journal.read(LAYOUT), self._job.first_spp)
        if places and layout is None:
            self._tell(f"{self.path}: {FOREIGN}")
            places.clear()
            self._journal.close()
            self._create()
        else:
            self._tell(f"{self.path}: goes on from {max(len(places) - 1, 0)} finished parts")
        return layout

    def settle(self, layout: Tiling) -> None:
        """Take note of how the picture is cut into parts; from now on it is drawn."""
        self._layout, self._began = layout, time.monotonic()
        self._due = self._began + EVERY
        if self._journal.is_open and LAYOUT not in self._journal.places:
            self._journal.append([self._record()])

    def has(self, number: int) -> bool:
        """Whether there is a record of a finished part."""
        return number in self._journal.places

    def find(self, number: int) -> NDArray[np.float64] | None:
        """Sums of a finished part, (12, n); None: it isn't here."""
        content = self._journal.read(number)
        if not content or len(content) % (8 * 3 * BINS):
            return None
        return np.frombuffer(content, "<f8").reshape(3 * BINS, -1)

    def add(self, number: int, sums: NDArray[np.float64], seconds: float) -> None:
        """Keep a finished part, which took so many seconds to draw; it is written later. Any thread may call this."""
        if self._stopped or (not self.resume and time.monotonic() - self._began < QUIET):
            return
        began = time.perf_counter()
        with self._lock:
            self._balance += SHARE * seconds
            if self._balance < 0:  # cheap parts of a large film: drawing some of them again costs less
                return
            self._waiting.append((number, sums.astype("<f8", copy=False).tobytes()))
            full = sum(len(content) for _, content in self._waiting) > ROOM
        if full:
            self._write()
        self._spend(time.perf_counter() - began)

    def write_when_due(self) -> None:
        """Write what waits, if the last write was long enough ago."""
        if time.monotonic() < self._due:
            return
        began = time.thread_time()  # waiting for the disk here costs the threads that draw nothing
        self._write()
        self._journal.sync()
        self._spend(time.thread_time() - began)
        self._due = time.monotonic() + EVERY

    def close(self, complete: bool) -> None:
        """Close the file; what waits is written unless the picture is complete: it will be written itself."""
        if not complete:
            self._write()
            self._journal.sync()
        self._stopped = True
        self._journal.close()

    def remove(self) -> None:
        """Delete the file, if it is of this picture: it has been written."""
        if self._ours:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)

    @property
    def kept(self) -> bool:
        """Whether there is a file from which this picture can go on."""
        return self._ours and self.path.exists()

    def _title(self) -> dict[str, Any]:
        """Which picture this is."""
        return {"format": FORMAT, **identity(self._job)}

    def _create(self) -> None:
        self._journal.create({"picture": self._title()})
        self._ours = True

    def _record(self) -> tuple[int, bytes]:
        """The layout, as it is written."""
        return LAYOUT, json.dumps(self._layout._asdict()).encode()

    def _spend(self, seconds: float) -> None:
        with self._lock:
            self._balance -= seconds

    def _write(self) -> None:
        """Append what waits; nothing is written any more once that fails."""
        with self._turn:
            with self._lock:
                waiting, self._waiting = self._waiting, []
            if self._stopped or not waiting:
                return
            try:
                if not self._journal.is_open:
                    self._create()
                    self._journal.append([self._record()])
                self._journal.append(waiting)
            except FileError as error:
                self._give_up(str(error))
            except BaseException:  # Ctrl-C in the midst: it comes again
                with self._lock:
                    self._waiting = waiting + self._waiting
                raise

    def _give_up(self, reason: str) -> None:
        self._stopped = True
        self._tell(f"{reason}; no more parts are kept, drawing goes on")


def _log(line: str) -> None:
    import logging

    logging.getLogger("raytrace").warning(line)
