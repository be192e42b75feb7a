"""The mapping from a square to the sphere that preserves areas, as pbrt-v4 has it for environments [Pharr2023, A.5.4].

The inner diamond of the square is the upper half of the sphere (z up), its corners the lower half.
"""

import numpy as np
from numpy.typing import NDArray


def square_to_sphere(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit directions (n, 3) of points (x, y) of the unit square, (n,) each.

    With u = 2 x - 1, v = 2 y - 1 and s = 1 - abs(u) - abs(v): r = 1 - abs(s) is 0 at the poles and 1 at the equator,
    z = sign(s) (1 - r^2), and the azimuth goes from 0 to pi / 2 along each quarter of the circle of radius r.

    Examples
    --------
    >>> square_to_sphere(np.array([0.5, 1.0]), np.array([0.5, 0.5])).round(6).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    u, v = 2 * x - 1, 2 * y - 1
    signed = 1 - np.abs(u) - np.abs(v)
    r = 1 - np.abs(signed)
    with np.errstate(invalid="ignore", divide="ignore"):
        azimuth = np.where(r > 0, ((np.abs(v) - np.abs(u)) / r + 1) * np.pi / 4, np.pi / 4)
    z = np.copysign(1 - r * r, signed)
    across = r * np.sqrt(np.maximum(2 - r * r, 0.0))
    return np.stack([np.copysign(np.cos(azimuth), u) * across, np.copysign(np.sin(azimuth), v) * across, z], axis=1)
