"""Normals of triangles and of their corners."""

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh

Vectors = NDArray[np.float64]


def normalise(rows: Vectors) -> Vectors:
    """Return unit rows; zeros where a row is zero or not finite. No length overflows or underflows.

    Examples
    --------
    >>> normalise(np.array([[3e300, 4e300, 0], [0, 0, 0]])).tolist()
    [[0.6, 0.8, 0.0], [0.0, 0.0, 0.0]]
    """
    largest = np.max(np.abs(rows), axis=1, keepdims=True, initial=0.0)
    good = np.isfinite(largest) & (largest > 0)
    scaled = np.divide(rows, largest, out=np.zeros_like(rows), where=good)
    length = np.sqrt((scaled**2).sum(axis=1, keepdims=True))
    return np.divide(scaled, length, out=np.zeros_like(rows), where=good)


def face_normals(mesh: RawMesh) -> Vectors:
    """Return the (m, 3) unit normals of the triangles; zeros where a triangle has no area.

    Examples
    --------
    >>> face_normals(RawMesh(np.eye(3), np.array([[0, 1, 1]]), None, None)).tolist()
    [[0.0, 0.0, 0.0]]
    """
    v0, v1, v2 = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    edges = np.stack([v1 - v0, v2 - v0])
    scale = np.max(np.abs(edges), axis=(0, 2))[:, None]  # of each triangle: areas of small ones don't underflow
    edges = np.divide(edges, scale, out=np.zeros_like(edges), where=scale > 0)
    return normalise(np.cross(edges[0], edges[1]))


def averaged_normals(mesh: RawMesh, ng: Vectors) -> Vectors:
    """Return for each corner the mean normal of the faces around its position, weighted by their angles there.

    Parameters
    ----------
    mesh : RawMesh
    ng : (m, 3) float64
        Unit normals of the triangles, zeros where they have no area.

    Returns
    -------
    (m, 3, 3) float64
        Unit normals; zeros where those of the faces cancel.

    References
    ----------
    [Thurmer1998] G. Thurmer, C. Wuthrich: Computing vertex normals from polygonal facets, JGT 3(1), 1998.
    """
    corners = mesh.vertices[mesh.faces]
    # angle at corner i between the edges to the next corner and to the previous one; atan2 is exact for slivers too
    to_next = normalise((np.roll(corners, -1, axis=1) - corners).reshape(-1, 3))
    to_last = normalise((np.roll(corners, 1, axis=1) - corners).reshape(-1, 3))
    sine = np.sqrt((np.cross(to_next, to_last) ** 2).sum(axis=1))
    weighted = np.arctan2(sine, (to_next * to_last).sum(axis=1))[:, None] * np.repeat(ng, 3, axis=0)
    points = mesh.vertices + 0.0  # -0 and 0 are one position
    order = np.lexsort(points.T)
    new = np.ones(len(points), np.int64)
    new[1:] = (points[order][1:] != points[order][:-1]).any(axis=1)
    position = np.empty(len(points), np.int64)  # vertices at the same place have the same number
    position[order] = np.cumsum(new) - 1
    ids = position[mesh.faces].ravel()
    sums = [np.bincount(ids, weighted[:, axis], len(points)) for axis in range(3)]
    return normalise(np.stack(sums, axis=1).astype(np.float64, copy=False))[ids].reshape(-1, 3, 3)


def shading_normals(mesh: RawMesh, smooth: bool, ng: Vectors) -> Vectors:
    """Return the (m, 3, 3) unit shading normals of the corners of an object.

    Parameters
    ----------
    mesh : RawMesh
        Its normals are unit rows, or zeros where they are of no use.
    smooth : bool
    ng : (m, 3) float64
        Unit normals of the triangles, zeros where they have no area.

    Notes
    -----
    Flat: the face normal. Smooth: the mesh's normal; an averaged one where the mesh has none; the face normal where the
    mesh's is zero. A triangle without area has no normal: (0, 0, 1) stands there, and no ray hits it.
    """
    flat = np.where(ng.any(axis=1, keepdims=True), ng, (0.0, 0.0, 1.0))[:, None, :]
    if not smooth:
        return np.repeat(flat, 3, axis=1)
    if mesh.normals is None or mesh.normal_faces is None:
        normals = averaged_normals(mesh, ng)
    else:
        normals = mesh.normals[mesh.normal_faces]
        if (none := mesh.normal_faces < 0).any():
            normals[none] = averaged_normals(mesh, ng)[none]
    return np.where(normals.any(axis=2, keepdims=True), normals, flat)
