"""Triangles of mesh files: mapped affinely, turned round, and joined."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh
from raytrace.scene.rules import determinant_sign

Matrix = NDArray[np.float64]

FRONT, BACK = [0, 1, 2], [0, 2, 1]  # orders of the corners: as they are; turned round
CLEAR_SIGN = 1e-9  # determinants of matrices with entries up to 1 are off by less than 1e-14


def transform(mesh: RawMesh, linear: Matrix, offset: Matrix) -> RawMesh:
    """Return a mesh mapped affinely; a map that mirrors turns the triangles round, so that fronts stay outside.

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
    Sums are written out: the last bit of a matrix product would depend on the machine, and with it the scene's hash.
    """
    # cofactors = determinant * inverse transpose, also where there is no inverse; the scale would overflow
    scaled = linear / (np.max(np.abs(linear)) or 1.0)
    cofactors = np.cross(np.roll(scaled, -1, axis=0), np.roll(scaled, -2, axis=0))
    mirrors = _mirrors(scaled, float(scaled[0] @ cofactors[0]))
    normals, normal_faces = mesh.normals, mesh.normal_faces
    order = BACK if mirrors else FRONT
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found later
        if normals is not None and normal_faces is not None:
            normals = multiply(-cofactors if mirrors else cofactors, normals)
            normal_faces = normal_faces[:, order]
        vertices = multiply(linear, mesh.vertices) + offset
    mesh = mesh._replace(vertices=vertices, faces=mesh.faces[:, order], normals=normals, normal_faces=normal_faces)
    return _turn_corners(mesh) if mirrors else mesh


def _turn_corners(mesh: RawMesh) -> RawMesh:
    """Return a mesh with uv and colours of its corners in the order of triangles that were turned round."""
    uv, colors = mesh.uv, mesh.colors
    if uv is None and colors is None:
        return mesh
    return mesh._replace(uv=None if uv is None else uv[:, BACK], colors=None if colors is None else colors[:, BACK])


def multiply(matrix: Matrix, rows: Matrix) -> Matrix:
    """Return the products of a (3, 3) matrix with vectors that are the rows of an (n, 3) array, with sums written out.

    Examples
    --------
    >>> multiply(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([[2.0, 3, 4]])).tolist()
    [[-3.0, 2.0, 4.0]]
    """
    return rows[:, :1] * matrix[:, 0] + rows[:, 1:2] * matrix[:, 1] + rows[:, 2:] * matrix[:, 2]


def _mirrors(scaled: Matrix, determinant: float) -> bool:
    """Return whether a determinant is below 0: exactly, where rounding could decide."""
    if abs(determinant) > CLEAR_SIGN or not np.isfinite(scaled).all():
        return determinant < 0
    return determinant_sign(scaled.tolist()) < 0


def turned_round(mesh: RawMesh) -> RawMesh:
    """Return a mesh with front and back of all triangles swapped, and its normals reversed.

    Examples
    --------
    >>> turned_round(RawMesh(np.eye(3), np.array([[0, 1, 2]]), None, None)).faces.tolist()
    [[0, 2, 1]]
    """
    mesh = _turn_corners(mesh)
    if mesh.normals is None or mesh.normal_faces is None:
        return mesh._replace(faces=mesh.faces[:, BACK])
    normals = 0.0 - mesh.normals  # never -0
    return mesh._replace(faces=mesh.faces[:, BACK], normals=normals, normal_faces=mesh.normal_faces[:, BACK])


def quiet_unused(mesh: RawMesh) -> RawMesh:
    """Move vertices that no face uses to a used one, where they lie outside the bounds of the used ones.

    Otherwise they could decide whether a mesh can be rendered, and in which precision.

    Examples
    --------
    >>> mesh = RawMesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1e80, 0, 0]]), np.array([[1, 2, 0]]), None, None)
    >>> quiet_unused(mesh).vertices[3].tolist()
    [1.0, 0.0, 0.0]
    """
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces.ravel()] = True
    if used.all() or not len(mesh.faces):
        return mesh
    kept = mesh.vertices[used]
    low, high = kept.min(axis=0), kept.max(axis=0)
    far = ~used & ~((mesh.vertices >= low) & (mesh.vertices <= high)).all(axis=1)  # also NaN
    if not far.any():
        return mesh
    vertices = mesh.vertices.copy()
    vertices[far] = vertices[mesh.faces[0, 0]]
    return mesh._replace(vertices=vertices)


def concatenate(meshes: list[RawMesh]) -> RawMesh:
    """Return one mesh made of several; corners of those without normals refer to row -1.

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
    warnings = tuple(dict.fromkeys(text for mesh in meshes for text in mesh.warnings))
    joined = RawMesh(np.concatenate(vertices), np.concatenate(faces), None, None, warnings=warnings)
    if any(mesh.uv is not None or mesh.colors is not None for mesh in meshes):
        sizes = [len(mesh.faces) for mesh in meshes]
        uv, colors = (join_corners([getattr(mesh, key) for mesh in meshes], sizes) for key in ("uv", "colors"))
        joined = joined._replace(uv=uv, colors=colors)
    if not normals:
        return joined
    return joined._replace(normals=np.concatenate(normals), normal_faces=np.concatenate(normal_faces))


def join_corners(parts: Sequence[Matrix | None], sizes: Sequence[int]) -> Matrix | None:
    """Return values of corners of several meshes as one array; NaN for meshes without, None if all are.

    Parameters
    ----------
    parts : sequence of (m, 3, k) float64 or None
    sizes : sequence of int
        Triangles of each.

    Examples
    --------
    >>> join_corners([np.zeros((1, 3, 2)), None], [1, 2])[:, 0].tolist()
    [[0.0, 0.0], [nan, nan], [nan, nan]]
    """
    widths = [part.shape[2] for part in parts if part is not None]
    if not widths:
        return None
    joined, before = np.full((sum(sizes), 3, widths[0]), np.nan), 0
    for part, size in zip(parts, sizes, strict=True):
        if part is not None:
            joined[before : before + size] = part
        before += size
    return joined
