"""A ray against a triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F8 = NDArray[np.floating]


def moller_trumbore(o: F8, d: F8, v0: F8, v1: F8, v2: F8) -> tuple[F8, F8, F8]:
    """Return t, u, v of rays and triangles: the solution of o + t d = (1 - u - v) v0 + u v1 + v v2.

    Parameters
    ----------
    o, d, v0, v1, v2 : (..., 3) arrays
        Origins, directions and vertices; shapes broadcast.

    Returns
    -------
    t, u, v : (...) arrays
        t is inf where the line of the ray misses the triangle or is parallel to its plane, and negative where the
        triangle is behind the origin.

    References
    ----------
    [Moller1997]: Cramer's rule for the 3 x 3 system, with determinants written as triple products.

    Examples
    --------
    >>> import numpy as np
    >>> v0, v1, v2 = np.eye(3)
    >>> t, u, v = moller_trumbore(np.zeros(3), np.ones(3), v0, v1, v2)
    >>> t.round(6), u.round(6), v.round(6)
    (np.float64(0.333333), np.float64(0.333333), np.float64(0.333333))
    """
    e1, e2, s = v1 - v0, v2 - v0, o - v0
    p, q = np.cross(d, e2), np.cross(s, e1)
    det = np.sum(e1 * p, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u, v = np.sum(e2 * q, axis=-1) / det, np.sum(s * p, axis=-1) / det, np.sum(d * q, axis=-1) / det
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)  # False where det = 0: then u is infinite or NaN
    return np.where(inside, t, np.inf), u, v
