"""Files opened for reading, if they are regular ones: a FIFO hangs, a device or a file of ``/proc`` may never end.

And files that are written whole, or not at all.
"""

import contextlib
import errno
import os
import stat
import time
from pathlib import Path
from typing import BinaryIO

from raytrace.errors import FileError, printable

VIRTUAL = ("/proc", "/sys", "/dev")  # their files are made as they are read, of no size that is known
ORDINARY = "/dev/shm"  # but for this: files in memory
KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a character device",
    stat.S_IFBLK: "a block device",
}

HELD = 5, 32  # errors of Windows: access denied, sharing violation; so it is while a virus scanner reads a new file
PATIENCE = 2.0  # seconds until such a file is given up
PAUSE = 0.05  # seconds between two attempts

unfinished: set[Path] = set()  # temporary files that are being written: to delete where the process ends at once


def open_regular(path: str | os.PathLike[str], what: str = "a file") -> BinaryIO:
    """Open a regular file for reading; nothing is waited for, and no device is touched.

    Parameters
    ----------
    path : path
        Links are followed.
    what : str
        What the path should name, for the message: "a mesh file".

    Returns
    -------
    stream : binary file
        Buffered. `os.fstat` of it gives the size of the very file that is read.

    Raises
    ------
    FileError
        It is a directory, a FIFO, a device, a socket or a virtual file; checked before it is opened, and of the file
        that was opened.
    OSError
        The system can't open it; for callers to explain.

    Examples
    --------
    >>> with open_regular(__file__) as stream:
    ...     len(stream.read(3))
    3
    """
    check_regular(path, what)
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)
    flags |= getattr(os, "O_NOCTTY", 0)
    descriptor = os.open(path, flags)
    try:
        _check(path, os.fstat(descriptor).st_mode, _place(path, descriptor), what)
        if hasattr(os, "O_NONBLOCK"):
            os.set_blocking(descriptor, True)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def check_regular(path: str | os.PathLike[str], what: str = "a file") -> None:
    """Check that a path names a regular file, without opening it; raises as `open_regular` does."""
    try:
        mode = os.stat(path).st_mode
    except ValueError:  # a null character
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(path)) from None
    _check(path, mode, os.path.realpath(path), what)


def _place(path: str | os.PathLike[str], descriptor: int) -> str:
    """Where an open file lies: a link may lead elsewhere by now."""
    try:
        return os.readlink(f"/proc/self/fd/{descriptor}")
    except OSError:  # no Linux
        return os.path.realpath(path)


def _check(path: str | os.PathLike[str], mode: int, place: str, what: str) -> None:
    name = printable(os.fspath(path))
    if stat.S_ISDIR(mode):
        raise FileError(f"{name}: a directory; name {what} in it")
    if not stat.S_ISREG(mode):
        raise FileError(f"{name}: {KINDS.get(stat.S_IFMT(mode), 'something else')}, no regular file; name {what}")
    parents = {str(parent) for parent in Path(place).parents}
    if not parents.isdisjoint(VIRTUAL) and ORDINARY not in parents:
        raise FileError(f"{name}: a virtual file, no regular file; name {what}")


def write_whole(path: Path, *contents: bytes) -> None:
    """Write a file, which appears with all its content, or not at all; an older one is replaced.

    Parameters
    ----------
    path : Path
    *contents : bytes
        Are written one after the other.

    Raises
    ------
    FileError
        The file can't be written.

    Notes
    -----
    The content goes to a temporary file in the same folder, which then takes the name: others see the old file or the
    new one, never a part. On Windows that fails while a virus scanner holds one of them; it is tried again for
    `PATIENCE` seconds.
    """
    temporary = path.with_name(f".{os.urandom(8).hex()}.tmp")
    unfinished.add(temporary)
    try:
        with open(temporary, "xb") as stream:
            for content in contents:
                stream.write(content)
        _put_in_place(temporary, path)
    except OSError as error:
        raise FileError(f"{printable(str(path))}: can't be written: {error.strerror}") from error
    finally:
        with contextlib.suppress(OSError):  # in its place already, or never made
            temporary.unlink()
        unfinished.discard(temporary)


def _put_in_place(temporary: Path, path: Path) -> None:
    """Rename a file, again and again while Windows says that it is held."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return os.replace(temporary, path)
        except OSError as error:
            if getattr(error, "winerror", None) not in HELD or time.monotonic() > end:
                raise
        time.sleep(PAUSE)
