"""Transforms of objects: scale, rotations and translation, or a matrix; and the meshes that they map to the world."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.records import RawMesh
from raytrace.scene.meshes.raw_mesh import multiply, quiet_unused, transform, turned_round
from raytrace.scene.normals import normalise

Vectors = NDArray[np.float64]

MAX_COORDINATE = 1e75  # world units; squared areas, of the fourth power, stay below the largest float64, 1.8e308
QUARTER_TURNS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # cosine and sine, where libm's are off by 6e-17


ROUNDINGS, UNIT = 4, 2.0**-53  # of a transformed coordinate, relative to the largest number in its sum
TOLERANCE = 0.01  # of the size of an object: the largest rounding error of its transform


class Affine(NamedTuple):
    """A map of points: the linear part is applied to column vectors, then the offset is added."""

    linear: Vectors  # (3, 3)
    offset: Vectors  # (3,) world units


class PlacedMesh(NamedTuple):
    """The triangles of one object in world space."""

    mesh: RawMesh  # its normals are unit rows here, and zeros where those of the file are of no use
    smooth: bool  # whether the shading normals are those of the vertices
    material_id: int  # row of Materials


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
    a = normalise(np.array([axis], np.float64))[0]
    quarters, rest = divmod(math.fmod(angle, 360), 90)
    turn = math.radians(angle)
    cos, sin = QUARTER_TURNS[int(quarters) % 4] if rest == 0 else (math.cos(turn), math.sin(turn))
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.asarray(cos * np.eye(3) + sin * cross + (1 - cos) * np.outer(a, a) + 0.0)


def object_transform(entry: Any) -> Affine:
    """Return the map from the space of an object's shape to the world.

    Parameters
    ----------
    entry : types.SimpleNamespace
        An entry of ``objects``, as ``read_format`` returns it.

    Raises
    ------
    ValueError
        The map is not finite.

    Notes
    -----
    A matrix; or R_n ... R_1 diag(scale) and the translation. The shape of a sphere is the unit sphere: its radius and
    centre are part of the map. Sums are written out, as in ``transform``, for the same bits on every machine.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused later
        if entry.matrix is None:
            turn = np.eye(3)
            for i, step in enumerate(entry.rotate):
                matrix = rotation(step.axis, step.angle)
                turn = multiply(matrix, turn.T).T if i else matrix
            affine = Affine(turn * entry.scale, np.array(entry.translate))
        else:
            matrix = np.array(entry.matrix)
            affine = Affine(matrix[:3, :3], matrix[:3, 3])
        if entry.sphere is not None:
            centre = multiply(affine.linear, np.array([entry.sphere.center]))[0] + affine.offset
            affine = Affine(affine.linear * entry.sphere.radius, centre)
    if not all(np.isfinite(part).all() for part in affine):
        raise ValueError(f"coordinates reach inf in the world; expected at most {MAX_COORDINATE:g}")
    return affine


def place(raw: RawMesh, entry: Any, material_id: int) -> PlacedMesh:
    """Map a mesh to the world as an object of the scene states.

    Parameters
    ----------
    raw : RawMesh
    entry : types.SimpleNamespace
        An entry of ``objects``, as ``read_format`` returns it.
    material_id : int
        Row of the scene's Materials.

    Returns
    -------
    PlacedMesh

    Raises
    ------
    SceneError
        The object is smooth, and the normals of its file are wrong.
    ValueError
        Coordinates beyond ``MAX_COORDINATE``, or so large that all vertices become one point.
    """
    if raw.normals_fault and entry.normals == "smooth":
        raise SceneError([f'{raw.normals_fault}; correct the normals, or use "normals": "flat"'])
    raw = quiet_unused(raw)
    affine = object_transform(entry)
    mesh = quiet_unused(transform(raw, *affine))
    if entry.flip:
        mesh = turned_round(mesh)
    largest = np.max(np.abs(mesh.vertices))
    if not largest <= MAX_COORDINATE:
        raise ValueError(f"coordinates reach {largest:.3g} in the world; expected at most {MAX_COORDINATE:g}")
    size = np.ptp(mesh.vertices, axis=0).max()
    if np.ptp(raw.vertices, axis=0).any() and not size:
        raise ValueError(
            f"even in float64 all of it is one point at coordinates up to {largest:.3g}; "
            "move it nearer to the origin, or use a larger scale"
        )
    terms = _largest_term(raw.vertices, affine)
    if size and ROUNDINGS * UNIT * terms > TOLERANCE * size:
        raise ValueError(
            f"its transform adds numbers up to {terms:.3g} to a size of {size:.3g}, which even float64 does not hold; "
            "let the coordinates of the mesh itself be near the origin"
        )
    if mesh.normals is not None:
        mesh = mesh._replace(normals=normalise(mesh.normals))
    return PlacedMesh(mesh, entry.normals == "smooth", material_id)


def _largest_term(vertices: Vectors, affine: Affine) -> float:
    """Return a bound on the numbers that are added for any coordinate, world units."""
    reach = np.maximum(-vertices.min(axis=0), vertices.max(axis=0)).clip(0)
    return float((multiply(np.abs(affine.linear), reach[None])[0] + np.abs(affine.offset)).max())
