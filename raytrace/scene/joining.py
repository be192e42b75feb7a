"""Joins the objects of a scene into one mesh."""

from typing import NamedTuple

import numpy as np

from raytrace.records import Mesh
from raytrace.scene.meshes.raw_mesh import join_corners
from raytrace.scene.normals import face_normals, shading_normals
from raytrace.scene.transforms import PlacedMesh


class MeshWarning(NamedTuple):
    """What is legal in the mesh of an object, but probably not meant."""

    object_id: int
    text: str


class JoinedMesh(NamedTuple):
    """The mesh of a scene, and its warnings."""

    mesh: Mesh  # its normals are None where no object is smooth
    warnings: list[MeshWarning]


def join(objects: list[PlacedMesh]) -> JoinedMesh:
    """Join the objects of a scene into one mesh.

    Parameters
    ----------
    objects : list of PlacedMesh
        At least one.

    Returns
    -------
    JoinedMesh
    """
    warnings = []
    any_smooth = any(placed.smooth for placed in objects)
    faces, normals, before = [], [], 0
    for i, placed in enumerate(objects):
        ng = face_normals(placed.mesh)
        degenerate = int(np.count_nonzero(~ng.any(axis=1)))
        if degenerate:
            text = f"{degenerate} of {len(ng)} triangles have no area; no ray will hit them"
            warnings.append(MeshWarning(i, text))
        if any_smooth:
            ns = shading_normals(placed.mesh, placed.smooth, ng)
            turned = int(np.count_nonzero((ns.sum(axis=1) * ng).sum(axis=1) < 0))
            if turned:
                text = f"the normals of {turned} of {len(ng)} triangles point to their back; reverse one of the two"
                warnings.append(MeshWarning(i, text))
            normals.append(ns)
        faces.append(placed.mesh.faces + before)
        before += len(placed.mesh.vertices)
    counts = [len(part) for part in faces]
    uv, colors = (join_corners([getattr(placed.mesh, key) for placed in objects], counts) for key in ("uv", "colors"))
    mesh = Mesh(
        vertices=np.concatenate([placed.mesh.vertices for placed in objects]),
        faces=np.ascontiguousarray(np.concatenate(faces)),
        normals=np.ascontiguousarray(np.concatenate(normals)) if any_smooth else None,
        material_id=np.repeat(np.array([placed.material_id for placed in objects], np.int32), counts),
        object_id=np.repeat(np.arange(len(objects), dtype=np.int32), counts),
        uv=uv,
        colors=colors,
    )
    return JoinedMesh(mesh, warnings)
