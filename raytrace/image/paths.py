"""Check paths and formats of image files; imports no NumPy."""

import os
from importlib.util import find_spec
from pathlib import Path

from raytrace.errors import FileError, printable

SUFFIXES = ".png", ".exr", ".npz"


def check_path(path: str | os.PathLike[str]) -> Path:
    """Check that an image can be written to `path`, before rendering; nothing is created.

    Raises
    ------
    FileError
        An unknown extension; a missing or read-only folder; `path` is a folder; EXR without the package OpenEXR.
    """
    path = Path(path)
    name, folder = printable(path), printable(path.parent)
    suffix_of(path)
    if os.path.isdir(path):  # False, where Path.is_dir raises, for a name too long
        raise FileError(f"{name}: is a folder; give the name of a file in it")
    if not os.path.isdir(path.parent):
        raise FileError(f"{name}: there is no folder {folder}; create it first")
    if not os.access(path.parent, os.W_OK):
        raise FileError(f"{name}: no permission to write in the folder {folder}; choose another one")
    return path


def suffix_of(path: Path) -> str:
    """Extension of an image file in lower case; a FileError for a format that is not supported here."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(f"{printable(path)}: unknown image format {suffix!r}; use .png, .exr or .npz")
    if suffix == ".exr" and find_spec("OpenEXR") is None:
        raise FileError(f"{printable(path)}: EXR needs OpenEXR: pip install OpenEXR; or use .npz")
    return suffix
