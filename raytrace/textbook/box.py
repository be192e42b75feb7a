"""A ray against an axis-aligned box."""

import numpy as np
from numpy.typing import NDArray

F8 = NDArray[np.floating]


def slab(o: F8, inverse_d: F8, low: F8, high: F8, tmax: F8) -> NDArray[np.bool_]:
    """Whether rays meet a box for some t in [0, tmax].

    Parameters
    ----------
    o, inverse_d : (n, 3) arrays
        Origins, and 1 / direction in each component.
    low, high : (3,) arrays
        Corners of the box.
    tmax : (n,) array

    Returns
    -------
    (n,) array of bool

    Notes
    -----
    A box is three slabs. A ray is between the two planes of slab k for t from (low_k - o_k) / d_k to
    (high_k - o_k) / d_k, or the other way round; it is in the box where it is in all three slabs [Kay1986].
    A direction component of 0 gives infinities of the right signs, and NaN for an origin exactly on a plane: such a
    slab excludes nothing.

    Examples
    --------
    >>> import numpy as np
    >>> o, d = np.array([[0.0, 0.5, 0.5], [0.0, 2.0, 0.5]]), np.array([[1.0, 1e-9, 1e-9], [1.0, 1e-9, 1e-9]])
    >>> slab(o, 1 / d, np.zeros(3), np.ones(3), np.full(2, np.inf))
    array([ True, False])
    """
    with np.errstate(invalid="ignore"):
        t0, t1 = (low - o) * inverse_d, (high - o) * inverse_d
    near, far = np.minimum(t0, t1), np.maximum(t0, t1)  # both are NaN where one of t0, t1 is
    enter = np.where(np.isnan(near), -np.inf, near).max(axis=1)
    leave = np.where(np.isnan(far), np.inf, far).min(axis=1)
    leave *= 1 + 1e-12  # rounding must not close a box that a ray just touches
    return (enter <= leave) & (leave >= 0) & (enter < tmax)
