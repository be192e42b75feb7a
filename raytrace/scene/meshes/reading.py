"""Mesh files to arrays, by readers that trust no size or count that a file states."""

import gzip
import io
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from raytrace.errors import FileError, FileMemoryError, RaytraceError, SceneError, shortened
from raytrace.limits import MAX_MESH, MAX_TRIANGLES
from raytrace.memory import Allowance, of_corners, of_reading
from raytrace.misnamed import ENCODED, is_utf16, mistaken
from raytrace.records import RawMesh
from raytrace.scene.attributes import COLOR, MATERIAL, NOTHING, UV, Wanted
from raytrace.scene.files import Reach, format_of, locate
from raytrace.scene.meshes.errors import TooLargeError, TooManyTrianglesError, UnsupportedError
from raytrace.scene.meshes.glb import read_glb
from raytrace.scene.meshes.obj import ObjError, read_obj
from raytrace.scene.meshes.ply import read_ply
from raytrace.scene.meshes.raw_mesh import concatenate
from raytrace.scene.meshes.stl import is_binary, is_text, read_stl

# arguments: content of a file, most triangles, wanted attributes
READERS: dict[str, Callable[[bytes, float, Wanted], list[RawMesh | None]]] = {
    ".obj": lambda data, _, wanted: [read_obj(data, wanted)],
    ".ply": lambda data, _, wanted: [read_ply(data, wanted)],
    ".stl": lambda data, _most, _wanted: [read_stl(data)],
    ".glb": lambda data, most, wanted: list(read_glb(data, most, wanted)),
}
PLACED = 200  # bytes per triangle that a node places; uv and colours take twice their size more


MAX_REASON = 300  # characters
UNPACKED_BYTES = 2**20  # bytes of a compressed file that are unpacked at a time
KIND_BYTES = 100  # bytes that identify the kind of a file
LAST_SPACE = 32  # characters up to this one separate words


def read_bytes(path: Path, allowance: Allowance) -> bytes:
    """Return the content of a file that ``locate`` has found, unpacked if it is compressed."""
    try:
        if path.suffix.lower() != ".gz":
            _afford(path, path.stat().st_size, None, allowance)
            return path.read_bytes()
        with gzip.open(path) as file:
            data = io.BytesIO()
            while piece := file.read(UNPACKED_BYTES):
                data.write(piece)
                if data.tell() > MAX_MESH:
                    raise FileError(f"{path}: unpacks to more than {MAX_MESH} bytes; split it or simplify it")
                _afford(path, data.tell(), None, allowance)
            return data.getvalue()
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        with path.open("rb") as file:
            _check_kind(path, file.read(KIND_BYTES))
        raise SceneError([f"{path}: broken or truncated gzip file: {error}"]) from None
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: can't be read: {error.strerror or error}") from None


def _afford(path: Path, length: int, words: int | None, allowance: Allowance, attributes: Wanted = NOTHING) -> None:
    """Refuse a file that needs more memory than there is."""
    if lacks := allowance.lacks(of_reading(format_of(path), length, words, attributes), "split it or simplify it"):
        raise FileMemoryError(f"memory: {path}: {lacks}")


def _other_reader(
    path: Path, reach: Reach | None, allowance: Allowance
) -> Callable[[bytes, float, Wanted], list[RawMesh]]:
    from raytrace.scene.meshes.other_formats import other_reader  # few scenes need it

    return other_reader(path, reach, allowance)


def _refusal(path: Path, error: ValueError, allowance: Allowance, placed: int) -> SceneError | FileError:
    """Return the error for a file that is refused, although it may be valid."""
    if isinstance(error, TooManyTrianglesError):
        if lacks := allowance.lacks(placed * error.load, "simplify it, or place it less often"):
            return FileMemoryError(f"memory: {path}: {error}, which {lacks}")
        return FileError(f"{path}: {error}; at most {MAX_TRIANGLES:,}")
    text = f"{path}: {shortened(' '.join(str(error).split()), MAX_REASON)}"
    return FileError(text) if isinstance(error, TooLargeError) else SceneError([text])


def _words(data: bytes, kind: str) -> int | None:
    """Return an upper bound of the number of words in a text; None if it is not a text."""
    text = kind == ".obj" or (kind == ".ply" and b"format ascii" in data[:1000]) or (kind == ".stl" and is_text(data))
    if not text:
        return None
    return int(np.count_nonzero(np.frombuffer(data, np.uint8) <= LAST_SPACE)) + data.count(b"/") * (kind == ".obj")


def _check(mesh: RawMesh, path: Path) -> None:
    wrong = ((mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        text = f"face row {row} uses vertices {mesh.faces[row].tolist()}, but there are {len(mesh.vertices)}"
        raise SceneError([f"{path}: {text}, counted from 0"])
    finite = np.isfinite(mesh.vertices).all(axis=1)
    if not finite.all():
        bad = np.intersect1d(np.flatnonzero(~finite), mesh.faces)  # unused vertices do not matter
        if len(bad):
            row = int(bad[0])
            raise SceneError([f"{path}: vertex row {row} is not finite: {mesh.vertices[row].tolist()}"])


def _check_kind(path: Path, data: bytes) -> None:
    """Refuse a file whose content does not fit its name."""
    if text := mistaken(data):
        raise FileError(f"{path}: {text}")
    kind = format_of(path)
    if kind != ".glb" and is_utf16(data) and not (kind == ".stl" and is_binary(data)):
        raise SceneError([f"{path}: {ENCODED}"])


def read_mesh(
    path: Path, allowance: Allowance | None = None, reach: Reach | None = None, wanted: Wanted = NOTHING
) -> RawMesh:
    """Return all triangles of a mesh file; its parts are transformed and joined.

    Parameters
    ----------
    path : pathlib.Path
        An OBJ, PLY, STL or GLB file, or one of another known format, plain or compressed with gzip.
    allowance : Allowance, optional
        Memory that it may use; by default the free memory.
    reach : Reach, optional
        Folders for other files that it names; by default its own folder.
    wanted : set of {"uv", "color"}, optional
        Attributes that are read too, where the file has them.

    Returns
    -------
    RawMesh
        At least one triangle, and warnings.

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
    allowance = allowance or Allowance()
    data, kind = read_bytes(path, allowance), format_of(path)
    _check_kind(path, data)
    attributes = frozenset({UV, COLOR}) if MATERIAL in wanted else wanted
    _afford(path, len(data), _words(data, kind), allowance, attributes)
    placed = PLACED + 2 * of_corners(attributes)
    most = min(MAX_TRIANGLES, allowance.left / placed)
    try:
        with np.errstate(all="ignore"):  # what is not finite is found below
            read = READERS.get(kind) or _other_reader(path, reach, allowance)
            parts = [part for part in read(data, most, wanted) if part is not None]
    except RaytraceError:
        raise
    except ObjError as error:
        raise SceneError([f"{path}:{error.line}: {error}"]) from None
    except MemoryError:  # less was free than it seemed
        raise FileMemoryError(f"memory: {path}: there is not enough to read it; split it or simplify it") from None
    except (TooLargeError, UnsupportedError) as error:
        raise _refusal(path, error, allowance, placed) from None
    except (ValueError, OverflowError, RecursionError) as error:
        reason = shortened(" ".join(str(error).split()) or type(error).__name__, MAX_REASON)
        raise SceneError([f"{path}: not a complete {kind[1:].upper()} file: {reason}"]) from error
    if not sum(len(part.faces) for part in parts):
        raise SceneError([f"{path}: no triangles in it"])
    for part in parts:
        _check(part, path)
    mesh = concatenate(parts) if len(parts) > 1 else parts[0]
    return mesh._replace(normals_fault=f"{path}{mesh.normals_fault}") if mesh.normals_fault else mesh
