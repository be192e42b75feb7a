"""Reflection, refraction and the start of the next ray, for arrays of any float type."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def _rows(*arrays: ArrayLike) -> list[NDArray[np.floating]]:
    """Arrays of one float type and one shape (..., 3)."""
    kind = np.result_type(*(np.asarray(array).dtype for array in arrays), np.float32)
    return list(np.broadcast_arrays(*(np.asarray(array, kind) for array in arrays)))


def _dot(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.floating]:
    return (a * b).sum(axis=-1, keepdims=True)


def _unit(a: NDArray[np.floating]) -> NDArray[np.floating]:
    return a / np.sqrt(_dot(a, a))


def reflect(d: ArrayLike, n: ArrayLike) -> NDArray[np.floating]:
    """Mirror directions at surfaces.

    Parameters
    ----------
    d : (..., 3) array_like
        Unit directions towards the surface.
    n : (..., 3) array_like
        Unit normals, on either side.

    Returns
    -------
    (..., 3) array
        Unit directions d - 2 (d . n) n, away from the surface.

    Examples
    --------
    >>> import raytrace as rt
    >>> rt.reflect([0.6, -0.8, 0.0], [0.0, 1.0, 0.0])
    array([0.6, 0.8, 0. ])
    """
    d, n = _rows(d, n)
    return _unit(d - 2.0 * _dot(d, n) * n)


def refract(d: ArrayLike, n: ArrayLike, eta: ArrayLike) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """Send directions through interfaces by Snell's law, sin_t = sin_i / eta.

    Parameters
    ----------
    d : (..., 3) array_like
        Unit directions towards the surface.
    n : (..., 3) array_like
        Unit normals on the side that the rays come from: d . n < 0.
    eta : (...) array_like
        Index of the medium that is entered over that of the medium that is left.

    Returns
    -------
    direction : (..., 3) array
        Unit directions behind the surface; where reflection is total, the reflected ones.
    total : (...) bool array
        Where reflection is total.

    Notes
    -----
    The part of d along the surface has length sin_i and is divided by eta; what is left to unit length goes against n
    [Pharr2023]_. The first is taken from d + n, which is small near normal incidence and exact there; cos_t^2 is

        ((eta - 1) (eta + 1) + cos_i^2) / eta^2   or   1 - sin_t^2,

    the first where cos_i^2 < 1/2: so nothing cancels at grazing or normal incidence, and near the critical angle the
    result is exact for a direction that differs from d by a few roundings. An eta of exactly 1 changes nothing.

    Examples
    --------
    >>> import raytrace as rt
    >>> direction, total = rt.refract([0.6, -0.8, 0.0], [0.0, 1.0, 0.0], 1.5)
    >>> direction[0].round(6), total
    (np.float64(0.4), np.False_)
    """
    d, n = _rows(d, n)
    eta = np.asarray(eta, d.dtype)[..., None]
    cosine, between = _dot(d, n), d + n
    with np.errstate(all="ignore"):  # indices beyond the range of the floats: total, or straight against n
        s = (between - _dot(between, n) * n) / eta
        level = (eta - 1.0) / eta * (1.0 + 1.0 / eta) + (cosine / eta) ** 2
        rest = np.where(cosine**2 < 0.5, level, 1.0 - _dot(s, s))
        total = ~(rest > 0.0) & (eta != 1.0)
        through = _unit(s - np.sqrt(np.fmax(rest, 0.0)) * n)
    direction = np.where(total, reflect(d, n), np.where(eta == 1.0, d, through))
    return direction, np.broadcast_to(total, (*direction.shape[:-1], 1))[..., 0][()]


def spawn_ray(p: ArrayLike, p_error: ArrayLike, ng: ArrayLike, d: ArrayLike) -> NDArray[np.floating]:
    """Origins of rays that leave surfaces, pushed off them by the error bound of the point and never by a constant.

    Parameters
    ----------
    p, p_error, ng : (..., 3) array_like, world units
        As ``BVH.surface`` gives them: points, bounds of their error, unit geometric normals.
    d : (..., 3) array_like
        Directions of the rays; they tell on which side to start.

    Returns
    -------
    (..., 3) array, world units
        p moved along ng by |ng| . p_error, to the side of d [Pharr2023]_.

    Examples
    --------
    >>> import raytrace as rt
    >>> rt.spawn_ray([0.0, 1.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0])
    array([0.      , 0.999999, 0.      ])
    """
    p, p_error, ng, d = _rows(p, p_error, ng, d)
    distance = _dot(np.abs(ng), p_error)
    return p + np.where(_dot(d, ng) < 0.0, -distance, distance) * ng
