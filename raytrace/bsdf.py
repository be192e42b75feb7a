"""The scattering functions of materials: ``eval``, ``pdf`` and ``sample``, by the functions that rendering uses.

Directions are rows (n, 3) that point away from the surface: ``wo`` to the viewer, ``wi`` to the light. z is the shading
normal, and the front. They may have any length but 0. All is computed in float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import OptionError
from raytrace.passes.material_functions import EVALUATE, SAMPLE, Material, Vector
from raytrace.passes.path_records import Surfaces
from raytrace.records import DIELECTRIC, DIFFUSE, PLASTIC, REFRACTIVE, ROUGH_DIELECTRIC

F8 = NDArray[np.float64]


def eval(material: dict[str, Any], wo: ArrayLike, wi: ArrayLike) -> F8:  # noqa: A001
    """Return the scattering function f(wo, wi), without the cosine.

    Parameters
    ----------
    material : dict
        As in a scene; colours are three numbers, not textures.
    wo, wi : (n, 3) array-like
        Directions to the viewer and to the light. Shapes broadcast without the last axis.

    Returns
    -------
    (n, 3) float64 array
        1 / sr for red, green and blue; 0 where the material reflects nothing, and for perfectly specular parts.

    Raises
    ------
    SceneError
        The material is not valid.
    OptionError
        Directions of length 0 or of the wrong shape, or a texture.

    Examples
    --------
    >>> import raytrace as rt
    >>> rt.bsdf.eval({"type": "diffuse", "albedo": [0.2, 0.4, 0.6]}, [0, 0, 1], [0, 0.6, 0.8]).round(4)
    array([[0.0637, 0.1273, 0.191 ]])
    >>> gold = {"type": "conductor", "metal": "gold", "alpha": 0.3}
    >>> rt.bsdf.eval(gold, [0.6, 0, 0.8], [-0.6, 0, 0.8]).round(3)
    array([[1.244, 1.061, 0.549]])
    """
    shape, (o, i) = _directions(wo, wi)
    o, i, front = _turned(o, i)
    channels, _ = _evaluated(_row(material, front), o, i, front)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.stack([np.where(channel > 0, channel / np.abs(i[2]), 0.0) for channel in channels], axis=-1)
    return value.reshape(*shape, 3)


def pdf(material: dict[str, Any], wo: ArrayLike, wi: ArrayLike) -> F8:
    """Return the density with which ``sample`` draws ``wi``.

    Parameters
    ----------
    material : dict
        As in a scene.
    wo, wi : (n, 3) array-like
        Directions to the viewer and to the light.

    Returns
    -------
    (n,) float64 array
        1 / sr; 0 for perfectly specular parts. It integrates to the probability that ``sample`` returns a weight above
        0 and a finite density: a rough surface also samples directions that end below it, which carry no light.

    Raises
    ------
    SceneError, OptionError
        As ``eval`` does.

    Examples
    --------
    >>> import raytrace as rt
    >>> rt.bsdf.pdf({"type": "diffuse", "albedo": [0.2, 0.4, 0.6]}, [0, 0, 1], [0, 0.6, 0.8]).round(4)
    array([0.2546])
    """
    shape, (o, i) = _directions(wo, wi)
    o, i, front = _turned(o, i)
    _, density = _evaluated(_row(material, front), o, i, front)
    return density.reshape(shape)


def sample(material: dict[str, Any], wo: ArrayLike, u: ArrayLike) -> tuple[F8, F8, F8]:
    """Draw directions to the light, as path tracing does.

    Parameters
    ----------
    material : dict
        As in a scene.
    wo : (n, 3) array-like
        Directions to the viewer.
    u : (n, 3) array-like
        Random numbers in [0, 1). The first two choose the direction, the third chooses reflection or transmission, or
        the coat of ``plastic``.

    Returns
    -------
    wi : (n, 3) float64 array
        Unit directions.
    weight : (n, 3) float64 array
        f abs(cos) / pdf; 0 where no light is carried. Of a perfectly specular direction: its reflectance, or what it
        transmits, over the probability with which it is chosen.
    pdf : (n,) float64 array
        1 / sr; inf where the direction is perfectly specular; 0 where no light is carried.

    Raises
    ------
    SceneError, OptionError
        As ``eval`` does; or random numbers outside [0, 1).

    Examples
    --------
    >>> import raytrace as rt
    >>> wi, weight, pdf = rt.bsdf.sample({"type": "mirror"}, [0.6, 0, 0.8], [0.5, 0.5, 0.5])
    >>> wi.round(6), weight, pdf
    (array([[-0.6,  0. ,  0.8]]), array([[1., 1., 1.]]), array([inf]))
    """
    numbers = np.atleast_2d(np.asarray(u, np.float64))
    if numbers.shape[-1] != 3 or not ((numbers >= 0) & (numbers < 1)).all():
        raise OptionError("u: expected rows of three random numbers in [0, 1)")
    shape, (o,) = _directions(wo, like=numbers)
    numbers = np.broadcast_to(numbers, (*shape, 3)).reshape(-1, 3)
    o, _, front = _turned(o, o)
    row = _row(material, front)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        drawn = SAMPLE[row.kind](row, o, (numbers[:, 0], numbers[:, 1], numbers[:, 2]))
    side = np.where(front, 1.0, -1.0)
    wi = np.stack([drawn.wi[0], drawn.wi[1], side * drawn.wi[2]], axis=-1)
    carries = (o[2] > 0) & _reflects(row, front) & (drawn.pdf > 0)
    weight = np.stack(drawn.weight, axis=-1)
    weight, density = np.where(carries[:, None], weight, 0.0), np.where(carries, drawn.pdf, 0.0)
    return wi.reshape(*shape, 3), weight.reshape(*shape, 3), density.reshape(shape)


def _directions(*given: ArrayLike, like: F8 | None = None) -> tuple[tuple[int, ...], list[Vector]]:
    """Leading shape of broadcast directions, and the components of each, made unit."""
    rows = [np.atleast_2d(np.asarray(directions, np.float64)) for directions in given]
    if any(row.shape[-1] != 3 for row in rows):
        raise OptionError("directions: expected rows of three numbers")
    try:
        shape = np.broadcast_shapes(*(row.shape for row in (*rows, *([] if like is None else [like]))))
    except ValueError:
        raise OptionError("directions: the shapes do not broadcast") from None
    units = []
    for row in rows:
        length = np.linalg.norm(row, axis=-1, keepdims=True)
        if not (np.isfinite(length) & (length > 0)).all():
            raise OptionError("directions: expected finite vectors other than 0")
        flat = np.broadcast_to(row / length, shape).reshape(-1, 3)
        units.append((flat[:, 0], flat[:, 1], flat[:, 2]))
    return shape[:-1], units


def _turned(o: Vector, i: Vector) -> tuple[Vector, Vector, NDArray[np.bool_]]:
    """Directions in the frame whose z points to the viewer, and whether that is the front."""
    side = np.where(o[2] > 0, 1.0, -1.0)
    return (o[0], o[1], side * o[2]), (i[0], i[1], side * i[2]), o[2] > 0


def _row(material: dict[str, Any], front: NDArray[np.bool_]) -> Material:
    """Look up a material as kernels do; indices are those seen from the viewer's side."""
    table = _table(material)
    kind, shape = int(table.kind[0]), front.shape

    def vector(values: NDArray[np.floating]) -> Vector:
        return np.full(shape, values[0]), np.full(shape, values[1]), np.full(shape, values[2])

    ior = np.full(shape, table.eta[0])
    if kind in (DIELECTRIC, ROUGH_DIELECTRIC, REFRACTIVE):
        ior = np.where(front, ior, 1 / ior)
    colour, eta, k = vector(table.reflectance), vector(table.eta), vector(table.k)
    alpha, escape = np.full(shape, table.alpha[0]), np.full(shape, table.escape[0])
    return Material(kind, bool(table.two_sided[0]), colour, ior, eta, k, alpha, escape)


def _table(material: dict[str, Any]) -> Surfaces:
    """Table of one material, read and checked as that of a scene."""
    from raytrace.rendering.path_scene import make_surfaces
    from raytrace.scene.load import load

    if isinstance(material, dict):
        for key, value in material.items():
            if isinstance(value, dict):
                raise OptionError(f"{key}: a texture needs a surface with uv; give three numbers")
    scene = {
        "camera": {"position": [0, 0, 1], "look_at": [0, 0, 0], "fov": 40},
        "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
        "materials": {"material": material},
        "objects": [{"rectangle": {}, "material": "material"}],
    }
    return make_surfaces(load(scene), None, np.dtype(np.float64))


def _reflects(row: Material, front: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether anything leaves on the viewer's side: diffuse and plastic may have no back."""
    one_sided = row.kind in (DIFFUSE, PLASTIC) and not row.two_sided
    return front if one_sided else np.ones_like(front)


def _evaluated(row: Material, o: Vector, i: Vector, front: NDArray[np.bool_]) -> tuple[Vector, F8]:
    """F cos, three channels, and the density of i."""
    zero = np.zeros_like(o[2])
    if row.kind not in EVALUATE:
        return (zero, zero, zero), zero
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value, density = EVALUATE[row.kind](row, o, i)
    there = (o[2] > 0) & _reflects(row, front)
    return tuple(np.where(there, channel, 0.0) for channel in value), np.where(there, density, 0.0)  # type: ignore[return-value]
