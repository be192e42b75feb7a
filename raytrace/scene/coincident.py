"""Warnings of refractive surfaces that coincide with another surface, so that rays from one can miss the other."""

import math
import warnings
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from raytrace.errors import SceneError, SceneWarning
from raytrace.records import REFRACTIVE, Mesh, Scene
from raytrace.scene.facets import Facets, Mask, coincident_pairs, make_facets
from raytrace.scene.neighbours import Objects
from raytrace.scene.other_camera import base_of
from raytrace.scene.precision import choose_precision, gamma

OVERLAP_ERRORS = (
    4  # errors of a point by which two triangles must overlap, so that touching along an edge does not count
)
LIFT_BOUNDS = 4  # bounds by which to move the surfaces apart, so that they stay apart after rounding
SAME_DIRECTION = 0.99  # cosine between directions that count as one
MOST_PAIRS = 20  # pairs of objects that are named

_found: WeakKeyDictionary[Scene, dict[str, tuple["Coincidence", ...]]] = WeakKeyDictionary()  # by precision


class Coincidence(NamedTuple):
    """Two objects, one of them refractive, whose surfaces coincide over more than one triangle."""

    first: int  # number of the refractive object
    second: int  # number of the other; the same number: two layers of one object
    lift: float  # world units: how far to move one of the two
    direction: tuple[float, float, float] | None  # of the move, into the first object; None: there are several

    def text(self, objects: tuple[str, ...]) -> str:
        """Return what is wrong, and how to fix it.

        Examples
        --------
        >>> print(Coincidence(0, 1, 2e-5, (0.0, 1.0, 0.0)).text(("cube.obj", "floor.obj")))
        cube.obj is refractive and coincides with floor.obj (objects[1]): rays that leave one can miss the other; lift it by 2e-05 along (0, 1, 0)
        """  # noqa: E501
        name = f"{objects[self.first]} is refractive and coincides with"
        where = "rays that leave one can miss the other"
        if self.first == self.second:
            return f"{name} itself: {where}; remove one of the two layers, or move it by {self.lift:g}"
        other = f"{objects[self.second]} (objects[{self.second}])"
        if self.direction is None:
            return f"{name} {other}: {where}; move the two apart by {self.lift:g} wherever they touch"
        x, y, z = self.direction
        return f"{name} {other}: {where}; lift it by {self.lift:g} along ({x:.3g}, {y:.3g}, {z:.3g})"


def coincidences(scene: Scene, precision: str) -> tuple[Coincidence, ...]:
    """Return refractive surfaces that coincide with others in a precision; the result is kept with the scene.

    Parameters
    ----------
    scene : Scene
    precision : {"float32", "float64"}

    Returns
    -------
    tuple of Coincidence
        In the order of the objects.
    """
    kept = _found.setdefault(base_of(scene), {})
    if precision not in kept:
        refractive = scene.materials.kind[scene.mesh.material_id] == REFRACTIVE
        kept[precision] = _search(scene.mesh, refractive, precision) if refractive.any() else ()
    return kept[precision]


def chosen_coincidences(scene: Scene) -> tuple[Coincidence, ...]:
    """Return the same for the scene's own precision; nothing if no precision suffices, which the plan reports."""
    try:
        return coincidences(scene, choose_precision(scene).name)
    except SceneError:
        return ()


def warn_coincident(scene: Scene, precision: str, stacklevel: int) -> None:
    """Issue a ``SceneWarning`` for each of the first coincidences."""
    for found in coincidences(scene, precision)[:MOST_PAIRS]:
        warnings.warn(f"objects[{found.first}]: {found.text(scene.objects)}", SceneWarning, stacklevel=stacklevel + 1)


def texts_in(scene: Scene, precision: str) -> list[str]:
    """Return one line per coincidence that a precision has and the scene's own precision has not."""
    known = {(found.first, found.second) for found in chosen_coincidences(scene)}
    new = [found for found in coincidences(scene, precision) if (found.first, found.second) not in known]
    return [f"objects[{found.first}]: {found.text(scene.objects)}" for found in new[:MOST_PAIRS]]


def _search(mesh: Mesh, refractive: Mask, precision: str) -> tuple[Coincidence, ...]:
    """Search each refractive object for doubled layers, and compare it with each object whose box meets its own."""
    objects = Objects(mesh)
    glass = refractive[objects.first]
    error, unit = gamma(precision), float(np.finfo(precision).eps) / 2
    found = []
    for one in np.flatnonzero(glass).tolist():
        others = objects.near(one, error)
        others = others[~glass[others] | (others > one)]
        for two in [one, *others.tolist()]:
            a, b = objects.doubled(one) if two == one else objects.clipped(one, two, error)
            if len(a) and len(b):
                facets = [make_facets(objects.corners(rows), unit) for rows in (a, b)]
                move = _move(facets[0], facets[1], error)
                if move is not None:
                    first, second = (int(mesh.object_id[objects.first[k]]) for k in (one, two))
                    found.append(Coincidence(first, second, _rounded_up(move[0] * objects.scale), move[1]))
    return tuple(found)


def _move(a: Facets, b: Facets, error: float) -> tuple[float, tuple[float, float, float] | None] | None:
    """Return how far and where to move a so that it no longer coincides with b; None: under two triangles do."""
    if not (a.bound.size and b.bound.size):
        return None
    largest = float(max(-a.low.min(), a.high.max()))
    pairs: set[tuple[int, int]] = set()
    for found in coincident_pairs(a, b, OVERLAP_ERRORS * error * largest):
        pairs.update(zip(*(rows.tolist() for rows in found), strict=True))
        if len(pairs) > 1:  # these suffice
            break
    else:
        return None
    i, j = np.array(sorted(pairs)).T
    lift = max(LIFT_BOUNDS * float((a.bound[i] + b.bound[j]).max()), error * largest)
    inwards = -a.normal[:, i[0]]
    if (inwards @ a.normal[:, i] > -SAME_DIRECTION).any():
        return lift, None
    x, y, z = (inwards + 0.0).tolist()
    return lift, (x, y, z)


def _rounded_up(x: float) -> float:
    """Return a number rounded up to two digits."""
    digits = 1 - math.floor(math.log10(x))
    return float(f"{math.ceil(x * 10.0**digits)}e{-digits}")
