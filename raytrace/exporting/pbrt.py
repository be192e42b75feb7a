"""Scenes for pbrt-v4: a ``.pbrt`` file, with meshes as PLY and images as PNG and EXR.

What pbrt has otherwise than this project, and what is written for it:

- its camera space is left-handed: ``Scale -1 1 1`` before ``LookAt``;
- ``fov`` is that of the shorter side: a ``screenwindow`` of height 2 makes it the vertical one;
- ``maxdepth`` is ours;
- environments are equal-area squares: the image is resampled, in world space (`images.equal_area_square`);
- textures are filtered by the footprint of a ray: this is switched off;
- the default sensor has the imaging ratio 1: an RGB value of a light appears as it is in the image;
- EXR files have half the precision by default: ``savefp16`` is false;
- light is a spectrum, made from RGB. One reflection of white light has exactly the given colour; products of colours
  differ a little from those of RGB.
"""

import numpy as np

from raytrace.exporting.common import Contents, needs_path, shared_differences
from raytrace.exporting.differences import Differences
from raytrace.exporting.images import equal_area_square, exr_bytes
from raytrace.exporting.meshes import Part, parts_of, ply_bytes
from raytrace.exporting.pbrt_materials import Materials
from raytrace.exporting.pbrt_text import comment, directive, numbers, parameter
from raytrace.records import Camera, Lights, Scene


def export(scene: Scene, name: str, differences: Differences) -> Contents:
    """Return the files of a scene, by their paths in the folder; the first one is the scene."""
    parts = list(parts_of(scene))
    shared_differences(scene, parts, differences)
    files: Contents = {}
    materials = Materials(scene, parts, differences)
    lines = [comment(f"{scene.about or name}: exported by raytrace for pbrt-v4"), ""]
    lines += ['Option "disabletexturefiltering" true', *_settings(scene, name), *_camera(scene), "", "WorldBegin", ""]
    lines += materials.directives
    lines += _lights(scene.lights, files, differences)
    for part in parts:
        path = f"meshes/{part.name}.ply"
        files[path] = ply_bytes(part)
        lines += _shape(part, path, materials)
    return {f"{name}.pbrt": ("\n".join(lines) + "\n").encode(), **files, **materials.files}


def _settings(scene: Scene, name: str) -> list[str]:
    """Return integrator, sampler, filter and film."""
    settings, (width, height) = scene.settings, scene.settings.size
    depth = settings.max_depth if needs_path(scene) else 1
    film = [
        parameter("integer", "xresolution", width),
        parameter("integer", "yresolution", height),
        parameter("string", "filename", f"{name}.exr"),
        parameter("bool", "savefp16", False),
    ]
    return [
        directive("Integrator", "path", [parameter("integer", "maxdepth", depth)]),
        directive("Sampler", "independent", [parameter("integer", "pixelsamples", settings.spp)]),
        _filter(settings.filter),
        directive("Film", "rgb", film),
    ]


def _filter(name: str) -> str:
    radius = {"box": 0.5, "tent": 1.0, "gaussian": 2.0}[name]
    parameters = [parameter("float", axis, radius) for axis in ("xradius", "yradius")]
    if name == "gaussian":
        parameters.append(parameter("float", "sigma", 0.5))
    return directive("PixelFilter", {"tent": "triangle"}.get(name, name), parameters)


def _camera(scene: Scene) -> list[str]:
    camera: Camera = scene.camera
    across = scene.settings.size[0] / scene.settings.size[1]
    half = 1.0 if camera.height is None else camera.height / 2
    parameters = [parameter("float", "screenwindow", -across * half, across * half, -half, half)]
    if camera.height is None:
        parameters.append(parameter("float", "fov", camera.fov))
        if camera.aperture > 0:
            parameters.append(parameter("float", "lensradius", camera.aperture))
            parameters.append(parameter("float", "focaldistance", camera.focus))
    look = [numbers(point) for point in (camera.position, camera.look_at, camera.up)]
    kind = "perspective" if camera.height is None else "orthographic"
    return ["Scale -1 1 1", f"LookAt {'  '.join(look)}", directive("Camera", kind, parameters)]


def _lights(lights: Lights, files: Contents, differences: Differences) -> list[str]:
    """Return all lights that are no surfaces."""
    found = []
    for position, flux in zip(lights.position, lights.flux, strict=True):
        intensity = parameter("rgb", "I", *(flux / (4 * np.pi)))
        found.append(directive("LightSource", "point", [parameter("point3", "from", *position), intensity]))
    if lights.spots is not None:
        for position, axis, intensity, cutoff, beam in zip(*lights.spots, strict=True):
            if beam < cutoff:
                text = "pbrt has no spot that fades linearly in the angle"
                differences.add("lights.spot", text, "it fades by a cubic in the cosine")
            light = [parameter("point3", "from", *position), parameter("point3", "to", *(position + axis))]
            light += [parameter("rgb", "I", *intensity), parameter("float", "coneangle", np.degrees(cutoff))]
            light += [parameter("float", "conedeltaangle", np.degrees(cutoff - beam))]
            found.append(directive("LightSource", "spot", light))
    if lights.directions is not None:
        for direction, irradiance in zip(*lights.directions, strict=True):
            light = [parameter("point3", "from", *-direction), parameter("point3", "to", 0, 0, 0)]
            found.append(directive("LightSource", "distant", [*light, parameter("rgb", "L", *irradiance)]))
    if lights.image is not None:
        path = "textures/environment.exr"
        files[path] = exr_bytes(equal_area_square(lights.image))
        found.append(directive("LightSource", "infinite", [parameter("string", "filename", path)]))
    elif lights.environment is not None:
        found.append(directive("LightSource", "infinite", [parameter("rgb", "L", *lights.environment)]))
    return found


def _shape(part: Part, path: str, materials: Materials) -> list[str]:
    """Return a mesh with its material, and its emission."""
    lines = ["", "AttributeBegin", f'    NamedMaterial "{materials.name_of(part.material)}"']
    if emission := materials.emission_of(part.material):
        lines.append(directive("AreaLightSource", "diffuse", emission, "    "))
    lines.append(directive("Shape", "plymesh", [parameter("string", "filename", path)], "    "))
    return [*lines, "AttributeEnd"]
