"""Texture coordinates and colours of a part of a glTF file, for the corners of its triangles   [glTF, 3.7.2.1]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.attributes import COLOR, UV, Wanted
from raytrace.scene.meshes.glb_accessors import BYTE, FLOAT, SHORT, UBYTE, USHORT, Accessors
from raytrace.scene.meshes.glb_json import Record, record_in

UV_KINDS = FLOAT, UBYTE, USHORT, BYTE, SHORT  # with KHR_mesh_quantization
COLOR_KINDS = FLOAT, UBYTE, USHORT


def with_attributes(
    mesh: RawMesh, primitive: Record, accessors: Accessors, rows: NDArray[np.int64] | None, wanted: Wanted
) -> RawMesh:
    """Return the mesh of a part with uv and colours, as far as they are wanted and the part has them.

    Parameters
    ----------
    mesh : RawMesh
        Its triangles may be turned round.
    primitive : dict
    accessors : Accessors
    rows : (n,) int64 or None
        Vertices of the primitive that the mesh has; None: all.
    wanted : set of {"uv", "color"}

    Notes
    -----
    In a glTF file v = 0 is the top row of an image; here it is the bottom row, so 1 - v is stored.
    Colours are linear in both; their alpha is left out.
    """
    if UV in wanted and (uv := uv_of(mesh, primitive, accessors, rows, "TEXCOORD_0")) is not None:
        uv[:, :, 1] = 1 - uv[:, :, 1]
        mesh = mesh._replace(uv=uv)
    if COLOR in wanted:
        mesh = mesh._replace(colors=colors_of(mesh, primitive, accessors, rows))
    return mesh


def uv_of(
    mesh: RawMesh, primitive: Record, accessors: Accessors, rows: NDArray[np.int64] | None, name: str
) -> NDArray[np.float64] | None:
    """Return the uv (m, 3, 2) of an attribute, v downwards as in the file; None if the part has none."""
    index = _attribute(primitive, accessors, name)
    return None if index is None else accessors.floats(index, "VEC2", UV_KINDS, rows)[mesh.faces]


def colors_of(
    mesh: RawMesh, primitive: Record, accessors: Accessors, rows: NDArray[np.int64] | None
) -> NDArray[np.float64] | None:
    """Return the colours (m, 3, 3); None if the part has none."""
    index = _attribute(primitive, accessors, "COLOR_0")
    if index is None:
        return None
    shape = "VEC4" if accessors.shape(index) == "VEC4" else "VEC3"
    return accessors.floats(index, shape, COLOR_KINDS, rows)[:, :3][mesh.faces]


def _attribute(primitive: Record, accessors: Accessors, name: str) -> Any:
    """Return the accessor of an attribute that has a row for each vertex; None if the part has none."""
    attributes = record_in(primitive, "attributes")
    if name not in attributes:
        return None
    counts = [accessors.count(attributes[key]) for key in ("POSITION", name)]
    if counts[0] != counts[1]:
        raise ValueError(f"{counts[0]} vertices have {counts[1]} rows of {name}")
    return attributes[name]
