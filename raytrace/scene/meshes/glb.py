"""glTF files to arrays, binary (GLB) and as text   [glTF].

This is our own reader, because the sizes that a file states may be wrong: each count is compared with the bytes that
exist before memory is allocated, nodes must be a tree, and only ``other`` reads other files. Nodes, instances, morph
targets and skins are applied. Materials, animations, lines and points are skipped; texture coordinates and colours are
read where a scene needs them.
"""

import json
from collections.abc import Callable
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from raytrace.limits import MAX_TRIANGLES
from raytrace.records import RawMesh
from raytrace.scene.attributes import MATERIAL, NOTHING, Wanted
from raytrace.scene.meshes.errors import TooLargeError, TooManyTrianglesError, UnsupportedError
from raytrace.scene.meshes.glb_accessors import BYTE, FLOAT, INDEX, SHORT, UBYTE, USHORT, Accessors
from raytrace.scene.meshes.glb_deform import Skins, distinct, morph
from raytrace.scene.meshes.glb_extensions import DRACO, check_extensions
from raytrace.scene.meshes.glb_json import Record, extension, record_in
from raytrace.scene.meshes.glb_nodes import MAX_PARTS, Part, parts
from raytrace.scene.meshes.raw_mesh import transform

Rows = NDArray[np.int64] | None

MAGIC, JSON, BIN = b"glTF", b"JSON", b"BIN\0"
MAX_JSON = 2**24  # bytes of the JSON chunk: it takes 30 times as much memory
TRIANGLES, STRIP, FAN = 4, 5, 6
SPARE = 64  # vertices that a part may leave unused; more are dropped
POSITIONS, NORMALS = (FLOAT, BYTE, UBYTE, SHORT, USHORT), (FLOAT, BYTE, SHORT)  # with KHR_mesh_quantization


def read_glb(data: bytes, most: float = MAX_TRIANGLES, wanted: Wanted = NOTHING) -> list[RawMesh]:
    """Return the triangles of all nodes of the scene of a GLB file, with the transforms of the nodes applied.

    Parameters
    ----------
    data : bytes
        The file's content.
    most : float
        The most triangles allowed: nodes may place a mesh any number of times.
    wanted : set of {"uv", "color"}, or {"material"}
        Attributes that are read too, where the file has them; or its materials, and what these need.

    Returns
    -------
    list of RawMesh
        The first has the warnings.

    Raises
    ------
    ValueError
        What is wrong with it.

    Examples
    --------
    >>> read_glb(b"glTF")
    Traceback (most recent call last):
    ValueError: the header states 0 bytes, the file has 4
    """
    document, chunk = _chunks(data)
    return _read(document, Accessors(document, chunk), most, wanted)


def read_gltf(data: bytes, most: float, other: Callable[[str], bytes], wanted: Wanted = NOTHING) -> list[RawMesh]:
    """Read a text glTF file as ``read_glb`` does; ``other`` reads the files that the URIs of its buffers name."""
    document = _document(data)
    return _read(document, Accessors(document, memoryview(b""), other), most, wanted)


def read_json(data: bytes) -> Record:
    """Return the JSON of a glTF file, binary or text; a ValueError says what is wrong with it."""
    return _chunks(data)[0] if data[:4] == MAGIC else _document(data)


def _chunks(data: bytes) -> tuple[Record, memoryview]:
    """Return the JSON, and the bytes of the first buffer (empty if there is none)."""
    length = int.from_bytes(data[8:12], "little")
    if len(data) < max(length, 20):
        raise ValueError(f"the header states {length} bytes, the file has {len(data)}")
    if data[:4] != MAGIC or data[4:8] != b"\2\0\0\0":
        raise ValueError("the file does not begin with the header of glTF 2.0")
    chunks, at = dict[bytes, memoryview](), 12
    while at + 8 <= length:
        end = at + 8 + int.from_bytes(data[at : at + 4], "little")
        if end > length:
            raise ValueError("a chunk is longer than the file")
        chunks.setdefault(data[at + 4 : at + 8], memoryview(data)[at + 8 : end])
        at = end
    text = chunks.get(JSON, memoryview(b""))
    if len(text) > MAX_JSON:
        raise TooLargeError(f"its JSON has more than {MAX_JSON} bytes")
    return _document(bytes(text).rstrip(b"\0 ")), chunks.get(BIN, memoryview(b""))  # some writers pad with zero bytes


def _document(text: bytes) -> Record:
    document = json.loads(text)
    if not isinstance(document, dict):
        raise ValueError("its JSON is not an object")
    return document


def _read(document: Record, accessors: Accessors, most: float, wanted: Wanted) -> list[RawMesh]:
    """Return the triangles of all parts; they are counted before any array is made."""
    notes = dict.fromkeys(check_extensions(document))
    placed = list(islice(parts(document, accessors, notes), MAX_PARTS + 1))
    if len(placed) > MAX_PARTS:
        raise TooLargeError(f"its nodes place more than {MAX_PARTS} parts of meshes; join some")
    sizes = {id(part.primitive): _size(part.primitive, accessors) for part in placed}
    drawn = [part for part in placed if sizes[id(part.primitive)][0]]
    counts = [sizes[id(part.primitive)] for part in drawn]
    load = sum(max(triangles, vertices / 2) for triangles, vertices in counts)
    if load > most:
        raise TooManyTrianglesError(sum(triangles for triangles, _ in counts), load)
    skins = Skins(document, accessors, notes)
    more = _more(document, accessors, wanted)
    meshes = [more(_mesh(part, accessors, skins, notes), part.primitive) for part in drawn]
    if meshes and notes:
        meshes[0] = meshes[0]._replace(warnings=tuple(notes))
    return meshes


def _more(document: Record, accessors: Accessors, wanted: Wanted) -> Callable[[tuple[RawMesh, Rows], Record], RawMesh]:
    """Return what adds the wanted attributes to the mesh of a primitive."""
    if MATERIAL in wanted:
        from raytrace.scene.meshes.glb_materials import FileMaterials

        materials = FileMaterials(document, accessors)
        return lambda made, primitive: materials.apply(made[0], primitive, made[1])
    if wanted:
        from raytrace.scene.meshes.glb_corners import with_attributes

        return lambda made, primitive: with_attributes(made[0], primitive, accessors, made[1], wanted)
    return lambda made, _: made[0]


def _size(primitive: Record, accessors: Accessors) -> tuple[int, int]:
    """Return the triangles of a part and the most vertices they use; 0 for lines, points, and without positions."""
    mode, attributes = primitive.get("mode", TRIANGLES), record_in(primitive, "attributes")
    if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in attributes:
        return 0, 0
    vertices = accessors.count(attributes["POSITION"])
    corners = accessors.count(primitive["indices"]) if "indices" in primitive else vertices
    if mode == TRIANGLES and corners % 3:
        raise ValueError(f"{corners} corners do not make triangles")
    triangles = corners // 3 if mode == TRIANGLES else max(corners - 2, 0)
    return triangles, min(vertices, 3 * triangles + SPARE)


def _mesh(part: Part, accessors: Accessors, skins: Skins, notes: dict[str, None]) -> tuple[RawMesh, Rows]:
    """Return the triangles of a part, posed and transformed, and its vertices, if they are not all of the primitive."""
    primitive, attributes = part.primitive, record_in(part.primitive, "attributes")
    _refuse_draco(primitive, attributes, accessors)
    count = accessors.count(attributes["POSITION"])
    if "indices" in primitive:
        corners = accessors.rows(primitive["indices"], "SCALAR", INDEX)[:, 0].astype(np.int64)
    else:
        corners = np.arange(count)
    faces, rows = _faces(primitive.get("mode", TRIANGLES), corners), None
    if (last := int(faces.max())) >= count:
        raise ValueError(f"a triangle has vertex {last}, but there are {count}, counted from 0")
    if count > 3 * len(faces) + SPARE:  # the other vertices belong to other parts
        rows = distinct(faces)
        faces = np.searchsorted(rows, faces)
    vertices = accessors.floats(attributes["POSITION"], "VEC3", POSITIONS, rows)
    vertices = morph(vertices, "POSITION", primitive, part.weights, accessors, rows)
    mesh = RawMesh(vertices, faces, None, None)
    if "NORMAL" in attributes:
        if accessors.count(attributes["NORMAL"]) != count:
            raise ValueError(f"{count} vertices have {accessors.count(attributes['NORMAL'])} normals")
        normals = accessors.floats(attributes["NORMAL"], "VEC3", NORMALS, rows)
        normals = morph(normals, "NORMAL", primitive, part.weights, accessors, rows)
        mesh = mesh._replace(normals=normals, normal_faces=faces)
    if part.skin is not None and attributes.keys() >= {"JOINTS_0", "WEIGHTS_0"}:
        mesh = skins.apply(mesh, attributes, part.skin, rows)
    else:
        if part.skin is not None:
            notes["a mesh with a skin has no joints and weights; the transform of its node is used"] = None
        mesh = transform(mesh, part.matrix[:3, :3], part.matrix[:3, 3])
    return mesh, rows


def _refuse_draco(primitive: Record, attributes: Record, accessors: Accessors) -> None:
    """Refuse a part whose numbers exist only in compressed form."""
    indices = [primitive["indices"]] if "indices" in primitive else []
    plain = all(accessors.has_data(index) for index in [attributes["POSITION"], *indices])
    if extension(primitive, DRACO) is not None and not plain:
        raise UnsupportedError(f"a mesh is compressed by {DRACO}, which is not supported; export it without")


def _faces(mode: int, corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles (m, 3) of a list, a strip or a fan of corners   [glTF, 3.7.2.1]."""
    if mode == TRIANGLES:
        return corners.reshape(-1, 3)
    if mode == FAN:
        return np.stack([corners[1:-1], corners[2:], np.full(len(corners) - 2, corners[0])], axis=1)
    faces = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    faces[1::2, 1:] = faces[1::2, :0:-1]
    return faces
