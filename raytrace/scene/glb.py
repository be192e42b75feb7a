"""Binary glTF files to arrays   [glTF].

An own reader, because a file may announce what it does not hold: each count is compared with the bytes that are there
before anything is made of it, nodes must be a tree, and no other file is read. Materials, textures, skins, animations,
lines and points are passed over.
"""

import base64
import binascii
import json
from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.limits import MAX_TRIANGLES
from raytrace.records import RawMesh
from raytrace.scene.rawmesh import Matrix, transform

HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_punctual")  # extensions: no shape in them
MAGIC, JSON, BIN = b"glTF", b"JSON", b"BIN\0"
MAX_JSON = 2**24  # bytes of the JSON chunk: it takes 30 times as much memory
MAX_PARTS = 2**16  # of meshes, each as often as nodes place it: a few seconds
TRIANGLES, STRIP, FAN = 4, 5, 6
INDEX = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
FLOAT = {5126: "<f4"}

Record = dict[str, Any]


class Instance(NamedTuple):
    """A part of a mesh where a node puts it."""

    primitive: Record
    matrix: Matrix  # (4, 4), applied to columns


def read_glb(data: bytes, most: float = MAX_TRIANGLES) -> list[RawMesh]:
    """Read the triangles of all nodes of the scene of a GLB file, each where its transforms put it.

    Parameters
    ----------
    data : bytes
        The file's content.
    most : float
        Triangles that it may have: nodes may place a mesh any number of times.

    Raises
    ------
    ValueError
        What is wrong with it.

    Examples
    --------
    >>> read_glb(b"glTF")
    Traceback (most recent call last):
    ValueError: the header announces 0 bytes, the file has 4
    """
    document, chunk = _chunks(data)
    unknown = [name for name in _list(document, "extensionsRequired") if not str(name).startswith(HARMLESS)]
    if unknown:
        names = ", ".join(map(str, unknown[:5]))
        raise ValueError(f"it needs extensions that are not supported: {names}; export it without them")
    file, parts, count = _File(document, chunk), list[RawMesh](), 0
    instances = list(islice(_instances(document), MAX_PARTS + 1))
    if len(instances) > MAX_PARTS:
        raise ValueError(f"its nodes place more than {MAX_PARTS} parts of meshes; join some")
    for primitive, matrix in instances:
        if (mesh := file.mesh(primitive)) is not None:
            count += len(mesh.faces)
            if count > most:
                raise ValueError(f"its nodes place more than {int(most):,} triangles, too many for limits or memory")
            parts.append(transform(mesh, matrix[:3, :3], matrix[:3, 3]))
    return parts


def _chunks(data: bytes) -> tuple[Record, memoryview]:
    """The JSON, and the bytes of the first buffer (none: empty)."""
    length = int.from_bytes(data[8:12], "little")
    if len(data) < max(length, 20):
        raise ValueError(f"the header announces {length} bytes, the file has {len(data)}")
    if data[:4] != MAGIC or data[4:8] != b"\2\0\0\0":
        raise ValueError("the file does not begin as glTF 2.0 does")
    chunks, at = dict[bytes, memoryview](), 12
    while at + 8 <= length:
        end = at + 8 + int.from_bytes(data[at : at + 4], "little")
        if end > length:
            raise ValueError("a chunk is longer than the file")
        chunks.setdefault(data[at + 4 : at + 8], memoryview(data)[at + 8 : end])
        at = end
    text = chunks.get(JSON, memoryview(b""))
    if len(text) > MAX_JSON:
        raise ValueError(f"its JSON has more than {MAX_JSON} bytes")
    document = json.loads(bytes(text))
    if not isinstance(document, dict):
        raise ValueError("its JSON is no object")
    return document, chunks.get(BIN, memoryview(b""))


# ---- the JSON, of which nothing is believed ------------------------------------------------------------------------


def _list(record: Record, key: str) -> list[Any]:
    value = record.get(key, [])
    if not isinstance(value, list):
        raise ValueError(f"{key}: expected a list")
    return value


def _item(document: Record, name: str, index: Any) -> Record:
    items = _list(document, name)
    if type(index) is not int or not 0 <= index < len(items):
        raise ValueError(f"{name}[{str(index)[:40]}] does not exist")
    if not isinstance(items[index], dict):
        raise ValueError(f"{name}[{index}]: expected an object")
    return items[index]


def _whole(record: Record, key: str, default: int | None = None) -> int:
    value = record.get(key, default)
    if type(value) is not int or not 0 <= value < 2**53:
        raise ValueError(f"{key}: expected a whole number, got {str(value)[:40]}")
    return value


def _numbers(record: Record, key: str, default: list[float]) -> Matrix:
    value = record.get(key, default)
    if not isinstance(value, list) or len(value) != len(default) or not all(type(x) in (int, float) for x in value):
        raise ValueError(f"{key}: expected {len(default)} numbers")
    return np.array(value, np.float64)


# ---- nodes ---------------------------------------------------------------------------------------------------------


def _matrix(node: Record) -> Matrix:
    """Transform of a node: its matrix, column after column, or translation, rotation and scale."""
    if "matrix" in node:
        return _numbers(node, "matrix", [0.0] * 16).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = _numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0])
    square = x * x + y * y + z * z + w * w
    if not 0 < square < np.inf:
        raise ValueError("rotation: expected a quaternion other than 0")
    s = 2.0 / square
    rotation = [
        [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
        [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
        [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
    ]
    matrix[:3, :3] = np.array(rotation) * _numbers(node, "scale", [1.0, 1.0, 1.0])
    matrix[:3, 3] = _numbers(node, "translation", [0.0, 0.0, 0.0])
    return matrix


def _placed(above: Matrix, node: Record) -> Matrix:
    """Product of the transforms of what is above a node, and its own; written out, as in ``transform``."""
    if not node.keys() & {"matrix", "rotation", "scale", "translation"}:
        return above
    m = _matrix(node)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found later
        return above[:, :1] * m[0] + above[:, 1:2] * m[1] + above[:, 2:3] * m[2] + above[:, 3:] * m[3]


def _instances(document: Record) -> Iterator[Instance]:
    """Parts of meshes of all nodes of the scene."""
    scene = _item(document, "scenes", document.get("scene", 0)) if document.get("scenes") else {}
    waiting = [(node, np.eye(4)) for node in _list(scene, "nodes")]
    met = set()
    while waiting:
        index, above = waiting.pop()
        node = _item(document, "nodes", index)
        if index in met:
            raise ValueError(f"nodes[{index}] stands in the scene twice; nodes must be a tree")
        met.add(index)
        matrix = _placed(above, node)
        if "mesh" in node:
            for primitive in _list(_item(document, "meshes", node["mesh"]), "primitives"):
                yield Instance(primitive, matrix)
        waiting += [(child, matrix) for child in _list(node, "children")]


# ---- numbers -------------------------------------------------------------------------------------------------------


class _File:
    """The buffers of a file, and what accessors make of them."""

    def __init__(self, document: Record, chunk: memoryview) -> None:
        self._document, self._chunk = document, chunk
        self._decoded: dict[int, memoryview] = {}

    def mesh(self, primitive: Any) -> RawMesh | None:
        """Triangles of a part of a mesh; None for lines and points."""
        if not isinstance(primitive, dict):
            raise ValueError("primitives: expected objects")
        mode, attributes = primitive.get("mode", TRIANGLES), primitive.get("attributes")
        if mode not in (TRIANGLES, STRIP, FAN):
            return None
        if not isinstance(attributes, dict) or "POSITION" not in attributes:
            raise ValueError("a primitive has no POSITION")
        vertices = self._rows(attributes["POSITION"], FLOAT, 3).astype(np.float64)
        if "indices" in primitive:
            corners = self._rows(primitive["indices"], INDEX, 1)[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(vertices))
        faces = _faces(mode, corners)
        if not len(faces):
            return None
        if "NORMAL" not in attributes:
            return RawMesh(vertices, faces, None, None)
        normals = self._rows(attributes["NORMAL"], FLOAT, 3).astype(np.float64)
        if len(normals) != len(vertices):
            raise ValueError(f"{len(vertices)} vertices have {len(normals)} normals")
        return RawMesh(vertices, faces, normals, faces)

    def _rows(self, index: Any, kinds: dict[int, str], width: int) -> NDArray[Any]:
        """Numbers of an accessor, (n, width), seen in the buffer."""
        accessor, name = _item(self._document, "accessors", index), f"accessors[{index}]"
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"{name} is sparse, which is not supported; export it without")
        kind = accessor.get("componentType")
        if type(kind) is not int or kind not in kinds or accessor.get("type") != ("SCALAR" if width == 1 else "VEC3"):
            raise ValueError(f"{name} does not hold what it is used for")
        view = _item(self._document, "bufferViews", accessor["bufferView"])
        data = self._bytes(view)
        dtype, count, offset = np.dtype(kinds[kind]), _whole(accessor, "count"), _whole(accessor, "byteOffset", 0)
        row = width * dtype.itemsize
        stride = _whole(view, "byteStride", row)
        if stride < row:
            raise ValueError(f"{name} has rows of {row} bytes every {stride} bytes")
        if count and offset + (count - 1) * stride + row > len(data):
            raise ValueError(f"{name} announces {count} rows of {row} bytes, its view has {len(data)} bytes")
        return np.ndarray((count, width), dtype, data, offset if count else 0, (stride, dtype.itemsize))

    def _bytes(self, view: Record) -> memoryview:
        index = view.get("buffer", -1)
        buffer = self._buffer(index, _item(self._document, "buffers", index))
        offset, length = _whole(view, "byteOffset", 0), _whole(view, "byteLength")
        if offset + length > len(buffer):
            raise ValueError(f"a view of {length} bytes from {offset} on leaves its buffer of {len(buffer)} bytes")
        return buffer[offset : offset + length]

    def _buffer(self, index: int, buffer: Record) -> memoryview:
        uri = buffer.get("uri")
        if uri is None:
            return self._chunk if index == 0 else memoryview(b"")
        if not str(uri).startswith("data:"):
            text = "nothing else is opened or fetched; export one file"
            raise ValueError(f"a buffer in another file, {str(uri)[:200]}; {text}")
        if index not in self._decoded:
            try:
                self._decoded[index] = memoryview(base64.b64decode(str(uri).partition(";base64,")[2], validate=True))
            except (binascii.Error, ValueError):
                raise ValueError(f"buffers[{index}]: its data is no base64") from None
        return self._decoded[index]


def _faces(mode: int, corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (m, 3) of a list, a strip or a fan of corners   [glTF, 3.7.2.1]."""
    if mode == TRIANGLES:
        if len(corners) % 3:
            raise ValueError(f"{len(corners)} corners are no triangles")
        return corners.reshape(-1, 3)
    if len(corners) < 3:
        return corners[:0].reshape(-1, 3)
    if mode == FAN:
        return np.stack([corners[1:-1], corners[2:], np.full(len(corners) - 2, corners[0])], axis=1)
    faces = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    faces[1::2, 1:] = faces[1::2, :0:-1]
    return faces
