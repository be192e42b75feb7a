"""What the exports to all renderers share."""

import numpy as np

from raytrace.exporting.differences import Differences
from raytrace.exporting.meshes import Part, bend, file_stem
from raytrace.records import REFRACTIVE, SCATTERING, Scene

MOST_BEND = 12.0  # degrees between normals of corners and triangles, RMS; at 11 an image differed by 0.1 %
Contents = dict[str, bytes]  # files by their paths in the folder


def used_materials(scene: Scene) -> list[int]:
    """Rows of the materials that triangles have."""
    return np.flatnonzero(np.bincount(scene.mesh.material_id)).tolist()


def unique_names(names: tuple[str, ...]) -> list[str]:
    """Return a name per material that the formats of all renderers accept.

    >>> unique_names(("plate 1", "plate-1"))
    ['plate-1', 'plate-1-2']
    """
    found: list[str] = []
    for number, name in enumerate(names):
        stem = file_stem(name)
        found.append(stem if stem not in found else f"{stem}-{number + 1}")
    return found


def needs_path(scene: Scene) -> bool:
    """Whether the integrator follows paths over more than one surface."""
    specular = any(scene.materials.kind[k] not in SCATTERING for k in used_materials(scene))
    return scene.settings.integrator == "path" or specular


def shared_differences(scene: Scene, parts: list[Part], differences: Differences) -> None:
    """Note what no other renderer has."""
    other, table = differences.renderer, scene.materials
    if scene.settings.integrator == "direct" and needs_path(scene):
        text = f"{other} has no integrator 'direct' that follows specular surfaces and then ends at the first other one"
        differences.add("render.integrator", text, "all light is computed, by path tracing")
    if scene.background.any() and scene.lights.environment is None:
        text = f"{other} has no background that is seen, but does not light the scene"
        differences.add("background", text, "it is left black")
    for k in used_materials(scene):
        where = f"materials.{table.name[k]}"
        if table.kind[k] == REFRACTIVE:
            text = f"{other} has no 'refractive': glass that reflects nothing outside total reflection"
            differences.add(where, text, "it becomes a dielectric, which reflects too")
        if table.transparent_shadow[k]:
            text = f"{other} has no shadow rays that pass through glass unbent"
            differences.add(where, text, "its shadows are opaque")
    for part in parts:
        if bend(part) > MOST_BEND:
            text = f"{other} shades silhouettes of coarse meshes with smooth normals by other rules"
            differences.add(f"objects.{scene.objects[part.object_id]}", text, "its silhouette differs a little")
