"""Reflection, refraction and the start of the next ray, for arrays of any float type."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.accel.vectors import unit
from raytrace.passes.refraction import reflect_direction, refract_direction


def _rows(*arrays: ArrayLike) -> list[NDArray[np.floating]]:
    """Arrays of one float type and one shape (..., 3)."""
    kind = np.result_type(*(np.asarray(array).dtype for array in arrays), np.float32)
    return list(np.broadcast_arrays(*(np.asarray(array, kind) for array in arrays)))


def _dot(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.floating]:
    return (a * b).sum(axis=-1, keepdims=True)


def _components(a: NDArray[np.floating]) -> tuple[NDArray[np.floating], ...]:
    """Vectors as the kernels' functions take them: an array of each component."""
    return a[..., 0], a[..., 1], a[..., 2]


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
    return np.stack(unit(reflect_direction(_components(d), _components(n))), axis=-1)


def refract(d: ArrayLike, n: ArrayLike, eta: ArrayLike) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """Refract directions at interfaces by Snell's law, sin_t = sin_i / eta.

    Parameters
    ----------
    d : (..., 3) array_like
        Unit directions towards the surface.
    n : (..., 3) array_like
        Unit normals on the side that the rays come from: d . n < 0.
    eta : (...) array_like
        Index of refraction of the medium behind the surface over that of the medium in front.

    Returns
    -------
    direction : (..., 3) array
        Unit directions behind the surface; where reflection is total, the reflected ones.
    total : (...) bool array
        Where reflection is total.

    Notes
    -----
    The part of d along the surface has length sin_i and is divided by eta; the rest of the unit length goes against n
    [Pharr2023]_. That part is computed from d + n, which is small near normal incidence and exact there; cos_t^2 is

        ((eta - 1) (eta + 1) + cos_i^2) / eta^2   or   1 - sin_t^2,

    The first is used where cos_i^2 < 1/2. So nothing cancels at grazing or normal incidence. Near the critical angle
    the result is exact for a direction that differs from d by a few roundings. An eta of exactly 1 changes nothing.

    Examples
    --------
    >>> import raytrace as rt
    >>> direction, total = rt.refract([0.6, -0.8, 0.0], [0.0, 1.0, 0.0], 1.5)
    >>> direction[0].round(6), total
    (np.float64(0.4), np.False_)
    """
    d, n = _rows(d, n)
    with np.errstate(all="ignore"):  # indices beyond the range of the floats: total, or straight against n
        direction, total = refract_direction(_components(d), _components(n), np.asarray(eta, d.dtype))
    return np.stack(direction, axis=-1), total[()]


def spawn_ray(p: ArrayLike, p_error: ArrayLike, ng: ArrayLike, d: ArrayLike) -> NDArray[np.floating]:
    """Origins of rays that leave surfaces: points moved off the surface by their error bound, never by a constant.

    Parameters
    ----------
    p, p_error, ng : (..., 3) array_like, world units
        As ``BVH.surface`` gives them: points, bounds of their error, unit geometric normals.
    d : (..., 3) array_like
        Directions of the rays, which decide the side to start on.

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
