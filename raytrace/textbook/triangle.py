"""A ray against a triangle."""

import numpy as np
from numpy.typing import NDArray

F8 = NDArray[np.floating]


def moller_trumbore(o: F8, d: F8, v0: F8, v1: F8, v2: F8) -> tuple[F8, F8, F8]:
    """Solve o + t d = (1 - u - v) v0 + u v1 + v v2 for t, u and v.

    Parameters
    ----------
    o, d, v0, v1, v2 : (..., 3) arrays
        Origins, directions and vertices; shapes broadcast.

    Returns
    -------
    t, u, v : (...) arrays
        t is inf where the ray's line misses the triangle, or is parallel to its plane.

    References
    ----------
    [Moller1997]: Cramer's rule on the 3 x 3 system, with determinants written as triple products.

    Examples
    --------
    >>> import numpy as np
    >>> v0, v1, v2 = np.eye(3)
    >>> t, u, v = moller_trumbore(np.zeros(3), np.ones(3), v0, v1, v2)
    >>> t.round(6), u.round(6), v.round(6)
    (np.float64(0.333333), np.float64(0.333333), np.float64(0.333333))
    """
    edge1, edge2 = v1 - v0, v2 - v0
    p = np.cross(d, edge2)
    det = np.sum(edge1 * p, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = o - v0
        u = np.sum(s * p, axis=-1) / det
        q = np.cross(s, edge1)
        v = np.sum(d * q, axis=-1) / det
        t = np.sum(edge2 * q, axis=-1) / det
        inside = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1)  # NaN is outside
    return np.where(inside, t, np.inf), u, v
