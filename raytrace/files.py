"""Safe reading and writing of files.

Only regular files are opened for reading: a FIFO can block, and a device or a file of ``/proc`` may have no end. Files
are written completely or not at all.
"""

import contextlib
import errno
import os
import stat
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import BinaryIO

from raytrace.errors import FileError, printable

VIRTUAL = ("/proc", "/sys", "/dev")  # their files are generated while they are read, and have no known size
ORDINARY = "/dev/shm"  # the exception: files in memory
KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a character device",
    stat.S_IFBLK: "a block device",
}

HELD = 5, 32  # Windows errors while a virus scanner reads a new file: access denied, sharing violation
PATIENCE = 2.5  # seconds to try again
PAUSE = 0.05  # seconds between two attempts

unfinished: set[Path] = set()  # temporary files that are being written; deleted if the process ends at once


def open_regular(path: str | os.PathLike[str], what: str = "a file") -> BinaryIO:
    """Open a regular file for reading, without blocking and without opening a device.

    Parameters
    ----------
    path : path
        Symbolic links are followed.
    what : str
        The expected kind of file, for the message, such as "a mesh file".

    Returns
    -------
    stream : binary file
        Buffered. `os.fstat` of it gives the size of exactly this file.

    Raises
    ------
    FileError
        The path is a directory, a FIFO, a device, a socket or a virtual file. This is checked before opening, and again
        for the opened file.
    OSError
        The system can't open the file; the caller explains it.

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
    except ValueError:  # the path has a null character
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(path)) from None
    _check(path, mode, os.path.realpath(path), what)


def _place(path: str | os.PathLike[str], descriptor: int) -> str:
    """Path of an open file; a symbolic link may have changed since."""
    try:
        return os.readlink(f"/proc/self/fd/{descriptor}")
    except OSError:  # not on Linux
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
    """Write a file, which appears with all its content or not at all; an existing file is replaced.

    Parameters
    ----------
    path : Path
    *contents : bytes
        Written one after the other.

    Raises
    ------
    FileError
        The file can't be written.
    """
    try:
        replace_whole(path, contents)
    except OSError as error:
        raise FileError(f"{printable(str(path))}: can't be written: {error.strerror}") from error


def replace_whole(path: Path, contents: Iterable[bytes], mode: int | None = None) -> None:
    """Write a file as `write_whole` does, but raise the system's OSError.

    Parameters
    ----------
    path : Path
    contents : iterable of bytes
    mode : int, optional
        Permissions on POSIX, whatever the umask. Default: those of any new file.

    Notes
    -----
    The content goes to a temporary file in the same folder, which is then renamed. So other processes see the old file
    or the new one, never an incomplete one. On Windows the rename fails while a virus scanner has one of them open; it
    is tried again for `PATIENCE` seconds.
    """
    temporary = path.with_name(f".{os.urandom(8).hex()}.tmp")
    unfinished.add(temporary)
    try:
        with open(temporary, "xb", opener=partial(os.open, mode=0o666 if mode is None else mode)) as stream:
            for content in contents:
                stream.write(content)
        if mode is not None and os.name == "posix":
            os.chmod(temporary, mode)
        _rename(temporary, path)
    finally:
        with contextlib.suppress(OSError):  # already renamed, or never created
            temporary.unlink()
        unfinished.discard(temporary)


def _rename(temporary: Path, path: Path) -> None:
    """Rename a file; try again while Windows reports that one of them is in use."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return os.replace(temporary, path)
        except OSError as error:
            if getattr(error, "winerror", None) not in HELD or time.monotonic() > end:
                raise
        time.sleep(PAUSE)
