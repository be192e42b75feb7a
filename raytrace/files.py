"""Files opened for reading, if they are regular ones: a FIFO hangs, a device or a file of ``/proc`` may never end."""

import errno
import os
import stat
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
