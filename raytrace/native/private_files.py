"""Files that only their owner may write: a file that another user may have written is never read.

Files are opened without blocking (a FIFO would wait for a writer), and checked again once they are open, because the
name may belong to another file by then. Owners and modes are checked on POSIX only; on other systems the user's folders
are private.
"""

import contextlib
import errno
import os
import stat
from pathlib import Path

from raytrace.files import replace_whole

FOLDER, FILE = 0o700, 0o600  # modes
OTHERS = stat.S_IWGRP | stat.S_IWOTH
PROBE = 1 << 20  # bytes: more than the code of any kernel
READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
POSIX = hasattr(os, "geteuid")


class Untrusted(OSError):
    """A file or folder that another user may have written; the message names it and the reason."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        super().__init__(f"{path} {reason}")


def distrust(status: os.stat_result) -> str:
    """Return why the content of a file or folder may be another user's; "" if only this user or root may write it."""
    if not POSIX:
        return ""
    if status.st_uid not in (os.geteuid(), 0):
        return f"belongs to another user (uid {status.st_uid})"
    if status.st_mode & OTHERS:
        return f"can be written by other users (mode {stat.S_IMODE(status.st_mode):03o})"
    return ""


def _check(status: os.stat_result, path: Path) -> None:
    if reason := distrust(status):
        raise Untrusted(path, reason)


def _check_regular(status: os.stat_result, path: Path) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file", str(path))


def read(path: Path) -> bytes:
    """Return the content of a regular file that no other user may have written.

    Raises
    ------
    Untrusted
        The file or its folder belongs to another user, or others may write it.
    OSError
        It cannot be read.
    """
    with contextlib.ExitStack() as stack:
        folder: int | None = None
        name: Path | str = path
        if POSIX:  # opens the file in the folder that was checked
            folder = os.open(path.parent, READ | os.O_DIRECTORY)
            stack.callback(os.close, folder)
            _check(os.fstat(folder), path.parent)
            name = path.name
        _check_regular(os.stat(name, dir_fd=folder), path)
        stream = stack.enter_context(open(os.open(name, READ, dir_fd=folder), "rb"))
        status = os.fstat(stream.fileno())
        _check_regular(status, path)
        _check(status, path)
        return stream.read()


def make_folder(folder: Path) -> bool:
    """Make a folder and its parents, for this user only, whatever the umask; return whether it was missing."""
    missing = []
    for each in (folder, *folder.parents):
        if os.path.isdir(each):
            break
        missing.append(each)
    for each in reversed(missing):
        with contextlib.suppress(FileExistsError):  # another process made it
            os.mkdir(each, FOLDER)
            if POSIX:
                os.chmod(each, FOLDER)
    return bool(missing)


def write(path: Path, content: bytes) -> None:
    """Write a file in an existing folder of this user, whole or not at all.

    Raises
    ------
    Untrusted
        The folder belongs to another user, or others may write it.
    OSError
        It cannot be written.
    """
    _check(os.stat(path.parent), path.parent)
    replace_whole(path, [content], FILE)


def nearest(folder: Path) -> Path:
    """Return the folder, or its nearest parent that exists."""
    return next((each for each in (folder, *folder.parents) if os.path.exists(each)), folder)


def probe(folder: Path) -> str:
    """Return why a file of a kernel's size cannot be written in a folder, or in its nearest parent; "" if it can."""
    name = nearest(folder) / f".{os.urandom(8).hex()}.tmp"
    try:
        with contextlib.suppress(FileNotFoundError):
            os.stat(folder)  # a name too long, or below a file
        with open(os.open(name, CREATE, FILE), "wb") as stream:
            stream.write(os.urandom(PROBE))
    except OSError as error:
        return error.strerror or str(error)
    finally:
        with contextlib.suppress(OSError):
            name.unlink(missing_ok=True)
    return ""
