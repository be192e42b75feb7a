"""What each kind of material does with light, for NumPy arrays: the functions that the kernels call, chosen by kind.

Directions are in the frame of the shading normal, z up, on the side of the viewer o.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.passes import rough
from raytrace.passes.fresnel import conductor_reflectance
from raytrace.passes.microfacet import fresnel
from raytrace.passes.plastic import base_colour, coat_share, evaluate_base, sample_base
from raytrace.passes.refraction import reflect_direction, refract_direction
from raytrace.passes.warp import cosine_hemisphere
from raytrace.records import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    MIRROR,
    PLASTIC,
    REFRACTIVE,
    ROUGH_CONDUCTOR,
    ROUGH_DIELECTRIC,
)

F8 = NDArray[np.float64]
Vector = tuple[F8, F8, F8]  # components


class Material(NamedTuple):
    """A material as a row of the table that kernels read, for directions of so many rows."""

    kind: int
    two_sided: bool
    colour: Vector
    ior: F8
    eta: Vector
    k: Vector
    alpha: F8
    escape: F8


class Sample(NamedTuple):
    """Directions, f cos / pdf, and their density: 0 where no light is carried, inf where perfectly specular."""

    wi: Vector
    weight: Vector
    pdf: F8


def _grey(value: F8) -> Vector:
    return value, value, value


def _times(colour: Vector, value: F8) -> Vector:
    return colour[0] * value, colour[1] * value, colour[2] * value


def _evaluate_diffuse(row: Material, o: Vector, i: Vector) -> tuple[Vector, F8]:
    density = np.where(i[2] > 0, i[2], 0.0) / np.pi
    return _times(row.colour, density), density


def _evaluate_conductor(row: Material, o: Vector, i: Vector) -> tuple[Vector, F8]:
    value, density = rough.evaluate_conductor(o, i, row.alpha, row.eta, row.k)
    return tuple(np.where(density > 0, channel, 0.0) for channel in value), density  # type: ignore[return-value]


def _evaluate_dielectric(row: Material, o: Vector, i: Vector) -> tuple[Vector, F8]:
    value, density = rough.evaluate_dielectric(o, i, row.alpha, row.ior)
    return _grey(value), density


def _evaluate_plastic(row: Material, o: Vector, i: Vector) -> tuple[Vector, F8]:
    base = base_colour(row.colour, row.escape)
    _, chance = coat_share(o[2], base, row.ior, row.escape)
    value, density = evaluate_base((o[2], i[2]), base, row.ior, chance)
    return _times(base, np.where(i[2] > 0, value, 0.0)), np.where(i[2] > 0, density, 0.0)


def _sample_diffuse(row: Material, o: Vector, u: Vector) -> Sample:
    wi = cosine_hemisphere(u[0], u[1])
    return Sample(wi, row.colour, wi[2] / np.pi)


def _sample_rough_conductor(row: Material, o: Vector, u: Vector) -> Sample:
    wi, weight, density = rough.sample_conductor(o, row.alpha, row.eta, row.k, u[:2])
    return Sample(wi, weight, np.where(wi[2] > 0, density, 0.0))


def _sample_rough_dielectric(row: Material, o: Vector, u: Vector) -> Sample:
    wi, weight, density, _ = rough.sample_dielectric(o, row.alpha, row.ior, u)
    return Sample(wi, _grey(weight), np.where(weight > 0, density, 0.0))


def _sample_plastic(row: Material, o: Vector, u: Vector) -> Sample:
    base = base_colour(row.colour, row.escape)
    share, chance = coat_share(o[2], base, row.ior, row.escape)
    coat = u[2] < chance
    wi, weight, density = sample_base(o[2], base, row.ior, chance, u[:2])
    mirror = _mirrored(o)
    wi = tuple(np.where(coat, a, b) for a, b in zip(mirror, wi, strict=True))
    weight = tuple(np.where(coat, share / chance, channel) for channel in weight)
    return Sample(wi, weight, np.where(coat, np.inf, density))


def _mirrored(o: Vector) -> Vector:
    up = np.zeros_like(o[2]), np.zeros_like(o[2]), np.ones_like(o[2])
    x, y, z = reflect_direction((-o[0], -o[1], -o[2]), up)
    return x, y, z


def _refracted(row: Material, o: Vector) -> tuple[Vector, NDArray[np.bool_]]:
    up = np.zeros_like(o[2]), np.zeros_like(o[2]), np.ones_like(o[2])
    direction, total = refract_direction((-o[0], -o[1], -o[2]), up, row.ior)
    return direction, total


def _specular(wi: Vector, weight: Vector) -> Sample:
    return Sample(wi, weight, np.full_like(wi[2], np.inf))


def _sample_mirror(row: Material, o: Vector, u: Vector) -> Sample:
    return _specular(_mirrored(o), row.colour)


def _sample_conductor(row: Material, o: Vector, u: Vector) -> Sample:
    shares = [conductor_reflectance(o[2], eta, k) for eta, k in zip(row.eta, row.k, strict=True)]
    return _specular(_mirrored(o), (shares[0], shares[1], shares[2]))


def _sample_dielectric(row: Material, o: Vector, u: Vector) -> Sample:
    through, total = _refracted(row, o)
    share, _ = fresnel(o[2], row.ior)
    back = total | (u[2] < share)
    wi = [np.where(back, a, b) for a, b in zip(_mirrored(o), through, strict=True)]
    return _specular((wi[0], wi[1], wi[2]), _grey(np.where(back, 1.0, 1 / row.ior**2)))


def _sample_refractive(row: Material, o: Vector, u: Vector) -> Sample:
    through, _ = _refracted(row, o)
    return _specular(through, _grey(np.ones_like(o[2])))


EVALUATE: dict[int, Callable[[Material, Vector, Vector], tuple[Vector, F8]]] = {
    DIFFUSE: _evaluate_diffuse,
    ROUGH_CONDUCTOR: _evaluate_conductor,
    ROUGH_DIELECTRIC: _evaluate_dielectric,
    PLASTIC: _evaluate_plastic,
}
SAMPLE: dict[int, Callable[[Material, Vector, Vector], Sample]] = {
    DIFFUSE: _sample_diffuse,
    MIRROR: _sample_mirror,
    CONDUCTOR: _sample_conductor,
    DIELECTRIC: _sample_dielectric,
    REFRACTIVE: _sample_refractive,
    ROUGH_CONDUCTOR: _sample_rough_conductor,
    ROUGH_DIELECTRIC: _sample_rough_dielectric,
    PLASTIC: _sample_plastic,
}
