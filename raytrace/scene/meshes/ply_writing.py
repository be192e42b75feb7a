"""Writes a mesh as a PLY file of float64, which reading gives back bit for bit."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.records import RawMesh
from raytrace.scene.meshes.ply_corners import WEDGES

MAX_ROW = 2**31 - 1  # of a vertex, in a face


def ply_bytes(mesh: RawMesh) -> bytes:
    """Return a mesh as a binary, little-endian PLY file, with its uv and colours.

    Parameters
    ----------
    mesh : RawMesh
        Without normals of its own.

    Raises
    ------
    SceneError
        The corners of a vertex have different colours, which a PLY file cannot express.

    Examples
    --------
    >>> from raytrace.scene.meshes.given import read_given
    >>> ply_bytes(read_given(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])))[:3]
    b'ply'
    """
    count, columns, names = len(mesh.vertices), [mesh.vertices], ["x", "y", "z"]
    if mesh.colors is not None:
        columns.append(_by_vertex(mesh, mesh.colors))
        names += ["red", "green", "blue"]
    if count > MAX_ROW:
        raise SceneError([f"a mesh of {count:,} vertices; a PLY file has at most {MAX_ROW:,}"])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property double {name}" for name in names]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    fields: list[Any] = [("corners", "u1"), ("rows", "<i4", 3)]
    if mesh.uv is not None:
        header.append(f"property list uchar double {WEDGES}")
        fields += [("numbers", "u1"), ("uv", "<f8", 6)]
    faces = np.zeros(len(mesh.faces), np.dtype(fields))
    faces["corners"], faces["rows"] = 3, mesh.faces
    if mesh.uv is not None:
        faces["numbers"], faces["uv"] = 6, mesh.uv.reshape(-1, 6)
    vertices = np.concatenate(columns, axis=1).astype("<f8")
    return ("\n".join([*header, "end_header"]) + "\n").encode("ascii") + vertices.tobytes() + faces.tobytes()


def _by_vertex(mesh: RawMesh, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of vertices, which all corners of a vertex must share."""
    values = np.zeros((len(mesh.vertices), corners.shape[-1]))
    values[mesh.faces] = corners
    if not np.array_equal(values[mesh.faces], corners, equal_nan=True):
        raise SceneError(["a mesh in memory whose faces have colours can't be written; give colours to its vertices"])
    return values
