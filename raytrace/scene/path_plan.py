"""What of path tracing a scene needs, and what it leaves out."""

from collections.abc import Iterator

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
    SCATTERING,
    Scene,
)

NAMES = {
    DIFFUSE: "diffuse",
    MIRROR: "mirror",
    DIELECTRIC: "dielectric",
    CONDUCTOR: "conductor",
    REFRACTIVE: "refractive",
    ROUGH_DIELECTRIC: "rough dielectric",
    ROUGH_CONDUCTOR: "rough conductor",
    PLASTIC: "plastic",
}


def needs_paths(scene: Scene, integrator: str) -> bool:
    """Whether a scene needs the passes of path tracing, with this integrator."""
    lights = scene.lights
    others = (scene.materials.emission, lights.spots, lights.directions, lights.environment)
    kinds = scene.materials.kind[_used(scene)]
    simple = bool(((kinds == DIFFUSE) | (kinds == REFRACTIVE)).all())
    return integrator == "path" or not simple or any(other is not None for other in others)


def _used(scene: Scene) -> NDArray[np.intp]:
    return np.flatnonzero(np.bincount(scene.mesh.material_id))  # np.unique would import numpy.ma, in 10 ms


def light_words(scene: Scene) -> str:
    """The lights of a scene in words."""
    lights = scene.lights
    counts = {"point light": len(lights.flux)}
    if lights.spots is not None:
        counts["spot light"] = len(lights.spots.cutoff)
    if lights.directions is not None:
        counts["directional light"] = len(lights.directions.direction)
    if lights.environment is not None:
        counts["environment"] = 1
    if triangles := lamp_triangles(scene):
        counts["emitting triangle"] = triangles
    found = {noun: number for noun, number in counts.items() if number} or {"point light": 0}
    return ", ".join(f"{number:,} {noun}{'' if number == 1 else 's'}" for noun, number in found.items())


def lamp_triangles(scene: Scene) -> int:
    """Number of triangles that emit light."""
    emission = scene.materials.emission
    return 0 if emission is None else int(np.any(emission > 0, axis=1).take(scene.mesh.material_id).sum())


def path_passes(scene: Scene) -> tuple[tuple[str, str], ...]:
    """Passes that run, and what they cost in rays per sample."""
    from raytrace.scene.path_costs import ROULETTE_FROM, meets_light, most_rays

    depth, path = scene.settings.max_depth, scene.settings.integrator == "path"
    kinds = set(scene.materials.kind[_used(scene)].tolist())
    until = f"up to depth {depth}, with Russian roulette from depth {ROULETTE_FROM}"
    most = most_rays(scene)
    rows = [("camera", "one ray per sample")]
    rows.append(("closest hit", f"one query per ray, at most {most.closest:.3g} per sample on average"))
    if lamp_triangles(scene) or scene.lights.environment is not None:
        rows.append(("emission", "light that paths meet, weighted by multiple importance sampling"))
    if scene.background.any() and scene.lights.environment is None:
        rows.append(("background", "seen through perfectly specular surfaces only"))
    rows.append(("surface", "points and normals where paths meet surfaces"))
    if not kinds.isdisjoint(SCATTERING) and _lit(scene):
        rows.append(("light", "one light per surface that scatters, drawn by its power, and a point on it"))
        text = f"one ray per surface that scatters, at most {most.shadow:.3g} per sample on average"
        if scene.materials.transparent_shadow[_used(scene)].any():
            text += ", each through two trees: with and without transparent surfaces"
        rows.append(("shadow", text))
    for kind in sorted(kinds):
        goes = f"one ray more per hit, at most {most.closest - 1:.3g} per sample on average, {until}"
        if kind in SCATTERING and not path:
            goes = "one ray more, which looks for light" if meets_light(scene) else "no ray more: the path ends"
        rows.append((NAMES[kind], goes))
    rows.append(("roulette", "paths of low throughput end by chance; those that have ended drop out"))
    return (*rows, ("film", "twelve sums per pixel: three channels in four bins"))


def _lit(scene: Scene) -> bool:
    lights = scene.lights
    others = (lights.spots, lights.directions, lights.environment)
    return bool(len(lights.flux) or lamp_triangles(scene) or any(other is not None for other in others))


def path_left_out(scene: Scene) -> tuple[tuple[str, str], ...]:
    """What does not run, and why."""
    kinds, lights = set(scene.materials.kind[_used(scene)].tolist()), scene.lights
    scatters = not kinds.isdisjoint(SCATTERING)
    rows = [
        ("light and shadow passes", "there is no light, or nothing that scatters it", scatters and _lit(scene)),
        ("sampling of lamps", "no surface emits", lamp_triangles(scene) > 0),
        ("sampling of spot lights", "there is none", lights.spots is not None),
        ("sampling of directional lights", "there is none", lights.directions is not None),
        ("sampling of an environment", "there is none", lights.environment is not None),
        *((f"{name} pass", f"no surface is of type {name}", kind in kinds) for kind, name in NAMES.items()),
        ("indirect light", 'the integrator is "direct"', scene.settings.integrator == "path"),
        ("normal interpolation", "all meshes are flat", scene.mesh.normals is not None),
        ("layers (AOVs)", "stored only when asked for", False),
    ]
    if scene.materials.transparent_shadow[_used(scene)].any():
        rows.append(("bending of shadow rays", 'a material has "shadows": "transparent", which is not physical', False))
    rows += [(f"roughness of {name}", why, False) for name, why in _smoothed(scene)]
    return tuple((what, why) for what, why, needed in rows if not needed)


def _smoothed(scene: Scene) -> Iterator[tuple[str, str]]:
    """Materials whose alpha has no effect, and why."""
    table = scene.materials
    if table.alpha is None:
        return
    for row in _used(scene).tolist():
        alpha = float(table.alpha[row])
        if alpha > 0 and table.kind[row] in (DIELECTRIC, CONDUCTOR):
            small = f"alpha {alpha:g} is below {MIN_ALPHA:g}"
            why = small if alpha < MIN_ALPHA else "its ior is 1, which bends no light"
            yield table.name[row], f"{why}: the surface is smooth"
