"""A file of records that is only ever appended to: whatever kills its writer, the whole records in it stay readable.

A record has a number, its content, its length, and a checksum of all three. The first says what the file is, in JSON.
What a kill, or a full disk, left of the last one is told from a whole one, and cut off.
"""

import contextlib
import json
import os
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from raytrace.errors import FileError
from raytrace.files import open_regular, write_whole

HEAD = struct.Struct("<IIQ")  # of a record: CRC-32 of all that follows, its number, bytes of its content
LONGEST = 1 << 20  # bytes of a title


class Place(NamedTuple):
    """Where in a file the content of a record lies."""

    offset: int
    length: int  # bytes


class Journal:
    """A file of records.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    places : dict of int to Place
        By number, of the records that were there when it was opened.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.places = path, dict[int, Place]()
        self._file = -1  # open for appending; -1: closed
        self._end = 0  # of the last whole record

    def title(self) -> Any:
        """What the file says that it is, as JSON types; None: there is no file; "": it says nothing that is JSON.

        Raises
        ------
        FileError
            It isn't one of these, or can't be read.
        """
        with self._telling("read"):
            try:
                with open_regular(self.path, "a checkpoint") as stream:
                    head = stream.read(HEAD.size)
                    checksum, number, length = HEAD.unpack(head.ljust(HEAD.size))
                    content = stream.read(min(length, LONGEST))
            except FileNotFoundError:
                return None
        if _checksum(number, content) == checksum:
            return parsed(content) or ""
        raise FileError(f"{self.path}: is no checkpoint; delete or rename it")

    def create(self, title: Any) -> None:
        """Begin a new file, which appears with its title or not at all; a FileError where that can't be done."""
        content = json.dumps(title).encode()
        write_whole(self.path, _head(0, content), content)
        self._lock()
        self._end = HEAD.size + len(content)

    def open(self) -> None:
        """Go on with a file that is there: find its whole records, and cut off what follows them."""
        self._lock()
        with self._telling("read"), open_regular(self.path, "a checkpoint") as stream:
            size = os.fstat(stream.fileno()).st_size
            while len(head := stream.read(HEAD.size)) == HEAD.size:
                checksum, number, length = HEAD.unpack(head)
                content = stream.read(length) if length < size else b""
                if len(content) < length or _checksum(number, content) != checksum:
                    break
                if self._end:  # the title comes first
                    self.places[number] = Place(self._end + HEAD.size, length)
                self._end += HEAD.size + length
        self._cut()

    def read(self, number: int) -> bytes | None:
        """Content of a record that was there when the file was opened; None: it wasn't, or can't be read any more."""
        place = self.places.get(number)
        with contextlib.suppress(OSError):
            if place:
                with open_regular(self.path) as stream:
                    stream.seek(place.offset)
                    return stream.read(place.length)
        return None

    def append(self, records: Sequence[tuple[int, bytes]]) -> None:
        """Append records, all or none; a FileError where that can't be done."""
        try:
            with self._telling("written"):
                for number, content in records:
                    for rest in (memoryview(_head(number, content)), memoryview(content)):
                        while rest:
                            rest = rest[os.write(self._file, rest) :]
        except BaseException:  # also Ctrl-C in the midst
            self._cut()
            raise
        self._end += sum(HEAD.size + len(content) for _, content in records)

    def sync(self) -> None:
        """Have the system put on the disk what was written, lest a power cut take it."""
        if self.is_open:
            with contextlib.suppress(OSError):  # a file system that can't
                os.fsync(self._file)

    @property
    def is_open(self) -> bool:
        """Whether it can be appended to."""
        return self._file >= 0

    def close(self) -> None:
        """Let others write the file."""
        if self.is_open:
            os.close(self._file)
            self._file = -1

    def _lock(self) -> None:
        """Open the file for this process alone; where locks are unknown, for whoever does."""
        with self._telling("written"):
            self._file = os.open(self.path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0))
        try:
            import fcntl

            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise FileError(f"{self.path}: another render writes it; wait, or choose another output") from None
        except (ImportError, OSError):  # Windows; a file system without locks
            pass

    def _cut(self) -> None:
        """Take back what was written of a record."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._file, self._end)

    @contextlib.contextmanager
    def _telling(self, what: str) -> Any:
        try:
            yield
        except FileError:
            raise
        except OSError as error:
            raise FileError(f"{self.path}: can't be {what}: {error.strerror}") from error


def parsed(content: bytes) -> Any:
    """JSON as Python has it; "" where it is none."""
    try:
        return json.loads(content)
    except (ValueError, RecursionError):  # no JSON, no UTF-8, too many digits; brackets a thousand deep
        return ""


def _checksum(number: int, content: bytes) -> int:
    return zlib.crc32(content, zlib.crc32(struct.pack("<IQ", number, len(content))))


def _head(number: int, content: bytes) -> bytes:
    return HEAD.pack(_checksum(number, content), number, len(content))
