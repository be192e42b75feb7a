"""Cameras and lights of files and of trimesh, as entries of a scene.

All of them look, or send their light, along the -z axis of their node, y up; its scale has no meaning
[glTF, 3.10; KHR_lights_punctual].
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Entry = dict[str, Any]

RIGHT = 90.001  # degrees: largest cutoff that counts as a rounded right angle


def axis(matrix: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Return the unit vector of a column of a transform (4, 4); a column of zeros as it is."""
    column = matrix[:3, k]
    length = float(np.linalg.norm(column))
    return column / length if length > 0 else column


def camera_entry(matrix: NDArray[np.float64], *, fov: float | None = None, height: float | None = None) -> Entry:
    """Return a camera at a node.

    Parameters
    ----------
    matrix : (4, 4) float64
        From the node to the world.
    fov : float, degrees
        Full vertical angle of a perspective camera; or:
    height : float
        World units, of an orthographic one.

    Examples
    --------
    >>> camera_entry(np.eye(4), fov=30)["look_at"]
    [0.0, 0.0, -1.0]
    """
    position = matrix[:3, 3]
    entry = {"position": position.tolist(), "look_at": (position - axis(matrix, 2)).tolist()}
    entry["up"] = axis(matrix, 1).tolist()
    return entry | ({"fov": fov} if height is None else {"type": "orthographic", "height": height})


def light_entry(
    kind: str, matrix: NDArray[np.float64], level: NDArray[np.float64], inner: float = 0.0, outer: float = math.pi / 4
) -> Entry:
    """Return a light at a node.

    Parameters
    ----------
    kind : {"point", "spot", "directional"}
    matrix : (4, 4) float64
        From the node to the world.
    level : (3,) float64
        Colour times intensity: W / sr, of a directional light W / m2; in glTF, candela and lux stand for these.
    inner, outer : float, radians
        Of a spot light: angles from the axis within which its light is full, and from which on there is none.

    Examples
    --------
    >>> light_entry("point", np.eye(4), np.ones(3))["flux"][0] / math.pi
    4.0
    """
    position, direction = matrix[:3, 3], -axis(matrix, 2)
    if kind == "directional":
        return {"type": kind, "direction": direction.tolist(), "irradiance": level.tolist()}
    if kind == "point":  # the same intensity over the whole sphere of 4 pi sr
        return {"type": kind, "position": position.tolist(), "flux": (4 * math.pi * level).tolist()}
    beam, cutoff = math.degrees(inner), math.degrees(outer)
    cutoff = min(cutoff, 90.0) if cutoff < RIGHT else cutoff
    entry = {"type": "spot", "position": position.tolist(), "look_at": (position + direction).tolist()}
    return entry | {"intensity": level.tolist(), "cutoff": cutoff, "beam": beam}
