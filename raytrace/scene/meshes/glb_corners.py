"""Texture coordinates and colours of a part of a glTF file, for the corners of its triangles   [glTF, 3.7.2.1]."""

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
    attributes = record_in(primitive, "attributes")
    for name in ("TEXCOORD_0",) * (UV in wanted) + ("COLOR_0",) * (COLOR in wanted):
        if name in attributes and accessors.count(attributes[name]) != accessors.count(attributes["POSITION"]):
            counts = [accessors.count(attributes[key]) for key in ("POSITION", name)]
            raise ValueError(f"{counts[0]} vertices have {counts[1]} rows of {name}")
    if UV in wanted and "TEXCOORD_0" in attributes:
        uv = accessors.floats(attributes["TEXCOORD_0"], "VEC2", UV_KINDS, rows)
        uv[:, 1] = 1 - uv[:, 1]
        mesh = mesh._replace(uv=uv[mesh.faces])
    if COLOR in wanted and "COLOR_0" in attributes:
        index = attributes["COLOR_0"]
        shape = "VEC4" if accessors.shape(index) == "VEC4" else "VEC3"
        mesh = mesh._replace(colors=accessors.floats(index, shape, COLOR_KINDS, rows)[:, :3][mesh.faces])
    return mesh
