"""Scenes for Mitsuba 3: an XML file, with meshes as PLY and images as PNG and EXR.

What Mitsuba has otherwise than this project, and what is written for it:

- its ``max_depth`` counts the camera's ray too: ours plus one;
- row j of an environment's image lies at v = j / (h - 1): the rows are resampled (`images.rows_at_ends`);
- the squares of its checkerboard have the side 1/2: the scale of uv is halved;
- v = 0 is the first row of an image: the scale of v is negated, because our images are upright;
- its conductors are black from behind, ours reflect on both sides: they are ``twosided``;
- Russian roulette is left to the estimator of the other renderer, and practically off (`NO_ROULETTE`).
"""

from typing import Any

import numpy as np

from raytrace.exporting.common import Contents, needs_path, shared_differences
from raytrace.exporting.differences import Differences
from raytrace.exporting.images import exr_bytes, radiance_of, rows_at_ends
from raytrace.exporting.meshes import Part, parts_of, ply_bytes
from raytrace.exporting.mitsuba_materials import Materials
from raytrace.exporting.xml import Element, document, plugin, put, transform
from raytrace.records import Camera, Lights, Scene

NO_ROULETTE = 1_000_000  # depth from which paths end by chance
NEAR, FAR = 1e-5, 1e3  # of the extent of the scene: nothing that a camera sees is nearer or farther


def export(scene: Scene, name: str, differences: Differences) -> Contents:
    """Return the files of a scene, by their paths in the folder; the first one is the scene."""
    parts = list(parts_of(scene))
    shared_differences(scene, parts, differences)
    materials = Materials(scene, differences)
    files: Contents = {}
    shapes = []
    for part in parts:
        path = f"meshes/{part.name}.ply"
        files[path] = ply_bytes(part)
        shapes.append(_shape(part, path, materials))
    root = Element("scene", {"version": "3.0.0"})
    root.append(_integrator(scene))
    root.append(_sensor(scene))
    root.extend(materials.elements)
    root.extend(_emitters(scene.lights, files))
    root.extend(shapes)
    about = f"{scene.about or name}: exported by raytrace for Mitsuba 3 (an rgb variant)"
    return {f"{name}.xml": document(root, about), **files, **materials.files}


def _integrator(scene: Scene) -> Element:
    """Return the path tracer; ``direct`` without specular surfaces is one of one surface."""
    depth = scene.settings.max_depth if needs_path(scene) else 1
    return plugin(
        "integrator", "path", [put("integer", "max_depth", depth + 1), put("integer", "rr_depth", NO_ROULETTE)]
    )


def _sensor(scene: Scene) -> Element:
    camera, (width, height) = scene.camera, scene.settings.size
    look = {"origin": camera.position, "target": camera.look_at, "up": camera.up}
    steps: list[tuple[str, dict[str, Any]]] = [("lookat", look)]
    extent = _extent(scene)
    parameters = [put("float", "near_clip", NEAR * extent), put("float", "far_clip", FAR * extent)]
    kind = "perspective"
    if camera.height is not None:
        kind, half = "orthographic", camera.height / 2 * width / height
        steps.insert(0, ("scale", {"x": half, "y": half, "z": 1.0}))
    else:
        parameters += [put("string", "fov_axis", "y"), put("float", "fov", camera.fov)]
        if camera.aperture > 0:
            kind = "thinlens"
            parameters += _lens(camera)
    film = plugin(
        "film",
        "hdrfilm",
        [
            put("integer", "width", width),
            put("integer", "height", height),
            put("string", "pixel_format", "rgb"),
            put("string", "component_format", "float32"),
            *_filter(scene.settings.filter),
        ],
    )
    sampler = plugin("sampler", "independent", [put("integer", "sample_count", scene.settings.spp)])
    return plugin("sensor", kind, [transform("to_world", *steps), *parameters, sampler, film])


def _lens(camera: Camera) -> list[Element]:
    return [put("float", "aperture_radius", camera.aperture), put("float", "focus_distance", camera.focus)]


def _extent(scene: Scene) -> float:
    """Return the largest side of the box around the meshes and the camera."""
    points = np.concatenate([scene.mesh.vertices[scene.mesh.faces].reshape(-1, 3), scene.camera.position[None]])
    return float((points.max(axis=0) - points.min(axis=0)).max()) or 1.0


def _filter(name: str) -> list[Element]:
    """Return the filter of the film; samples beyond its border count too, as ours do."""
    if name == "box":
        return [plugin("rfilter", "box")]
    own = [put("float", "stddev", 0.5)] if name == "gaussian" else [put("float", "radius", 1.0)]
    return [put("boolean", "sample_border", True), plugin("rfilter", name, own)]


def _emitters(lights: Lights, files: Contents) -> list[Element]:
    """Return all lights that are no surfaces."""
    found = []
    for position, flux in zip(lights.position, lights.flux, strict=True):
        intensity = put("rgb", "intensity", flux / (4 * np.pi))
        found.append(plugin("emitter", "point", [_point("position", position), intensity]))
    if lights.spots is not None:
        for position, axis, intensity, cutoff, beam in zip(*lights.spots, strict=True):
            up = [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0]
            look = {"origin": position, "target": position + axis, "up": up}
            angles = [
                put("float", "cutoff_angle", np.degrees(cutoff)),
                put("float", "beam_width", np.degrees(beam)),
            ]
            light = [transform("to_world", ("lookat", look)), put("rgb", "intensity", intensity), *angles]
            found.append(plugin("emitter", "spot", light))
    if lights.directions is not None:
        for direction, irradiance in zip(*lights.directions, strict=True):
            light = [put("vector", "direction", direction), put("rgb", "irradiance", irradiance)]
            found.append(plugin("emitter", "directional", light))
    if lights.image is not None:
        path, world = "textures/environment.exr", np.eye(4)
        files[path] = exr_bytes(rows_at_ends(radiance_of(lights.image)))
        world[:3, :3] = lights.image.turn
        turn = transform("to_world", ("matrix", {"value": world}))
        found.append(plugin("emitter", "envmap", [put("string", "filename", path), turn]))
    elif lights.environment is not None:
        found.append(plugin("emitter", "constant", [put("rgb", "radiance", lights.environment)]))
    return found


def _point(name: str, position: np.ndarray) -> Element:
    x, y, z = (repr(float(value)) for value in position)
    return Element("point", {"name": name, "x": x, "y": y, "z": z})


def _shape(part: Part, path: str, materials: Materials) -> Element:
    """Return a mesh with its material, and its emission."""
    children = [
        put("string", "filename", path),
        put("boolean", "face_normals", part.normals is None),
        Element("ref", {"id": materials.name_of(part.material)}),
    ]
    radiance = materials.emission_of(part.material)
    if radiance is not None:
        children.append(plugin("emitter", "area", [radiance]))
    return plugin("shape", "ply", children)
