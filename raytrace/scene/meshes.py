"""Mesh files to arrays, by readers that believe nothing of what a file announces."""

import gzip
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from raytrace.errors import FileError, SceneError
from raytrace.records import RawMesh
from raytrace.scene.files import MAX_BYTES, format_of, locate
from raytrace.scene.glb import read_glb
from raytrace.scene.obj import ObjError, read_obj
from raytrace.scene.ply import read_ply
from raytrace.scene.rawmesh import concatenate
from raytrace.scene.stl import read_stl

READERS: dict[str, Callable[[bytes], list[RawMesh | None]]] = {
    ".obj": lambda data: [read_obj(data)],
    ".ply": lambda data: [read_ply(data)],
    ".stl": lambda data: [read_stl(data)],
    ".glb": lambda data: list(read_glb(data)),
}


def _read_bytes(path: Path) -> bytes:
    try:
        if path.suffix.lower() != ".gz":
            return path.read_bytes()
        with gzip.open(path) as file:
            data = file.read(MAX_BYTES + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise SceneError([f"{path}: broken or truncated gzip file: {error}"]) from None
    except OSError as error:
        raise FileError(f"{path}: can't be read: {error.strerror or error}") from None
    if len(data) > MAX_BYTES:
        raise FileError(f"{path}: unfolds to more than {MAX_BYTES} bytes; split it or simplify it")
    return data


def _check(mesh: RawMesh, path: Path) -> None:
    finite = np.isfinite(mesh.vertices).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise SceneError([f"{path}: vertex row {row} is not finite: {mesh.vertices[row].tolist()}"])
    wrong = ((mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        text = f"face row {row} uses vertices {mesh.faces[row].tolist()}, but there are {len(mesh.vertices)}"
        raise SceneError([f"{path}: {text}, counted from 0"])


def read_mesh(path: Path) -> RawMesh:
    """Read all triangles of a mesh file; several parts become one, each where its transforms put it.

    Parameters
    ----------
    path : pathlib.Path
        An OBJ, PLY, STL or GLB file, plain or compressed with gzip.

    Returns
    -------
    RawMesh
        At least one triangle.

    Raises
    ------
    SceneError
        What is wrong with the content; one line that begins with the path, for OBJ with ``path:line``.
    FileError
        The file is missing, a directory, too large or can't be read.

    Examples
    --------
    >>> read_mesh(Path("nowhere/box.obj"))
    Traceback (most recent call last):
    raytrace.errors.FileError: nowhere/box.obj: no such file; there is no folder nowhere
    """
    locate(path)
    data = _read_bytes(path)
    kind = format_of(path)
    try:
        with np.errstate(all="ignore"):  # what is not finite is found below
            parts = [part for part in READERS[kind](data) if part is not None]
    except ObjError as error:
        raise SceneError([f"{path}:{error.line}: {error}"]) from None
    except MemoryError:
        raise FileError(f"{path}: not enough memory to read it; split it or simplify it") from None
    except (ValueError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SceneError([f"{path}: no complete {kind[1:].upper()} file: {reason}"]) from error
    if not sum(len(part.faces) for part in parts):
        raise SceneError([f"{path}: no triangles in it"])
    for part in parts:
        _check(part, path)
    return concatenate(parts) if len(parts) > 1 else parts[0]
