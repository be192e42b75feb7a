"""The objects of a scene as binary PLY files: positions, normals, texture coordinates, vertex colours.

Both Mitsuba 3 and pbrt-v4 read the names that the properties have here. Vertices are in world space, counter-clockwise
seen from the front, rounded to float32.
"""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import DIFFUSE, Mesh, Scene

FLAT = 1e-9  # largest difference of a corner's normal from the triangle's where an object is flat
PROPERTIES = {"vertices": "xyz", "normals": ("nx", "ny", "nz"), "uv": "uv", "colors": "rgb"}


class Part(NamedTuple):
    """The triangles of one object that have one material."""

    name: str  # of its file, without the suffix
    material: int  # row of the materials
    object_id: int
    vertices: NDArray[np.float32]  # (v, 3) f4, world units
    faces: NDArray[np.int32]  # (m, 3) i4: rows of vertices
    normals: NDArray[np.float32] | None  # (v, 3) f4: unit shading normals; None: flat
    uv: NDArray[np.float32] | None  # (v, 2) f4; None: the object has none, or no material needs them
    colors: NDArray[np.float32] | None  # (v, 3) f4: linear RGB; None as for uv


def parts_of(scene: Scene) -> Iterator[Part]:
    """Yield the parts of a scene, object by object.

    Lamps that reflect nothing have no normals: emission depends on the geometric normal only.
    """
    mesh = scene.mesh
    pairs = mesh.object_id.astype(np.int64) * len(scene.materials.name) + mesh.material_id
    for pair in np.flatnonzero(np.bincount(pairs)):
        number, material = divmod(int(pair), len(scene.materials.name))
        stem = scene.objects[number].rsplit("/", 1)[-1]
        words = [f"{number:03d}", stem.split(".", 1)[0], scene.materials.name[material]]
        part = _part(mesh, pairs == pair, file_stem("-".join(words)), (material, number))
        yield part._replace(normals=None) if reflects_nothing(scene, material) else part


def reflects_nothing(scene: Scene, material: int) -> bool:
    """Whether a material is black on both sides, whether it emits or not."""
    textured = scene.textures is not None and scene.textures.reflectance[material] >= 0
    table = scene.materials
    return bool(table.kind[material] == DIFFUSE and not table.albedo[material].any() and not textured)


def bend(part: Part) -> float:
    """Angle between the normals of corners and of triangles, degrees: the root of its mean square over the area."""
    if part.normals is None:
        return 0.0
    corners, normals = (each.astype(np.float64)[part.faces] for each in (part.vertices, part.normals))
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1)
    cosines = np.einsum("ijk,ik->ij", normals, across / np.where(length > 0, length, 1.0)[:, None])
    squares = (np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))) ** 2).mean(axis=1)
    return float(np.sqrt((squares * length).sum() / length.sum()))


def file_stem(text: str) -> str:
    """Return a text with everything replaced that may be special in a file name.

    >>> file_stem("003-my vase (2)-glass")
    '003-my-vase-2-glass'
    """
    return re.sub(r"[^A-Za-z0-9_]+", "-", text).strip("-") or "unnamed"


def _part(mesh: Mesh, mine: NDArray[np.bool_], name: str, owner: tuple[int, int]) -> Part:
    """Gather the corners of some triangles, and merge equal ones into vertices."""
    corners = mesh.vertices[mesh.faces[mine]]
    columns: dict[str, NDArray[Any]] = {"vertices": corners}
    if mesh.normals is not None and not _flat(corners, mesh.normals[mine]):
        columns["normals"] = mesh.normals[mine]
    for key in ("uv", "colors"):
        values = getattr(mesh, key)
        if values is not None and not np.isnan(values[mine]).any():
            columns[key] = values[mine]
    rows = np.concatenate([array.reshape(3 * len(corners), -1) for array in columns.values()], axis=1)
    rows = np.asarray(rows, np.float32)
    first, inverse = equal_rows(rows)
    order = np.argsort(first)  # vertices in the order of the faces
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order), dtype=np.int32)
    ends = np.cumsum([array.shape[-1] for array in columns.values()])[:-1]
    split = dict(zip(columns, np.split(rows[first[order]], ends, axis=1), strict=True))
    faces = place[inverse.reshape(-1, 3)]
    return Part(name, *owner, split["vertices"], faces, *(split.get(key) for key in ("normals", "uv", "colors")))


def equal_rows(rows: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return one row of each group of equal ones, and for each row the number of its group.

    >>> equal_rows(np.array([[0, 1], [2, 3], [-0.0, 1]], np.float32))[1].tolist()
    [0, 1, 0]
    """
    rows = np.ascontiguousarray(rows + np.float32(0))  # -0 becomes 0, so that equal rows have equal bytes
    keys = rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return first, inverse


def _flat(corners: NDArray[np.float64], normals: NDArray[np.float64]) -> bool:
    """Whether the normals of all corners are those of the triangles."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    ng = np.divide(across, length, out=np.zeros_like(across), where=length > 0)
    return bool((np.abs(normals - ng[:, None]).max(axis=(1, 2)) <= FLAT)[length[:, 0] > 0].all())


def ply_bytes(part: Part) -> bytes:
    """Return a part as a binary, little-endian PLY file."""
    arrays = {key: getattr(part, key) for key in PROPERTIES if getattr(part, key) is not None}
    names = [name for key in arrays for name in PROPERTIES[key]]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(part.vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(part.faces)}", "property list uchar int vertex_indices", "end_header"]
    faces = np.empty(len(part.faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, part.faces
    vertices = np.concatenate(list(arrays.values()), axis=1).astype("<f4")
    return ("\n".join(header) + "\n").encode("ascii") + vertices.tobytes() + faces.tobytes()
