"""A ray against an axis-aligned box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F8 = NDArray[np.floating]


def slab(o: F8, inverse_d: F8, low: F8, high: F8) -> tuple[F8, F8]:
    """Return t where rays enter and leave boxes. A ray meets a box if enter <= leave and leave >= 0.

    Parameters
    ----------
    o, inverse_d : (..., 3) arrays
        Origins, and 1 / direction in each component.
    low, high : (..., 3) arrays
        Corners of the boxes; shapes broadcast.

    Returns
    -------
    enter, leave : (...) arrays
        Negative where the ray starts in the box, or behind it.

    Notes
    -----
    A box is the intersection of three slabs. A ray is between the two planes of slab k for t from (low_k - o_k) / d_k
    to (high_k - o_k) / d_k, or the other way round. It is in the box where it is in all three slabs [Kay1986].
    If d_k is 0, both are infinite with the right signs, or NaN for an origin exactly on a plane. The ray then lies in
    that plane, so the slab excludes nothing.
    Three roundings lead to each t. leave is enlarged by a bound on them, 1 + 2 gamma(3) [Pharr2023, 6.8.2]: rounding
    never makes a ray miss a box that it touches.

    Examples
    --------
    >>> import numpy as np
    >>> o, d = np.array([[-1.0, 0.5, 0.5], [-1.0, 2.0, 0.5]]), np.array([1.0, 1e-9, 1e-9])
    >>> enter, leave = slab(o, 1 / d, np.zeros(3), np.ones(3))
    >>> (enter <= leave) & (leave >= 0)
    array([ True, False])
    """
    with np.errstate(invalid="ignore"):
        t0, t1 = (low - o) * inverse_d, (high - o) * inverse_d
    near, far = np.minimum(t0, t1), np.maximum(t0, t1)  # both are NaN where t0 or t1 is
    enter = np.where(np.isnan(near), -np.inf, near).max(axis=-1)
    leave = np.where(np.isnan(far), np.inf, far).min(axis=-1)
    u = np.finfo(leave.dtype).eps / 2  # unit roundoff
    return enter, leave * (1 + 2 * (3 * u / (1 - 3 * u)))
