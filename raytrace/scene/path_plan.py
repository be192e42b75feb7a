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
from raytrace.texture_records import ATTRIBUTE, BILINEAR, CHECKERBOARD, NEAREST

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
    others = (scene.materials.emission, lights.spots, lights.directions, lights.environment, scene.textures)
    kinds = scene.materials.kind[_used(scene)]
    simple = bool(((kinds == DIFFUSE) | (kinds == REFRACTIVE)).all())
    return integrator == "path" or needs_lens(scene) or not simple or any(other is not None for other in others)


def needs_lens(scene: Scene) -> bool:
    """Whether rays need more than a pinhole and a box filter."""
    camera = scene.camera
    return camera.aperture > 0 or camera.height is not None or scene.settings.filter != "box"


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
        counts["environment" if lights.image is None else "environment image"] = 1
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
    rows = [("camera", f"one ray per sample{_camera_words(scene)}")]
    rows.append(("closest hit", f"one query per ray, at most {most.closest:.3g} per sample on average"))
    if lamp_triangles(scene) or scene.lights.environment is not None:
        rows.append(("emission", "light that paths meet, weighted by multiple importance sampling"))
    if scene.background.any() and scene.lights.environment is None:
        rows.append(("background", "seen through perfectly specular surfaces only"))
    rows.append(("surface", "points and normals where paths meet surfaces"))
    if scene.textures is not None and (scene.textures.reflectance >= 0).any():
        rows.append(("texture", f"the reflectance there, of {texture_words(scene)}"))
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


def _camera_words(scene: Scene) -> str:
    """What a camera has beside a pinhole, in words."""
    camera, words = scene.camera, []
    if camera.aperture > 0:
        words.append(f"through a lens of radius {camera.aperture:g}, in focus at {camera.focus:.4g}")
    if camera.height is not None:
        words.append(f"parallel, over a height of {camera.height:g}")
    if scene.settings.filter != "box":
        words.append(f"with positions by the {scene.settings.filter} filter")
    return "".join(f", {each}" for each in words)


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
        (
            "lookup of an environment image",
            "the environment is constant",
            lights.image is not None or lights.environment is None,
        ),
        ("lens", "the camera is a pinhole", scene.camera.aperture > 0),
        ("filter", "the film's filter is a box", scene.settings.filter != "box"),
        *((f"{name} pass", f"no surface is of type {name}", kind in kinds) for kind, name in NAMES.items()),
        ("indirect light", 'the integrator is "direct"', scene.settings.integrator == "path"),
        ("normal interpolation", "all meshes are flat", scene.mesh.normals is not None),
        *_textures_left_out(scene),
        ("layers (AOVs)", "stored only when asked for", False),
    ]
    if scene.materials.transparent_shadow[_used(scene)].any():
        rows.append(("bending of shadow rays", 'a material has "shadows": "transparent", which is not physical', False))
    rows += [(f"roughness of {name}", why, False) for name, why in _smoothed(scene)]
    return tuple((what, why) for what, why, needed in rows if not needed)


def texture_words(scene: Scene) -> str:
    """The textures of a scene in words."""
    assert scene.textures is not None
    kinds = [texture.kind for texture in scene.textures.table]
    words = {
        "image": kinds.count(BILINEAR) + kinds.count(NEAREST),
        "checkerboard": kinds.count(CHECKERBOARD),
        "material with vertex colours": kinds.count(ATTRIBUTE),
    }
    texels = sum(texture.codes.size // 3 for texture in scene.textures.table if texture.kind in (BILINEAR, NEAREST))
    counted = {noun: number for noun, number in words.items() if number}
    plural = {"material with vertex colours": "materials with vertex colours"}
    found = [f"{number} {noun if number == 1 else plural.get(noun, noun + 's')}" for noun, number in counted.items()]
    return ", ".join(found) + (f"; {texels:,} texels" if texels else "")


def _textures_left_out(scene: Scene) -> tuple[tuple[str, str, bool], ...]:
    if scene.textures is None:
        return (("textures", "no material has one", False),)
    kinds = {texture.kind for texture in scene.textures.table}
    return (
        ("texture pass", "no albedo or reflectance is a texture", bool((scene.textures.reflectance >= 0).any())),
        ("textures of lamps", "no emission is a texture", bool((scene.textures.emission >= 0).any())),
        ("images and checkerboards", "all textures are vertex colours", kinds != {ATTRIBUTE}),
        ("vertex colours", "no texture looks them up", ATTRIBUTE in kinds),
    )


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
