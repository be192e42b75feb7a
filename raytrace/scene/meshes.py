"""Mesh files to arrays: OBJ and PLY by own readers; STL and GLB through trimesh, imported when one of them is met.

Of trimesh only the readers of the formats are used, not its ``Trimesh``: they return the file's own arrays, tell
whether normals stand in the file, and neither merge vertices nor look for textures.
"""

import gzip
import io
import json
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, SceneError
from raytrace.records import RawMesh
from raytrace.scene.files import MAX_BYTES, format_of, locate
from raytrace.scene.obj import ObjError, read_obj
from raytrace.scene.ply import read_ply

HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_punctual")  # GLB extensions: no shape in them

Matrix = NDArray[np.float64]


def transform(mesh: RawMesh, linear: Matrix, offset: Matrix) -> RawMesh:
    """Map a mesh affinely; a map that mirrors turns the triangles round, so that their front stays outside.

    Parameters
    ----------
    mesh : RawMesh
    linear : (3, 3) float64
        Applied to column vectors, before the offset.
    offset : (3,) float64

    Returns
    -------
    RawMesh
        Its normals are mapped by the inverse transpose, up to a positive factor.

    Notes
    -----
    Sums are written out: a matrix product's last bit would depend on the machine, and with it the scene's hash.
    """

    def product(matrix: Matrix, rows: Matrix) -> Matrix:
        return rows[:, :1] * matrix[:, 0] + rows[:, 1:2] * matrix[:, 1] + rows[:, 2:] * matrix[:, 2]

    # cofactors = determinant * inverse transpose, also where there is no inverse; the scale would overflow
    scaled = linear / (np.max(np.abs(linear)) or 1.0)
    cofactors = np.cross(np.roll(scaled, -1, axis=0), np.roll(scaled, -2, axis=0))
    mirrors = float(scaled[0] @ cofactors[0]) < 0
    order = [0, 2, 1] if mirrors else [0, 1, 2]
    normals, normal_faces = mesh.normals, mesh.normal_faces
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found later
        if normals is not None and normal_faces is not None:
            normals = product(-cofactors if mirrors else cofactors, normals)
            normal_faces = normal_faces[:, order]
        vertices = product(linear, mesh.vertices) + offset
    return RawMesh(vertices, mesh.faces[:, order], normals, normal_faces)


def concatenate(meshes: list[RawMesh]) -> RawMesh:
    """Make one mesh of several; corners of those without normals refer to row -1.

    Examples
    --------
    >>> triangle = RawMesh(np.eye(3), np.array([[0, 1, 2]]), None, None)
    >>> concatenate([triangle, triangle]).faces.tolist()
    [[0, 1, 2], [3, 4, 5]]
    """
    vertices, faces, normals, normal_faces = [], [], [], []
    before = before_normals = 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + before)
        before += len(mesh.vertices)
        if mesh.normals is None or mesh.normal_faces is None:
            normal_faces.append(np.full_like(mesh.faces, -1))
        else:
            normals.append(mesh.normals)
            normal_faces.append(np.where(mesh.normal_faces < 0, -1, mesh.normal_faces + before_normals))
            before_normals += len(mesh.normals)
    joined = RawMesh(np.concatenate(vertices), np.concatenate(faces), None, None)
    if not normals:
        return joined
    return joined._replace(normals=np.concatenate(normals), normal_faces=np.concatenate(normal_faces))


def _raw(geometry: dict[str, Any]) -> RawMesh | None:
    """Take what we need from what a reader of trimesh's returns; None where it holds no triangles."""
    if geometry.get("faces") is None or not len(geometry["faces"]):
        return None
    vertices = np.array(geometry["vertices"], np.float64)
    faces = np.array(geometry["faces"], np.int64)
    if faces.shape[1:] == (4,):  # quads, as trimesh returns them where a file has nothing else
        faces = faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    normals = geometry.get("vertex_normals")
    if normals is None or np.shape(normals) != vertices.shape:
        return RawMesh(vertices, faces, None, None)
    return RawMesh(vertices, faces, np.array(normals, np.float64), faces)


def _read_stl(data: bytes) -> list[RawMesh | None]:
    from trimesh.exchange.stl import load_stl

    loaded: dict[str, Any] = load_stl(io.BytesIO(data))
    return [_raw(part) for part in loaded.get("geometry", {"": loaded}).values()]


def _read_glb(data: bytes) -> list[RawMesh | None]:
    from trimesh.exchange.gltf import load_glb

    length = int.from_bytes(data[8:12], "little")
    if len(data) < max(length, 20):
        raise ValueError(f"the header announces {length} bytes, the file has {len(data)}")
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    unknown = [name for name in header.get("extensionsRequired", []) if not name.startswith(HARMLESS)]
    if unknown:
        raise ValueError(f"it needs extensions that are not supported: {', '.join(unknown)}; export it without them")
    scene = load_glb(io.BytesIO(data), skip_materials=True)
    parents: dict[str, dict[str, Any]] = {}
    for edge in scene["graph"]:  # in the order of discovery, from the root: the first edge of a node is its parent's
        parents.setdefault(edge["frame_to"], edge)
    meshes = []
    for edge in scene["graph"]:
        mesh = _raw(scene["geometry"][edge["geometry"]]) if "geometry" in edge else None
        matrix = np.eye(4)
        node: dict[str, Any] | None = edge
        while node is not None:
            matrix = node["matrix"] @ matrix
            node = parents.get(node["frame_from"])
        meshes.append(mesh and transform(mesh, matrix[:3, :3], matrix[:3, 3]))
    return meshes


READERS: dict[str, Callable[[bytes], list[RawMesh | None]]] = {
    ".obj": lambda data: [read_obj(data)],
    ".ply": lambda data: [read_ply(data)],
    ".stl": _read_stl,
    ".glb": _read_glb,
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
        with warnings.catch_warnings():  # trimesh's are not for people who render
            warnings.simplefilter("ignore")
            # NumPy's word for text that is no number; without this what stands before it would be taken for all
            warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
            parts = [part for part in READERS[kind](data) if part is not None]
    except ObjError as error:
        raise SceneError([f"{path}:{error.line}: {error}"]) from None
    except Exception as error:  # a reader of trimesh's raises whatever its parsing runs into
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SceneError([f"{path}: no complete {kind[1:].upper()} file: {reason}"]) from error
    if not sum(len(part.faces) for part in parts):
        raise SceneError([f"{path}: no triangles in it"])
    for part in parts:
        _check(part, path)
    return concatenate(parts) if len(parts) > 1 else parts[0]
