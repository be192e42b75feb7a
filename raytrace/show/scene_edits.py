"""Edits of a scene in the viewer, and the edited scene, which reuses the trees."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.records import DIELECTRIC, PLASTIC, REFRACTIVE, ROUGH_DIELECTRIC, Lights, Scene
from raytrace.rendering.compiled_scene import recompiled, set_compiled
from raytrace.show.hidden_backs import HiddenBacks
from raytrace.show.light_handles import moved_lights
from raytrace.show.orbit import orbited
from raytrace.show.prepared_scene import PreparedScene

MAX_SCALE = 32
INDEXED = REFRACTIVE, DIELECTRIC, ROUGH_DIELECTRIC, PLASTIC  # materials with one index of refraction


class SceneEdits(NamedTuple):
    """Values that the viewer can change, relative to the scene."""

    azimuth: float = 0.0  # degrees: rotation of the camera about the up vector
    elevation: float = 0.0  # degrees: rotation of the camera towards the up vector
    distance: float = 1.0  # factor for the distance of the camera
    power: float = 1.0  # factor for all lights
    ior: Mapping[str, float] = {}  # indices of refraction, by name of the material
    spp: int = 64
    light_positions: Sequence[Sequence[float]] = ()  # of point lights, then of spot lights; empty: as in the scene
    hide_backs: bool = False  # whether one-sided walls that the camera sees from behind are hidden from it
    scale: int = 1  # pixels of the image at rest for each pixel of the moving one, along a side


def indices_of_refraction(scene: Scene) -> dict[str, float]:
    """Index of refraction of each material that has one, by name."""
    materials = scene.materials
    rows = np.flatnonzero(np.isin(materials.kind, INDEXED))
    return {materials.name[row]: float(materials.ior[row]) for row in rows}


def edited(prepared: PreparedScene, edits: SceneEdits, backs: HiddenBacks | None = None) -> Scene:
    """The scene with these edits, and with size, samples and precision as settings; its hash is empty."""
    scene = prepared.scene
    ior = scene.materials.ior.copy()
    for name, value in edits.ior.items():
        ior[scene.materials.name.index(name)] = value
    width, height = prepared.settings.size
    size = edits.scale * width, edits.scale * height
    new = replace(
        scene,
        camera=orbited(scene.camera, edits.azimuth, edits.elevation, edits.distance),
        lights=moved_lights(_brighter(scene.lights, edits.power), edits.light_positions),
        materials=scene.materials._replace(ior=ior, emission=_brighter_lamps(scene, edits.power)),
        settings=prepared.settings._replace(size=size, spp=edits.spp, precision=prepared.compiled.bvh.precision),
    )
    vars(new)["sha256"] = ""  # the hash of a large mesh takes longer than a frame
    compiled = recompiled(prepared.compiled, new)
    if edits.hide_backs:
        backs = backs or HiddenBacks(scene, compiled.bvh)
        compiled = compiled._replace(camera_bvh=backs.tree(new.camera))
    set_compiled(new, compiled)
    return new


def number_of_lights(scene: Scene) -> int:
    """Number of lights whose power can be changed; all lamps count as one."""
    lights = scene.lights
    return (
        len(lights.flux)
        + (0 if lights.spots is None else len(lights.spots.cutoff))
        + (0 if lights.directions is None else len(lights.directions.irradiance))
        + (lights.environment is not None)
        + (scene.materials.emission is not None)
    )


def _brighter_lamps(scene: Scene, power: float) -> NDArray[np.float64] | None:
    """Emission of this power, relative to that of the scene; textures stay as they are."""
    emission = scene.materials.emission
    if emission is None or scene.textures is None:
        return None if emission is None else emission * power
    return np.where(scene.textures.emission[:, None] >= 0, emission, emission * power)


def _brighter(lights: Lights, power: float) -> Lights:
    """Lights of this power, relative to theirs."""
    spots, directions, image = lights.spots, lights.directions, lights.image
    return lights._replace(
        flux=lights.flux * power,
        spots=None if spots is None else spots._replace(intensity=spots.intensity * power),
        directions=None if directions is None else directions._replace(irradiance=directions.irradiance * power),
        environment=None if lights.environment is None else lights.environment * power,
        image=None if image is None else image._replace(scale=image.scale * power),
    )
