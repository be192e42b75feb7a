"""What is finished of a picture, on disk while it is drawn, so that a killed render goes on where it was.

A checkpoint is a log: records are appended, and none is ever changed. The first says, in JSON, of which picture it is
and how that is cut into parts; each of the others holds the sums of one finished part. A record has its length and a
checksum, so what a kill or a full disk left of the last one is told from a whole one, and cut off. A log writes every
part once, where a snapshot of the film would write all that is finished again and again: 96 bytes a pixel, 1.6 GB for
4096 x 4096.

Sums are added in a fixed order, and which parts there are depends on the picture alone; so it has the same bits however
often it was begun anew. Parts are numbered in their order: a film that is drawn round after round is replayed.
"""

import contextlib
import json
import os
import struct
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError
from raytrace.job import Job, Layout, identity
from raytrace.passes.film import BINS

SUFFIX = ".checkpoint"  # after the name of the picture
FORMAT = 1
HEAD = struct.Struct("<IIQ")  # of a record: CRC-32 of all that follows, number of the part, bytes of its sums
EVERY = 2.0  # seconds between two writes at least
SHARE = (
    0.05  # of the time spent on drawing parts that may go into keeping them; those that would exceed it are not kept
)
ROOM = 1 << 25  # bytes that wait to be written at most
QUIET = 10.0  # seconds of drawing of which nothing is kept unless it is asked for: a short picture pays nothing


class Record(NamedTuple):
    """Where in the file a part lies."""

    offset: int  # of its sums
    length: int  # bytes


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
        self._file = -1  # open for appending; -1: closed
        self._end = 0  # of its last whole record
        self._parts: dict[int, Record] = {}
        self._waiting: list[bytes] = []  # heads and sums, in turn
        self._balance = 0.0  # seconds that may still go into keeping parts
        self._ours = False  # the file on disk is of this picture
        self._stopped = False
        self._lock = threading.Lock()  # of what waits: nobody holds it for long
        self._turn = threading.Lock()  # of whoever writes

    def begin(self, job: Job, layout: Layout) -> Layout:
        """Open the file of a picture; the layout of its parts, which is the file's if it is gone on from.

        Raises
        ------
        FileError
            The file is of another picture, or no checkpoint, or in use, or can't be read or written.
        """
        self._job, self._layout, self._began = job, layout, time.monotonic()
        self._due = self._began + EVERY
        try:
            found = self._look()
        except FileError as error:
            if self.resume:
                raise
            self._give_up(str(error))
            return layout
        if found is None:
            if self.resume:
                self._create()
            return layout
        different = _differences(self._title(), found["picture"])
        self._ours = not different
        if self.resume and different:
            raise FileError(f"{self.path}: is of another picture ({different}); delete it to begin this one")
        if not self.resume:
            if self._ours:
                self._tell(f"{self.path}: holds a part of this picture, from which --resume goes on; this begins anew")
            return layout
        self._open()
        self._scan()
        self._tell(f"{self.path}: goes on from {len(self._parts)} finished parts")
        self._layout = Layout(**found["layout"])
        return self._layout

    def find(self, number: int) -> NDArray[np.float64] | None:
        """Sums of a finished part, (12, n); None: it isn't here."""
        record = self._parts.get(number)
        if record is None:
            return None
        return np.frombuffer(_read(self.path, *record), "<f8").reshape(3 * BINS, -1)

    def add(self, number: int, sums: NDArray[np.float64], seconds: float) -> None:
        """Keep a finished part, which took so many seconds to draw; it is written later. Any thread may call this."""
        if self._stopped or (not self.resume and time.monotonic() - self._began < QUIET):
            return
        began = time.perf_counter()
        with self._lock:
            self._balance += SHARE * seconds
            if self._balance < 0:  # cheap parts of a large film: drawing some of them again costs less
                return
            content = sums.astype("<f8", copy=False).tobytes()
            self._waiting += [_head(number, content), content]
            full = sum(map(len, self._waiting)) > ROOM
        if full:
            self._write()
        self._spend(time.perf_counter() - began)

    def write_when_due(self) -> None:
        """Write what waits, if the last write was long enough ago."""
        if time.monotonic() < self._due:
            return
        began = time.thread_time()  # waiting for the disk here costs the threads that draw nothing
        self._write()
        self._sync()
        self._spend(time.thread_time() - began)
        self._due = time.monotonic() + EVERY

    def close(self, complete: bool) -> None:
        """Close the file; what waits is written unless the picture is complete: it will be written itself."""
        if not complete:
            self._write()
            self._sync()
        self._stopped = True
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def remove(self) -> None:
        """Delete the file, if it is of this picture: it has been written."""
        if self._ours:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)

    @property
    def kept(self) -> bool:
        """Whether there is a file from which this picture can go on."""
        return self._ours and self.path.exists()

    def _look(self) -> dict[str, Any] | None:
        """What the file says of itself; None: there is none."""
        try:
            head = HEAD.unpack(_read(self.path, 0, HEAD.size))
            title = _read(self.path, HEAD.size, min(head[2], 1 << 20))
            if _checksum(head[1], title) == head[0]:
                return json.loads(title)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise FileError(f"{self.path}: can't be read: {error.strerror}") from error
        except (struct.error, ValueError):
            pass
        raise FileError(f"{self.path}: is no checkpoint; delete or rename it")

    def _title(self) -> dict[str, Any]:
        """Which picture this is."""
        return {"format": FORMAT, **identity(self._job)}

    def _create(self) -> None:
        """Begin a new file, which appears with its first record or not at all."""
        title = json.dumps({"picture": self._title(), "layout": self._layout._asdict()}).encode()
        temporary = self.path.with_name(f".{os.urandom(8).hex()}.tmp")
        try:
            temporary.write_bytes(_head(0, title) + title)
            os.replace(temporary, self.path)
        except OSError as error:
            raise FileError(f"{self.path}: can't be written: {error.strerror}") from error
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
        self._open()
        self._end, self._ours = HEAD.size + len(title), True

    def _open(self) -> None:
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0))
        except OSError as error:
            raise FileError(f"{self.path}: can't be written: {error.strerror}") from error
        if not _lock_file(self._file):
            os.close(self._file)
            self._file = -1
            raise FileError(f"{self.path}: another render is writing it; wait for that, or choose another output")

    def _scan(self) -> None:
        """Find the whole records of the file, and cut off what follows them."""
        with open(self.path, "rb") as stream:
            while len(head := stream.read(HEAD.size)) == HEAD.size:
                checksum, number, length = HEAD.unpack(head)
                content = stream.read(length) if length <= self.path.stat().st_size else b""
                if len(content) < length or _checksum(number, content) != checksum:
                    break
                if self._end:
                    self._parts[number] = Record(self._end + HEAD.size, length)
                self._end += HEAD.size + length
        os.ftruncate(self._file, self._end)

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
                if self._file < 0:
                    self._create()
                for content in waiting:
                    _write_all(self._file, content)
                self._end += sum(map(len, waiting))
            except FileError as error:
                self._give_up(str(error))
            except OSError as error:
                self._give_up(f"{self.path}: can't be written: {error.strerror}")
            except BaseException:  # Ctrl-C in the midst: it comes again
                self._cut()
                with self._lock:
                    self._waiting = waiting + self._waiting
                raise

    def _sync(self) -> None:
        """Have the system put on the disk what was written, lest a power cut take it."""
        if self._file >= 0:
            with contextlib.suppress(OSError):  # a file system that can't
                os.fsync(self._file)

    def _give_up(self, reason: str) -> None:
        self._cut()
        self._stopped = True
        self._tell(f"{reason}; no more parts are kept, drawing goes on")

    def _cut(self) -> None:
        """Take back what was written of a record."""
        if self._file >= 0:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._end)


def _log(line: str) -> None:
    import logging

    logging.getLogger("raytrace").warning(line)


def _checksum(number: int, content: bytes) -> int:
    return zlib.crc32(content, zlib.crc32(struct.pack("<IQ", number, len(content))))


def _head(number: int, content: bytes) -> bytes:
    return HEAD.pack(_checksum(number, content), number, len(content))


def _read(path: Path, offset: int, length: int) -> bytes:
    with open(path, "rb") as stream:
        stream.seek(offset)
        return stream.read(length)


def _write_all(file: int, content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(file, rest) :]


def _lock_file(file: int) -> bool:
    """Keep other processes from writing a file too; False if one does. Where locks are unknown, none is held."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _differences(mine: dict[str, Any], other: dict[str, Any]) -> str:
    """What two pictures don't have in common, in words."""
    names = [name for name in mine if mine[name] != other.get(name)]
    hashes = {"scene": "another scene", "sources": "other sources of raytrace"}
    return ", ".join(hashes.get(name) or f"{name} {other.get(name)}, not {mine[name]}" for name in names)
