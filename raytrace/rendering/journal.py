"""A journal: a file of records that only grows, so that its complete records stay readable if the writer is killed.

A record has a number, its content, its length, and a checksum of all three. The first record is the title, in JSON. An
incomplete last record, after a kill or on a full disk, is detected by its checksum and truncated.
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
LONGEST = 1 << 20  # most bytes of a title


class Place(NamedTuple):
    """Position of a record's content in the file."""

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
        By number: the records that existed when the file was opened.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.places = path, dict[int, Place]()
        self._file = -1  # open for appending; -1: closed
        self._end = 0  # of the last complete record

    def title(self) -> Any:
        """Return the title as JSON types; None if there is no file, "" if the title is no JSON.

        Raises
        ------
        FileError
            The file is no journal, or can't be read.
        """
        with self._reporting("read"):
            try:
                with open_regular(self.path, "a checkpoint") as stream:
                    head = stream.read(HEAD.size)
                    checksum, number, length = HEAD.unpack(head.ljust(HEAD.size))
                    content = stream.read(min(length, LONGEST))
            except FileNotFoundError:
                return None
        if _checksum(number, content) == checksum:
            return parsed(content) or ""
        raise FileError(f"{self.path}: not a checkpoint; delete or rename it")

    def create(self, title: Any) -> None:
        """Create the file, which appears complete with its title or not at all; FileError if that fails."""
        content = json.dumps(title).encode()
        write_whole(self.path, _head(0, content), content)
        self._lock()
        self._end = HEAD.size + len(content)

    def open(self) -> None:
        """Open an existing file: find its complete records, and truncate what follows them."""
        self._lock()
        with self._reporting("read"), open_regular(self.path, "a checkpoint") as stream:
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
        """Return the content of a record that existed when the file was opened; None if missing or unreadable."""
        place = self.places.get(number)
        with contextlib.suppress(OSError):
            if place:
                with open_regular(self.path) as stream:
                    stream.seek(place.offset)
                    return stream.read(place.length)
        return None

    def append(self, records: Sequence[tuple[int, bytes]]) -> None:
        """Append records, all or none; FileError if that fails."""
        try:
            with self._reporting("written"):
                for number, content in records:
                    for rest in (memoryview(_head(number, content)), memoryview(content)):
                        while rest:
                            rest = rest[os.write(self._file, rest) :]
        except BaseException:  # also Ctrl-C in the middle
            self._cut()
            raise
        self._end += sum(HEAD.size + len(content) for _, content in records)

    def sync(self) -> None:
        """Ask the system to put written data on the disk, so that it survives a power cut."""
        if self.is_open:
            with contextlib.suppress(OSError):  # not supported by the file system
                os.fsync(self._file)

    @property
    def is_open(self) -> bool:
        """Whether records can be appended."""
        return self._file >= 0

    def close(self) -> None:
        """Close the file; other processes may then write it."""
        if self.is_open:
            os.close(self._file)
            self._file = -1

    def _lock(self) -> None:
        """Open the file and lock it for this process; on systems without locks, only open it."""
        with self._reporting("written"):
            self._file = os.open(self.path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0))
        try:
            import fcntl

            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise FileError(f"{self.path}: another render is using it; wait, or choose another output") from None
        except (ImportError, OSError):  # Windows; a file system without locks
            pass

    def _cut(self) -> None:
        """Truncate the file after the last complete record."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._file, self._end)

    @contextlib.contextmanager
    def _reporting(self, what: str) -> Any:
        try:
            yield
        except FileError:
            raise
        except OSError as error:
            raise FileError(f"{self.path}: can't be {what}: {error.strerror}") from error


def parsed(content: bytes) -> Any:
    """Parse JSON; "" where it is invalid."""
    try:
        return json.loads(content)
    except (ValueError, RecursionError):  # no JSON, no UTF-8, too many digits; brackets a thousand deep
        return ""


def _checksum(number: int, content: bytes) -> int:
    return zlib.crc32(content, zlib.crc32(struct.pack("<IQ", number, len(content))))


def _head(number: int, content: bytes) -> bytes:
    return HEAD.pack(_checksum(number, content), number, len(content))
