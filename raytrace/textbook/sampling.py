"""Random directions and points, and how two ways to draw them are combined."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raytrace.textbook.camera import unit

F8 = NDArray[np.floating]


def cosine_hemisphere(u: F8) -> tuple[F8, F8]:
    """Unit vectors around z whose density is cos(theta) / pi per solid angle, and that density.

    A point of the unit disc, uniform by area, is lifted onto the hemisphere (Malley's method) [Pharr2023, A.5.3].

    Parameters
    ----------
    u : (n, 2) array
        Random numbers in [0, 1).

    Returns
    -------
    w : (n, 3) array
    pdf : (n, 1) array, 1 / sr

    Examples
    --------
    >>> import numpy as np
    >>> w, pdf = cosine_hemisphere(np.array([[0.0, 0.0], [0.36, 0.25]]))
    >>> w.round(3) + 0.0, pdf.round(3).ravel()
    (array([[0. , 0. , 1. ],
           [0. , 0.6, 0.8]]), array([0.318, 0.255]))
    """
    r, phi = np.sqrt(u[:, :1]), 2 * math.pi * u[:, 1:]
    cos = np.sqrt(1 - u[:, :1])
    return np.hstack([r * np.cos(phi), r * np.sin(phi), cos]), cos / math.pi


def uniform_triangle(u: F8) -> F8:
    """Barycentric weights (n, 3) of points that are uniform by area, from random numbers (n, 2) [Pharr2023, A.5.1].

    Examples
    --------
    >>> import numpy as np
    >>> uniform_triangle(np.array([[0.25, 0.5]]))
    array([[0.5 , 0.25, 0.25]])
    """
    root = np.sqrt(u[:, :1])
    return np.hstack([1 - root, root * (1 - u[:, 1:]), root * u[:, 1:]])


def to_world(n: F8, w: F8) -> F8:
    """Directions w (n, 3), given in frames whose z axis is n (n, 3), in world space."""
    helper = np.where(np.abs(n[:, :1]) > 0.9, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    x = unit(np.cross(helper, n))
    return w[:, :1] * x + w[:, 1:2] * np.cross(n, x) + w[:, 2:] * n


def power_heuristic(pdf: F8, other: F8) -> F8:
    """Weight pdf^2 / (pdf^2 + other^2) of a sample that was drawn with ``pdf``, and could have been with ``other``.

    The weights of the two techniques add up to 1, so their sum is unbiased [Veach1995].

    Examples
    --------
    >>> power_heuristic(3.0, 1.0) + power_heuristic(1.0, 3.0)
    1.0
    """
    return pdf**2 / (pdf**2 + other**2)
