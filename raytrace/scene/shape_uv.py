"""Texture coordinates of the shapes sphere, rectangle and box, for the corners of their triangles.

They are made of sums, products, quotients and square roots only, so that their bits are the same on every machine.
"""

import math

import numpy as np
from numpy.typing import NDArray

from raytrace.records import RawMesh

Floats = NDArray[np.float64]

HALVINGS, TERMS = 3, 8  # angles of at most pi / 32, for which this many terms of the series of the arctangent suffice


def turns(y: Floats, x: Floats) -> Floats:
    """Return the angles of points (x, y) as parts of a full turn, from 0 to below 1: atan2(y, x) / (2 pi) mod 1.

    Notes
    -----
    By symmetry, the angle of t = tan(angle) in 0..1. Three times t becomes the tangent of half the angle,
    t / (1 + sqrt(1 + t^2)); then atan t = t - t^3 / 3 + t^5 / 5 - ...

    Examples
    --------
    >>> turns(np.array([0.0, 1.0, 0.0, -1.0, 1.0]), np.array([1.0, 0.0, -1.0, 0.0, 1.0])).tolist()
    [0.0, 0.25, 0.5, 0.75, 0.125]
    """
    low, high = np.minimum(abs(x), abs(y)), np.maximum(abs(x), abs(y))
    t = np.divide(low, high, out=np.zeros_like(low), where=high > 0)
    for _ in range(HALVINGS):
        t = t / (1 + np.sqrt(1 + t * t))
    square, series = t * t, np.zeros_like(t)
    for k in reversed(range(TERMS)):
        series = 1 / (2 * k + 1) - square * series
    part = t * series * (2**HALVINGS / (2 * math.pi))
    part = np.where(abs(y) > abs(x), 0.25 - part, part)
    part = np.where(x < 0, 0.5 - part, part)
    return np.where(y < 0, 1 - part, part) % 1.0


def rectangle_uv(mesh: RawMesh) -> Floats:
    """Return the uv (m, 3, 2) of the rectangle: ((x + 1) / 2, (y + 1) / 2)."""
    return (mesh.vertices[mesh.faces][:, :, :2] + 1) / 2


def box_uv(mesh: RawMesh) -> Floats:
    """Return the uv (m, 3, 2) of the box: 0 to 1 on each side, seen from outside, u to the right.

    v goes along y; on the upper side along -z and on the lower side along z, as if both were folded out from the side
    that faces +z.
    """
    corners = mesh.vertices[mesh.faces]
    right = {(0, 1): (0, 0, -1), (0, -1): (0, 0, 1), (2, -1): (-1, 0, 0)}
    up = {(1, 1): (0, 0, -1), (1, -1): (0, 0, 1)}
    uv = np.empty((len(corners), 3, 2))
    for row, triangle in enumerate(corners):
        axis = int(np.argmax((triangle == triangle[0]).all(axis=0)))
        side = axis, int(triangle[0, axis])
        for k, direction in enumerate((right.get(side, (1, 0, 0)), up.get(side, (0, 1, 0)))):
            uv[row, :, k] = ((triangle * direction).sum(axis=1) + 1) / 2
    return uv


def sphere_uv(mesh: RawMesh) -> Floats:
    """Return the uv (m, 3, 2) of the unit sphere: u = atan2(x, z) / (2 pi) mod 1, v = 1 - acos(y) / pi.

    The seam lies along edges, at x = 0 and z > 0. There u is 0 for triangles on one side, and 1 on the other. At a
    pole, u is the mean of the other two corners.
    """
    x, y, z = mesh.vertices.T
    u = turns(x, z)[mesh.faces]
    v = (1 - 2 * turns(np.sqrt(x * x + z * z), y))[mesh.faces]
    pole = ((x == 0) & (z == 0))[mesh.faces]
    u[pole] = -1.0
    u += ~pole & (u < u.max(axis=1, keepdims=True) - 0.5)
    others = np.where(pole, 0.0, u).sum(axis=1, keepdims=True) / 2
    return np.stack([np.where(pole, others, u), v], axis=2)
