"""Chooses the precision of a scene, by bounds on the rounding errors of positions."""

import math
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.records import ROUGH_DIELECTRIC, Mesh, Scene
from raytrace.scene.other_camera import base_of
from raytrace.scene.tables import light_number

GAMMA = 27  # roundings of the largest coordinate that bound the error of a point: 3 + 12 x 2 of passes/surface.py
TOLERANCE = 0.01  # of the smallest feature: the largest error of position allowed in float32
FLOAT32_RANGE = 1e-12, 1e12  # world units: areas, and the rounding errors of areas, stay normal numbers
FLOAT64_RANGE = 1e-75, 1e75  # world units: so do squares of areas, which the choice of precision computes
FLOAT32_BEND = 1e-5  # alpha x |ior - 1|: the angle by which a rough dielectric spreads light that it transmits
FLOAT32_LEVELS = 1e-30, 1e30  # light and indices: results computed from them stay in range

Axes = NDArray[np.float64]  # (3, m): all x, all y, all z


class Precision(NamedTuple):
    """The precision chosen and the bound that chose it."""

    name: str  # "float32" or "float64"
    why: str
    largest: float  # world units: largest coordinate of meshes and camera
    feature: float  # world units: smallest height of a triangle that has an area
    error: float  # world units: bound on the error of a point's position in float32


class MeshSizes(NamedTuple):
    """What the choice of a precision needs to know of a mesh; it does not depend on the camera."""

    largest: float  # world units: largest coordinate
    feature: float  # world units: smallest height of a triangle that has an area
    objects: NDArray[np.int32]  # (n,) i4: the objects that have triangles
    size: NDArray[np.float64]  # (n,) f8, world units: longest side of the box of each
    far: NDArray[np.float64]  # (n,) f8, world units: largest coordinate of each


_sizes: WeakKeyDictionary[Scene, MeshSizes] = WeakKeyDictionary()


def gamma(precision: str) -> float:
    """Bound the relative error of ``GAMMA`` roundings: n u / (1 - n u), u the unit roundoff [Higham2002, section 3.1].

    Examples
    --------
    >>> round(gamma("float32") * 2**24, 3)
    27.0
    """
    unit = float(np.finfo(precision).eps) / 2
    return GAMMA * unit / (1 - GAMMA * unit)


def choose_precision(scene: Scene) -> Precision:
    """Return the precision that the scene states; ``auto`` chooses float32 where its error is small enough.

    The error of a position is at most gamma(27) times the largest coordinate. float32 is chosen where that is below 1 %
    of the smallest feature.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Precision

    Raises
    ------
    SceneError
        Not even float64 can represent the scene: an object is too small for its distance from the origin.
    """
    base = base_of(scene)
    if base not in _sizes:
        _sizes[base] = _sizes_of(scene.mesh)
    sizes = _sizes[base]
    _check_sizes(scene, sizes)
    largest = max(sizes.largest, _largest(scene.camera.position))
    feature, asked = sizes.feature, scene.settings.precision
    name, why = _choose(scene, largest, feature) if asked == "auto" else (asked, "set by the scene")
    error = gamma(name) * largest
    if error > TOLERANCE * feature:
        why += f"; features below {error / TOLERANCE:.2g} are not safe in {name}"
    return Precision(name, why, largest, feature, gamma("float32") * largest)


def _choose(scene: Scene, largest: float, feature: float) -> tuple[str, str]:
    """Return the name of the precision that suffices, and why."""
    low, high = FLOAT32_RANGE
    if feature < low or max(largest, *map(_largest, _light_positions(scene))) > high:
        return "float64", f"sizes leave {low:g} .. {high:g}"
    low, high = FLOAT32_LEVELS
    for names, tables in _levels(scene).items():
        levels = np.concatenate([table.ravel() for table in tables])
        levels = levels[(levels > 0) & np.isfinite(levels)]  # a conductor that reflects everything absorbs at inf
        if levels.min(initial=1.0) < low or levels.max(initial=1.0) > high:
            return "float64", f"{names} leave {low:g} .. {high:g}"
    if _least_bend(scene) < FLOAT32_BEND:
        return "float64", f"a rough dielectric spreads light by less than {FLOAT32_BEND:g}"
    error = gamma("float32") * largest
    bound = f"error of a point at most gamma({GAMMA}) x {largest:.3g} = {error:.2g}"
    limit = f"{TOLERANCE:.0%} of the smallest feature, {feature:.2g}"
    if error > TOLERANCE * feature:
        return "float64", f"in float32, {bound}, is more than {limit}"
    return "float32", f"{bound}, is less than {limit}"


def _light_positions(scene: Scene) -> list[NDArray[np.float64]]:
    """Positions of point and spot lights, (l, 3) each."""
    lights = scene.lights
    return [lights.position] if lights.spots is None else [lights.position, lights.spots.position]


def _levels(scene: Scene) -> dict[str, list[NDArray[np.float64]]]:
    """What float32 must hold beside sizes, by its name in messages."""
    lights, materials = scene.lights, scene.materials
    levels = {"fluxes, background or indices": [lights.flux, scene.background, materials.ior]}
    more = {
        "emissions": materials.emission,
        "intensities": None if lights.spots is None else lights.spots.intensity,
        "irradiances": None if lights.directions is None else lights.directions.irradiance,
        "radiances of the environment": lights.environment,
        "values of eta": materials.eta,
        "values of k": materials.k,
    }
    return levels | {name: [table] for name, table in more.items() if table is not None}


def _least_bend(scene: Scene) -> float:
    """Return the least angle by which a rough dielectric spreads light: inf if there is none."""
    materials = scene.materials
    if materials.alpha is None:
        return math.inf
    bend = materials.alpha * np.abs(materials.ior - 1)
    return float(bend[materials.kind == ROUGH_DIELECTRIC].min(initial=np.inf))


def _largest(*places: NDArray[np.float64]) -> float:
    return max(float(np.abs(place).max(initial=0.0)) for place in places)


def smallest_height(mesh: Mesh) -> float:
    """Return the smallest height of the triangles with an area: 2 area / longest side; inf if there are none."""
    a, b, c = _corners(mesh)
    first, second, third = b - a, c - b, a - c
    longest = np.sqrt(np.maximum.reduce([_dot(side, side) for side in (first, second, third)]))
    area = np.cross(first, third, axis=0)
    area = np.sqrt(_dot(area, area))
    return float((area[area > 0] / longest[area > 0]).min(initial=np.inf))


def _corners(mesh: Mesh) -> Axes:
    """Return the corners of the triangles, (3 corners, 3 axes, m)."""
    columns = np.ascontiguousarray(mesh.vertices.T)
    return np.stack([columns[:, mesh.faces[:, k]] for k in range(3)])


def _dot(a: Axes, b: Axes) -> Axes:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _sizes_of(mesh: Mesh) -> MeshSizes:
    corners, first = _corners(mesh), np.flatnonzero(np.diff(mesh.object_id, prepend=-1))
    lowest = np.minimum.reduceat(np.minimum.reduce(corners), first, axis=1)
    highest = np.maximum.reduceat(np.maximum.reduce(corners), first, axis=1)
    size, far = (highest - lowest).max(axis=0), np.maximum(-lowest, highest).max(axis=0)
    return MeshSizes(_largest(mesh.vertices), smallest_height(mesh), mesh.object_id[first], size, far)


def _check_sizes(scene: Scene, sizes: MeshSizes) -> None:
    """Refuse coordinates outside the range of float64, and objects smaller than 100 of its rounding errors there."""
    where = scene.source or "scene"
    low, high = FLOAT64_RANGE
    camera = _largest(scene.camera.position)
    places = {"camera": camera}
    for row, position in enumerate(np.concatenate(_light_positions(scene))):
        places[f"lights[{light_number(scene.lights, row)}]"] = _largest(position)
    problems = [
        f"{where}: {name}: coordinates reach {far:.3g}; expected at most {high:g}"
        for name, far in places.items()
        if far > high
    ]
    reaches = np.maximum(sizes.far, camera).tolist()
    for i, size, reach in zip(sizes.objects, sizes.size.tolist(), reaches, strict=True):
        what = f"{where}: objects[{i}]: {scene.objects[i]} has size {size:.3g}"
        error = gamma("float64") * reach
        if 0.0 < size < low:
            problems.append(f"{what}; no precision can represent less than {low:g}; use a larger scale")
        elif size > 0.0 and error > TOLERANCE * size:
            problems.append(
                f"{what}, but with coordinates, of it or of the camera, up to {reach:.3g} even float64 places points "
                f"only to gamma({GAMMA}) x {reach:.3g} = {error:.2g}; move both nearer to the origin"
            )
    if problems:
        raise SceneError(problems)
