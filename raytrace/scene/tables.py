"""Materials and lights of a valid scene as tables."""

import math
from collections.abc import Iterable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.limits import MIN_ALPHA
from raytrace.records import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    MIRROR,
    PLASTIC,
    REFRACTIVE,
    ROUGH_CONDUCTOR,
    ROUGH_DIELECTRIC,
    Directions,
    Lights,
    Materials,
    Spots,
)
from raytrace.scene.metals import INDEX
from raytrace.texture_records import EnvironmentImage

KINDS = {
    "diffuse": DIFFUSE,
    "refractive": REFRACTIVE,
    "mirror": MIRROR,
    "dielectric": DIELECTRIC,
    "conductor": CONDUCTOR,
    "plastic": PLASTIC,
}
ROUGH = {"dielectric": ROUGH_DIELECTRIC, "conductor": ROUGH_CONDUCTOR}

LIGHTS = "point", "spot", "directional", "environment"


def materials_of(scene: Any) -> Materials:
    """Table of the materials of a valid scene; where there are textures, without their means."""
    kinds = list(scene.materials.values())
    emission = [_three(getattr(m, "emission", None), 0.0) for m in kinds]
    alpha = [getattr(m, "alpha", 0.0) for m in kinds]
    index = [_index(m) for m in kinds] if any(m.type == "conductor" for m in kinds) else None
    return Materials(
        name=tuple(scene.materials),
        kind=np.array([_kind(m) for m in kinds], np.int8),
        albedo=np.array([_reflectance(m) for m in kinds], np.float64),
        ior=np.array([getattr(m, "ior", 1) for m in kinds], np.float64),
        two_sided=np.array([getattr(m, "two_sided", False) for m in kinds]),
        transparent_shadow=np.array([getattr(m, "shadows", "opaque") == "transparent" for m in kinds]),
        emission=np.array(emission, np.float64) if any(map(any, emission)) else None,
        eta=None if index is None else np.array([eta for eta, _ in index], np.float64),
        k=None if index is None else np.array([k for _, k in index], np.float64),
        alpha=np.array(alpha, np.float64) if any(alpha) else None,
    )


def _kind(material: Any) -> int:
    """Kind of a material; a surface between two equal media is smooth, because it bends no light."""
    rough = getattr(material, "alpha", 0.0) >= MIN_ALPHA and getattr(material, "ior", 0.0) != 1
    return ROUGH[material.type] if rough else KINDS[material.type]


def _reflectance(material: Any) -> tuple[float, ...]:
    """Share of the light that a material reflects at normal incidence; 1 where that depends on the side."""
    if material.type == "conductor" and not isinstance(material.reflectance, SimpleNamespace):
        eta, k = (np.array(values) for values in _index(material))
        with np.errstate(invalid="ignore"):
            share = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
        return tuple(np.where(np.isinf(k), 1.0, share).tolist())
    return _three(getattr(material, "albedo", None) or getattr(material, "reflectance", None), 1.0)


def _three(value: Any, default: float) -> tuple[float, ...]:
    """Three numbers; the default where there are none, or a texture."""
    return (default,) * 3 if value is None or isinstance(value, SimpleNamespace) else tuple(value)


def _index(material: Any) -> tuple[Sequence[float], Sequence[float]]:
    """Index of refraction and absorption index of a conductor; 1 and 0 for another material.

    A reflectance r at normal incidence is that of eta = 1 and k = 2 sqrt(r / (1 - r)). Where it is a texture, eta is 0.
    """
    if material.type != "conductor":
        return (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
    if material.metal is not None:
        return INDEX[material.metal]
    if isinstance(material.reflectance, SimpleNamespace):
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if material.reflectance is not None:
        k = [2 * math.sqrt(r / (1 - r)) if r < 1 else math.inf for r in material.reflectance]
        return (1.0, 1.0, 1.0), k
    return material.eta, material.k


def lights_of(scene: Any, image: EnvironmentImage | None = None) -> Lights:
    """Tables of the lights of a valid scene, kind by kind; image: that of its environment."""
    of = {kind: [light for light in scene.lights if light.type == kind] for kind in LIGHTS}
    spots, directions = of["spot"], of["directional"]
    axes = np.array([np.subtract(light.look_at, light.position) for light in spots]).reshape(-1, 3)
    ways = np.array([light.direction for light in directions]).reshape(-1, 3)
    cutoff = np.array([light.cutoff for light in spots])
    beam = np.array([0.75 * light.cutoff if light.beam is None else light.beam for light in spots])
    return Lights(
        position=_rows(light.position for light in of["point"]),
        flux=_rows(light.flux for light in of["point"]),
        spots=Spots(
            _rows(light.position for light in spots),
            _unit(axes),
            _rows(light.intensity for light in spots),
            np.radians(cutoff),
            np.radians(beam),
        )
        if spots
        else None,
        directions=Directions(_unit(ways), _rows(light.irradiance for light in directions)) if directions else None,
        environment=_environment(of["environment"], image),
        image=image,
        numbers=_file_order([light.type for light in scene.lights]),
    )


def _file_order(kinds: list[str]) -> tuple[int, ...]:
    """Numbers of the lights of a scene, kind by kind; () where that is their order."""
    numbers = sorted(range(len(kinds)), key=lambda k: LIGHTS.index(kinds[k]))
    return () if numbers == list(range(len(kinds))) else tuple(numbers)


def light_number(lights: Lights, row: int) -> int:
    """Number, in the scene's list of lights, of a row: point lights first, then spots, directions, environment."""
    return lights.numbers[row] if lights.numbers else row


def _environment(lights: Sequence[Any], image: EnvironmentImage | None) -> NDArray[np.float64] | None:
    if image is not None:
        return image.texture.mean * image.scale
    return np.array(lights[0].radiance) if lights else None


def _rows(vectors: Iterable[Sequence[float]]) -> NDArray[np.float64]:
    return np.array(list(vectors), np.float64).reshape(-1, 3)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors; the largest component is brought to 1 first, so that no square overflows."""
    scaled = vectors / np.abs(vectors).max(axis=1, keepdims=True)
    return scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
