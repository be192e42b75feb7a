"""What a hand may change of a scene, and the scene that comes of it: on the same trees, so that it is there at once."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from raytrace.records import REFRACTIVE, Scene
from raytrace.rendering.compiled_scenes import set_compiled
from raytrace.rendering.wavefront import recompiled
from raytrace.show.orbit import turned
from raytrace.show.prepared_scene import PreparedScene


class SceneEdits(NamedTuple):
    """Where the edits stand."""

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


def changed(prepared: PreparedScene, edits: SceneEdits) -> Scene:
    """The scene as the edits have it; it holds size, samples and precision too, but no hash."""
    scene = prepared.scene
    ior = scene.materials.ior.copy()
    for name, value in edits.ior.items():
        ior[scene.materials.name.index(name)] = value
    new = replace(
        scene,
        camera=turned(scene.camera, edits.azimuth, edits.elevation, edits.distance),
        lights=scene.lights._replace(flux=scene.lights.flux * edits.power),
        materials=scene.materials._replace(ior=ior),
        settings=prepared.settings._replace(spp=edits.spp, precision=prepared.compiled.bvh.precision),
    )
    vars(new)["sha256"] = ""  # that of a large mesh takes longer than a frame
    set_compiled(new, recompiled(prepared.compiled, new))
    return new
