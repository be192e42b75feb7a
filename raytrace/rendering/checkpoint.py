"""Checkpoints: finished work items, written to disk during a render, so that an interrupted render can resume.

A checkpoint is a journal. Its title identifies the image. One record holds the tiling. Each other record holds the sums
of one finished work item, so every item is written once. A snapshot of the film would write everything again and again:
96 bytes per pixel, 1.6 GB for 4096 x 4096 pixels.

Sums are added in a fixed order, and the work items depend on job and tiling alone. So the image is bit-identical,
however often the render was interrupted. Items are numbered in order, and a resumed render replays them by rounds.
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
from raytrace.passes.film import sums_of
from raytrace.rendering import checkpoint_header
from raytrace.rendering.job import Job, Tiling, identity
from raytrace.rendering.journal import Journal

SUFFIX = ".checkpoint"  # appended to the name of the image file
FORMAT = 2
TILING = 0xFFFFFFFF  # number of the record with the tiling; work items count from 0
EVERY = 2.0  # seconds between two writes at least
SHARE = 0.05  # of the render time that may be spent on keeping items; those that would exceed it are not kept
ROOM = 1 << 25  # most bytes that wait to be written
FOREIGN = "not a checkpoint of this image; starting over"
QUIET = 10.0  # seconds at the start, of which nothing is kept without ``resume``: a short render has no cost


class Checkpoint:
    """Finished work items of one image, kept in a file.

    Parameters
    ----------
    path : Path
    resume : bool
        Resume from an existing file. If False, an existing file stays as it is for the first `QUIET` seconds of the
        render, and is then replaced.
    say : callable, optional
        Called with each message, such as the number of items found, or why nothing can be written. Default: the logger
        "raytrace".
    """

    def __init__(self, path: Path, resume: bool = True, say: Callable[[str], None] | None = None) -> None:
        self.path, self.resume, self._say = path, resume, say or _log
        self._journal = Journal(path)
        self._waiting: list[tuple[int, bytes]] = []  # numbers of items and their sums
        self._balance = 0.0  # seconds that may still be spent on keeping items
        self._ours = False  # the file on disk belongs to this image
        self._stopped = False
        self._lock = threading.Lock()  # for what waits; held only briefly
        self._turn = threading.Lock()  # held by the thread that writes

    def begin(self, job: Job) -> Tiling | None:
        """Open the file of an image; return the tiling of the items in it, None if there are none.

        Raises
        ------
        FileError
            The file belongs to another image, is no checkpoint, is in use, or can't be read or written.
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
            self._say(f"{self.path}: {FOREIGN}")
            found = None
        if found is not None:
            return self._resume(found["picture"])
        if self.resume:
            self._create()
        return None

    def _resume(self, image: dict[str, Any]) -> Tiling | None:
        """Resume from a file with a valid title, or leave it as it is."""
        different = checkpoint_header.differences(self._title(), image)
        self._ours = not different
        if not self.resume:
            if self._ours:
                self._say(f"{self.path}: a checkpoint of this image exists (use --resume); starting over")
            return None
        if different:
            raise FileError(f"{self.path}: belongs to another image ({different}); delete it to start this one")
        self._journal.open()
        places = self._journal.places
        tiling = checkpoint_header.tiling_of(self._journal.read(TILING), self._job.first_spp)
        if places and tiling is None:
            self._say(f"{self.path}: {FOREIGN}")
            places.clear()
            self._journal.close()
            self._create()
        else:
            self._say(f"{self.path}: resuming from {max(len(places) - 1, 0)} finished work items")
        return tiling

    def settle(self, tiling: Tiling) -> None:
        """Set the tiling; rendering starts now."""
        self._tiling, self._began = tiling, time.monotonic()
        self._due = self._began + EVERY
        if self._journal.is_open and TILING not in self._journal.places:
            self._journal.append([self._record()])

    def has(self, number: int) -> bool:
        """Whether there is a record of a finished work item."""
        return number in self._journal.places

    def find(self, number: int) -> NDArray[np.float64] | None:
        """Return the sums of a finished work item, (12, n) or (21, n); None if they are not here."""
        content, rows = self._journal.read(number), sums_of(self._job.light)
        if not content or len(content) % (8 * rows):
            return None
        return np.frombuffer(content, "<f8").reshape(rows, -1)

    def add(self, number: int, sums: NDArray[np.float64], seconds: float) -> None:
        """Keep a finished work item that took so many seconds; it is written later. Any thread may call this."""
        if self._stopped or (not self.resume and time.monotonic() - self._began < QUIET):
            return
        began = time.perf_counter()
        with self._lock:
            self._balance += SHARE * seconds
            if self._balance < 0:  # cheap items of a large film: rendering some of them again costs less
                return
            self._waiting.append((number, sums.astype("<f8", copy=False).tobytes()))
            full = sum(len(content) for _, content in self._waiting) > ROOM
        if full:
            self._write()
        self._spend(time.perf_counter() - began)

    def write_when_due(self) -> None:
        """Write the waiting items, if the last write was long enough ago."""
        if time.monotonic() < self._due:
            return
        began = time.thread_time()  # CPU time: waiting for the disk here does not slow down the render threads
        self._write()
        self._journal.sync()
        self._spend(time.thread_time() - began)
        self._due = time.monotonic() + EVERY

    def close(self, complete: bool) -> None:
        """Close the file. Waiting items are written only if the image is incomplete: a complete one is saved itself."""
        if not complete:
            self._write()
            self._journal.sync()
        self._stopped = True
        self._journal.close()

    def remove(self) -> None:
        """Delete the file if it belongs to this image; the image is saved."""
        if self._ours:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)

    @property
    def kept(self) -> bool:
        """Whether there is a file from which this render can resume."""
        return self._ours and self.path.exists()

    def _title(self) -> dict[str, Any]:
        """Return what identifies the image."""
        return {"format": FORMAT, **identity(self._job)}

    def _create(self) -> None:
        self._journal.create({"picture": self._title()})
        self._ours = True

    def _record(self) -> tuple[int, bytes]:
        """Return the record with the tiling."""
        return TILING, json.dumps(self._tiling._asdict()).encode()

    def _spend(self, seconds: float) -> None:
        with self._lock:
            self._balance -= seconds

    def _write(self) -> None:
        """Append the waiting items; after a failure, nothing more is written."""
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
            except BaseException:  # Ctrl-C in the middle: these items are written again later
                with self._lock:
                    self._waiting = waiting + self._waiting
                raise

    def _give_up(self, reason: str) -> None:
        self._stopped = True
        self._say(f"{reason}; the render continues without a checkpoint")


def _log(line: str) -> None:
    import logging

    logging.getLogger("raytrace").warning(line)
