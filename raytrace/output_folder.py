"""The output folder of a report."""

import os
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
