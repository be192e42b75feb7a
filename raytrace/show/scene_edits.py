"""What a hand may change of a scene, and the scene that comes of it: on the same trees, so that it is there at once."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from raytrace.records import REFRACTIVE, Scene
from raytrace.rendering.compiled_scene import recompiled, set_compiled
from raytrace.show.orbit import turned
from raytrace.show.scene_rays import Subject


class Knobs(NamedTuple):
    """Where the knobs stand."""

    azimuth: float = 0.0  # degrees, of the camera around what it looks at
    elevation: float = 0.0  # degrees
    distance: float = 1.0  # of the scene's own
    power: float = 1.0  # by which all fluxes are multiplied
    ior: Mapping[str, float] = {}  # by name of a refractive material
    spp: int = 64


def refractive(scene: Scene) -> dict[str, float]:
    """Index of refraction of each material that has one."""
    materials = scene.materials
    rows = np.flatnonzero(materials.kind == REFRACTIVE)
    return {materials.name[row]: float(materials.ior[row]) for row in rows}


def changed(subject: Subject, knobs: Knobs) -> Scene:
    """The scene as the knobs have it; it holds size, samples and precision too, but no hash."""
    scene = subject.scene
    ior = scene.materials.ior.copy()
    for name, value in knobs.ior.items():
        ior[scene.materials.name.index(name)] = value
    new = replace(
        scene,
        camera=turned(scene.camera, knobs.azimuth, knobs.elevation, knobs.distance),
        lights=scene.lights._replace(flux=scene.lights.flux * knobs.power),
        materials=scene.materials._replace(ior=ior),
        settings=subject.settings._replace(spp=knobs.spp, precision=subject.stage.bvh.precision),
    )
    vars(new)["sha256"] = ""  # that of a large mesh takes longer than a frame
    set_compiled(new, recompiled(subject.stage, new))
    return new
