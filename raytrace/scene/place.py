"""Meshes put where a scene wants them: one array of world-space triangles, with shading normals where asked for."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.records import Mesh, RawMesh
from raytrace.scene.meshes.raw_mesh import quiet_unused, transform

Vectors = NDArray[np.float64]

MAX_COORDINATE = 1e75  # world units; squared areas, of the fourth power, stay below the largest float64, 1.8e308
QUARTER_TURNS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # cosine and sine, where libm's are off by 6e-17


class Placed(NamedTuple):
    """One object's triangles in world space."""

    mesh: RawMesh  # its file normals are unit here, and rows of zeros where the file's are of no use
    smooth: bool  # whether the shading normals are those of the vertices
    material_id: int  # row of Materials


def _normalise(rows: Vectors) -> Vectors:
    """Return unit rows, zeros where a row is zero or not finite; no length overflows or underflows."""
    largest = np.max(np.abs(rows), axis=1, keepdims=True, initial=0.0)
    good = np.isfinite(largest) & (largest > 0)
    scaled = np.divide(rows, largest, out=np.zeros_like(rows), where=good)
    length = np.sqrt((scaled**2).sum(axis=1, keepdims=True))
    return np.divide(scaled, length, out=np.zeros_like(rows), where=good)


def rotation(axis: Sequence[float], angle: float) -> Vectors:
    """Return the matrix of a turn, counter-clockwise seen from the axis' tip; exact for quarter turns about the axes.

    Parameters
    ----------
    axis : (3,) float
        Any length but 0.
    angle : float
        Degrees.

    Returns
    -------
    (3, 3) float64

    Notes
    -----
    Rodrigues: R = cos I + sin K + (1 - cos) a a^T, with K x = a x x.

    Examples
    --------
    >>> (rotation((0, 1, 0), 90) @ (1, 0, 0)).tolist()
    [0.0, 0.0, -1.0]
    """
    a = _normalise(np.array([axis], np.float64))[0]
    quarters, rest = divmod(math.fmod(angle, 360), 90)
    turn = math.radians(angle)
    cos, sin = QUARTER_TURNS[int(quarters) % 4] if rest == 0 else (math.cos(turn), math.sin(turn))
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.asarray(cos * np.eye(3) + sin * cross + (1 - cos) * np.outer(a, a) + 0.0)


def place(raw: RawMesh, entry: Any, material_id: int) -> Placed:
    """Scale, rotate and translate a mesh as an object of the scene says.

    Parameters
    ----------
    raw : RawMesh
    entry : raytrace.scene.schema.Object
    material_id : int
        Row of the scene's Materials.

    Returns
    -------
    Placed

    Raises
    ------
    SceneError
        Smooth normals are asked for, and those of the file are wrong.
    ValueError
        Coordinates beyond ``MAX_COORDINATE``, or so large that nothing is left of the mesh's shape.
    """
    if raw.normals_fault and entry.normals == "smooth":
        raise SceneError([f'{raw.normals_fault}; mend the normals, or use "normals": "flat"'])
    turn = np.eye(3) if entry.rotate is None else rotation(entry.rotate.axis, entry.rotate.angle)
    raw = quiet_unused(raw)
    mesh = quiet_unused(transform(raw, turn * entry.scale, np.array(entry.translate)))
    largest = np.max(np.abs(mesh.vertices))
    if not largest <= MAX_COORDINATE:
        raise ValueError(f"coordinates reach {largest:.3g} in the world; expected at most {MAX_COORDINATE:g}")
    if np.ptp(raw.vertices, axis=0).any() and not np.ptp(mesh.vertices, axis=0).any():
        raise ValueError(
            f"even in float64 all of it is one point at coordinates up to {largest:.3g}; "
            "move it nearer to the origin, or use a larger scale"
        )
    if mesh.normals is not None:
        mesh = mesh._replace(normals=_normalise(mesh.normals))
    return Placed(mesh, entry.normals == "smooth", material_id)


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
    return _normalise(np.cross(edges[0], edges[1]))


def averaged_normals(mesh: RawMesh, ng: Vectors) -> Vectors:
    """Return for each corner the mean of the face normals about its position, weighted by the faces' angles there.

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
    # angle at corner i between the edges to the next and to the one before; atan2 is exact for slivers too
    to_next = _normalise((np.roll(corners, -1, axis=1) - corners).reshape(-1, 3))
    to_last = _normalise((np.roll(corners, 1, axis=1) - corners).reshape(-1, 3))
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
    return _normalise(np.stack(sums, axis=1).astype(np.float64, copy=False))[ids].reshape(-1, 3, 3)


def shading_normals(placed: Placed, ng: Vectors) -> Vectors:
    """Return the (m, 3, 3) unit shading normals of an object's corners.

    Notes
    -----
    Flat: the face normal. Smooth: the file's normal; an averaged one where the file has none; the face normal where the
    file's is zero or not finite. A triangle without area has none: (0, 0, 1) stands there, and no ray meets it.
    """
    flat = np.where(ng.any(axis=1, keepdims=True), ng, (0.0, 0.0, 1.0))[:, None, :]
    mesh = placed.mesh
    if not placed.smooth:
        return np.repeat(flat, 3, axis=1)
    if mesh.normals is None or mesh.normal_faces is None:
        smooth = averaged_normals(mesh, ng)
    else:
        smooth = mesh.normals[mesh.normal_faces]
        if (none := mesh.normal_faces < 0).any():
            smooth[none] = averaged_normals(mesh, ng)[none]
    return np.where(smooth.any(axis=2, keepdims=True), smooth, flat)


def assemble(objects: list[Placed]) -> tuple[Mesh, list[tuple[int, str]]]:
    """Join the objects of a scene into one mesh.

    Parameters
    ----------
    objects : list of Placed
        At least one.

    Returns
    -------
    mesh : Mesh
        Its normals are None where no object is smooth.
    warnings : list of (int, str)
        Number of an object, and what is probably not meant in its mesh.
    """
    warnings = []
    any_smooth = any(placed.smooth for placed in objects)
    faces, normals, before = [], [], 0
    for i, placed in enumerate(objects):
        ng = face_normals(placed.mesh)
        degenerate = int(np.count_nonzero(~ng.any(axis=1)))
        if degenerate:
            text = f"{degenerate} of {len(ng)} triangles have no area; no ray will meet them"
            warnings.append((i, text))
        if any_smooth:
            ns = shading_normals(placed, ng)
            turned = int(np.count_nonzero((ns.sum(axis=1) * ng).sum(axis=1) < 0))
            if turned:
                text = f"the normals of {turned} of {len(ng)} triangles point to their back; turn either round"
                warnings.append((i, text))
            normals.append(ns)
        faces.append(placed.mesh.faces + before)
        before += len(placed.mesh.vertices)
    counts = [len(part) for part in faces]
    mesh = Mesh(
        vertices=np.concatenate([placed.mesh.vertices for placed in objects]),
        faces=np.ascontiguousarray(np.concatenate(faces)),
        normals=np.ascontiguousarray(np.concatenate(normals)) if any_smooth else None,
        material_id=np.repeat(np.array([placed.material_id for placed in objects], np.int32), counts),
        object_id=np.repeat(np.arange(len(objects), dtype=np.int32), counts),
    )
    return mesh, warnings
