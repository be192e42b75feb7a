"""Where pictures may be written, and in which format: known before NumPy is imported."""

import os
from importlib.util import find_spec
from pathlib import Path

from raytrace.errors import FileError, printable


def check_path(path: str | os.PathLike[str]) -> Path:
    """Check that a picture can be written to `path`, before a render is lost; nothing is created.

    Raises
    ------
    FileError
        An unknown extension, a missing or read-only folder, a folder at `path`, EXR without the OpenEXR package.
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
    """The ending of a picture's name, small; a FileError for one that can't be written here."""
    suffix = path.suffix.lower()
    if suffix not in (".png", ".exr", ".npz"):
        raise FileError(f"{printable(path)}: unknown kind of picture {suffix!r}; use .png, .exr or .npz")
    if suffix == ".exr" and find_spec("OpenEXR") is None:
        raise FileError(f"{printable(path)}: EXR needs OpenEXR: pip install OpenEXR; or use .npz")
    return suffix
