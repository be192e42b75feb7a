"""Output folders: of reports, and of exported scenes."""

import contextlib
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from raytrace.errors import FileError, printable
from raytrace.files import write_whole


def check_folder(folder: Path) -> None:
    """Create a folder and check that it is writable, before time is spent on its content.

    Raises
    ------
    FileError
        The folder can't be created, or is not writable.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{printable(folder)}: can't be made: {error.strerror}; choose another folder") from error
    if not os.access(folder, os.W_OK):
        raise FileError(f"{printable(folder)}: no permission to write there; choose another folder")


def write(folder: Path, files: Mapping[str, bytes]) -> tuple[Path, ...]:
    """Write files by name, each completely or not at all; return their paths."""
    for name, data in files.items():
        write_whole(folder / name, data)
    return tuple(folder / name for name in files)


def write_new_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write a folder, which appears with all its files or not at all.

    Parameters
    ----------
    folder : Path
        An existing folder is replaced if it is empty, or has only files that are written now.
    files : mapping of str to bytes
        Contents by their paths in the folder, with "/".

    Raises
    ------
    FileError
        The folder has other files, or can't be written.
    """
    if others := _others(folder, files):
        raise FileError(
            f"{printable(folder)}: has other files ({printable(others[0])}); choose a new or an empty folder"
        )
    folder = folder.resolve()
    aside, old = (folder.with_name(f".{os.urandom(8).hex()}.tmp") for _ in range(2))
    try:
        for name, data in files.items():
            (aside / name).parent.mkdir(parents=True, exist_ok=True)
            (aside / name).write_bytes(data)
        if folder.exists():
            folder.rename(old)
        try:
            aside.rename(folder)
        except OSError:
            with contextlib.suppress(OSError):  # put back what was there
                old.rename(folder)
            raise
    except OSError as error:
        raise FileError(f"{printable(folder)}: can't be written: {error.strerror}; choose another folder") from error
    finally:
        for each in (aside, old):
            shutil.rmtree(each, ignore_errors=True)


def _others(folder: Path, files: Mapping[str, bytes]) -> list[str]:
    """Return paths in a folder that are not among files; the folder itself if it is none."""
    if not os.path.lexists(folder):
        return []
    if not folder.is_dir():
        raise FileError(f"{printable(folder)}: exists, and is no folder; choose another one")
    found = [path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()]
    return sorted(name for path in found if (name := path.relative_to(folder).as_posix()) not in files)
