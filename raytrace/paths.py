"""Where pictures may be written, and in which format: known before NumPy is imported."""

import os
from importlib.util import find_spec
from pathlib import Path

from raytrace.errors import FileError


def check_path(path: str | os.PathLike[str]) -> Path:
    """Check that a picture can be written to `path`, before a render is lost; nothing is created.

    Raises
    ------
    FileError
        An unknown extension, a missing or read-only folder, a folder at `path`, EXR without the OpenEXR package.
    """
    path = Path(path)
    suffix_of(path)
    if os.path.isdir(path):  # False, where Path.is_dir raises, for a name too long
        raise FileError(f"{path}: is a folder; give the name of a file in it")
    if not os.path.isdir(path.parent):
        raise FileError(f"{path}: there is no folder {path.parent}; create it first")
    if not os.access(path.parent, os.W_OK):
        raise FileError(f"{path}: no permission to write in the folder {path.parent}; choose another one")
    return path


def suffix_of(path: Path) -> str:
    """The ending of a picture's name, small; a FileError for one that can't be written here."""
    suffix = path.suffix.lower()
    if suffix not in (".png", ".exr", ".npz"):
        raise FileError(f"{path}: unknown kind of picture {suffix!r}; use .png, .exr or .npz")
    if suffix == ".exr" and find_spec("OpenEXR") is None:
        raise FileError(f'{path}: EXR needs OpenEXR: pip install "raytrace[exr]"; or use .npz')
    return suffix
