"""Mesh files before they are read: which there are, and of which format."""

from pathlib import Path

from raytrace.errors import FileError, SceneError
from raytrace.scene.problems import no_such_file

FORMATS = ".obj", ".ply", ".stl", ".glb"
MAX_BYTES = 2**30  # of a mesh file, unfolded: about 10 million triangles of OBJ, 50 million of binary PLY


def format_of(path: Path) -> str:
    """Return the suffix that tells the format, without ``.gz``."""
    return Path(path.stem if path.suffix.lower() == ".gz" else path.name).suffix.lower()


def locate(path: Path) -> None:
    """Check that a path can be a mesh file, without reading it.

    Raises
    ------
    SceneError
        Its format is none of those that can be read.
    FileError
        There is no such file, or it is a directory, or too large.
    """
    try:
        if path.is_dir():
            raise FileError(f"{path}: a directory; name a mesh file in it")
        if not path.exists():
            raise FileError(no_such_file(path))
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: can't be read: {error.strerror or error}") from None
    if format_of(path) not in FORMATS:
        known = ", ".join(FORMATS)
        raise SceneError([f"{path}: no mesh format that can be read (known: {known}, plain or with .gz)"])
    if path.stat().st_size > MAX_BYTES:
        raise FileError(f"{path}: more than {MAX_BYTES} bytes; split it or simplify it")
