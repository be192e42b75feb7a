"""Mesh files that need more than their own bytes: text glTF with its buffers, and the formats that trimesh reads.

trimesh is imported only here, when such a file is read. It receives the content of the file and cannot open others.
"""

import io
import os
import re
import stat
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from raytrace.errors import FileError, FileMemoryError, SceneError, printable, shortened
from raytrace.limits import MAX_MESH
from raytrace.memory import READING, READING_OTHER, Allowance
from raytrace.records import RawMesh
from raytrace.scene.attributes import Wanted
from raytrace.scene.files import Reach, format_of
from raytrace.scene.meshes.errors import TooLargeError, TooManyTrianglesError, UnsupportedError
from raytrace.scene.meshes.glb import read_gltf
from raytrace.scene.meshes.raw_mesh import transform
from raytrace.scene.meshes.visual import with_visual

Reader = Callable[[bytes, float, Wanted], list[RawMesh]]  # of a file's content, most triangles, wanted attributes
PACKAGES = {  # format -> packages that trimesh needs to read it
    ".3mf": "lxml networkx",
    ".dae": "lxml pycollada",
    ".zae": "lxml pycollada",
    ".xaml": "lxml",
    ".3dxml": "lxml networkx pillow",
    ".ctm": "openctm",
    ".stp": "cascadio",
    ".step": "cascadio",
}
DECLARATIONS = b"<!doctype", b"<!entity"  # of XML: entities can expand without limit, and name other files
XML, TEXTS = (".dae", ".xaml"), (".dae", ".xml", ".model", ".3drep", ".3dxml")  # files, and entries of archives
FANS = "its polygons of more than 3 corners became fans; concave ones are wrong: export triangles"
CURE = "split it or simplify it"


def other_reader(path: Path, reach: Reach | None, allowance: Allowance) -> Reader:
    """Return the reader of a file that is neither OBJ, PLY, STL nor GLB.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    reach : Reach or None
        Folders for the files that it names; None: its own folder.
    allowance : Allowance
        Memory that all of them may use.
    """
    kind, where = format_of(path), reach or Reach(path.parent)
    if kind == ".gltf":
        return lambda data, most, wanted: read_gltf(
            data, most, wanted, lambda uri: _buffer(path, uri, where, allowance)
        )
    return lambda data, most, wanted: _by_trimesh(path, data, most, allowance, wanted)


def _buffer(path: Path, uri: str, reach: Reach, allowance: Allowance) -> bytes:
    """Return the content of a file that a glTF file names."""
    from urllib.parse import unquote

    try:
        found = reach.beside(path, unquote(uri))
        with open(
            os.open(found, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)), "rb"
        ) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise FileError(f"{path}: {found}: no regular file")
            if status.st_size > MAX_MESH:
                raise FileError(f"{path}: {found}: more than {MAX_MESH} bytes; {CURE}")
            if lacks := allowance.lacks(READING[".glb"] * status.st_size, CURE):
                raise FileMemoryError(f"memory: {path}: {found}: {lacks}")
            allowance.left -= status.st_size
            return file.read(status.st_size)
    except FileError:
        raise
    except SceneError as error:
        raise SceneError([f"{path}: {error}"]) from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise FileError(
            f"{path}: {printable(shortened(uri, 200))}: can't be read: {getattr(error, 'strerror', error)}"
        ) from None


# ---- trimesh -------------------------------------------------------------------------------------------------------


def _by_trimesh(path: Path, data: bytes, most: float, allowance: Allowance, wanted: Wanted) -> list[RawMesh]:
    """Return the triangles of a file, placed by the scene of the file; without vertex normals."""
    kind = format_of(path)
    texts = _entries(path, data, allowance) if data[:2] == b"PK" else [data] if kind in XML else []
    for text in texts:
        _refuse_declarations(text)
    scene = _load(path, data, kind)
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    meshes = [(matrix, scene.geometry[name]) for matrix, name in placed if hasattr(scene.geometry[name], "faces")]
    triangles = sum(len(mesh.faces) for _, mesh in meshes)
    if triangles > most:
        raise TooManyTrianglesError(triangles, triangles)
    parts = []
    for matrix, mesh in meshes:
        vertices, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
        raw = RawMesh(vertices.reshape(-1, 3), faces.reshape(-1, 3), None, None)
        if wanted:
            raw = with_visual(raw, mesh, wanted)
        parts.append(transform(raw, np.asarray(matrix)[:3, :3], np.asarray(matrix)[:3, 3]))
    fans = any(map(_has_polygons, texts)) or (kind == ".off" and triangles > _off_faces(data))
    return [parts[0]._replace(warnings=(FANS,)), *parts[1:]] if parts and fans else parts


def _has_polygons(text: bytes) -> bool:
    """Return whether a COLLADA text has polygons of more than three corners."""
    counts = {word for match in re.finditer(rb"<vcount>([^<]*)</vcount>", text) for word in match[1].split()}
    return b"<polygons" in text or bool(counts - {b"3"})


def _off_faces(data: bytes) -> int:
    """Return the number of polygons that an OFF file states."""
    match = re.search(rb"OFF(?:\s|#[^\n]*\n)*\d+\s+(\d+)", data)
    return int(match[1]) if match else 0


def _load(path: Path, data: bytes, kind: str) -> Any:
    """Return the ``trimesh.Scene`` of a file."""
    import trimesh

    if kind == ".off" and not _is_utf8(data):  # trimesh would guess the encoding; only comments can need one
        data = data.decode("latin-1").encode()
    try:
        with warnings.catch_warnings(action="ignore"):
            return trimesh.load_scene(
                io.BytesIO(data), file_type=kind[1:], resolver=_Nothing(), process=False, allow_remote=False
            )
    except MemoryError:
        raise
    except ImportError as error:
        packages = PACKAGES.get(kind, error.name)
        text = f"to read {kind} files, trimesh needs further packages: pip install {packages} ({error})"
        raise FileError(f"{path}: {text}") from None
    except Exception as error:  # its readers check little, and raise any exception
        text = " ".join(str(error).split())
        raise ValueError(f"trimesh can't read it: {type(error).__name__}{text and ': '}{text}") from error


def _is_utf8(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True


class _Nothing(dict[str, bytes]):
    """Refuses all files that trimesh would open beside the one it reads; they could add only colours."""

    def get(self, key: str, default: Any = None) -> Any:
        """Refuse a file."""
        raise FileNotFoundError(f"{key}: no other file is opened")

    def namespaced(self, _name: str) -> "_Nothing":
        """Return the files below a folder."""
        return self


def _entries(path: Path, data: bytes, allowance: Allowance) -> list[bytes]:
    """Return the XML texts of a ZIP archive, which some formats are; refuse one that is too large when unpacked."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_MESH:
            raise TooLargeError(f"it unpacks to {size:,} bytes; at most {MAX_MESH:,}")
        if lacks := allowance.lacks(READING_OTHER * size, CURE):
            raise FileMemoryError(f"memory: {path}: {lacks}")
        return [archive.read(entry) for entry in archive.infolist() if entry.filename.lower().endswith(TEXTS)]
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise ValueError(f"a broken archive, or one with a password: {error}") from error


def _refuse_declarations(text: bytes) -> None:
    plain = text.replace(b"\0", b"").lower()  # UTF-16 too
    if any(word in plain for word in DECLARATIONS):
        raise UnsupportedError("XML with a document type or entities is not read; export it without")
