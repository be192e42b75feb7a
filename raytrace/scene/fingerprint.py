"""The hash of a scene: of everything that affects the light in it, not of names, sampling options or file paths."""

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from raytrace.records import Scene

LEFT_OUT = "Materials.name", "Mesh.object_id"


def fingerprint(scene: "Scene") -> str:
    """Return the SHA-256 of camera, filter, depth, background, materials, textures, lights and meshes, hexadecimal."""
    camera, digest = scene.camera, hashlib.sha256()
    content = {"fov": camera.fov, "max_depth": scene.settings.max_depth, "background": scene.background}
    content |= {"position": camera.position, "look_at": camera.look_at, "up": camera.up}
    if camera.aperture > 0:
        content |= {"aperture": camera.aperture, "focus": camera.focus}
    if camera.height is not None:
        content["height"] = camera.height
    if scene.settings.filter != "box":
        content["filter"] = np.frombuffer(scene.settings.filter.encode(), np.uint8)
    if scene.settings.integrator != "direct":
        content["integrator"] = np.frombuffer(scene.settings.integrator.encode(), np.uint8)
    others = [record for record in (scene.lights.spots, scene.lights.directions) if record is not None]
    for record in (scene.materials, scene.lights, scene.mesh, *others):
        content |= {f"{type(record).__name__}.{key}": value for key, value in record._asdict().items()}
    if scene.textures is not None:
        records = {"Textures": scene.textures} | {f"Texture{i}": each for i, each in enumerate(scene.textures.table)}
        content |= {f"{name}.{key}": value for name, each in records.items() for key, value in each._asdict().items()}
        content |= {f"Texture{i}.scale": np.array(each.scale) for i, each in enumerate(scene.textures.table)}
    if (image := scene.lights.image) is not None:
        content |= {f"EnvironmentImage.{key}": value for key, value in image.texture._asdict().items()}
        content |= {"EnvironmentImage.scale": image.scale, "EnvironmentImage.turn": image.turn}
    for key, value in content.items():
        if key not in LEFT_OUT and value is not None and not isinstance(value, tuple):
            array = np.ascontiguousarray(value)
            digest.update(f"{key} {array.dtype.str} {array.shape}".encode())
            digest.update(array.astype(array.dtype.newbyteorder("<"), copy=False).data)
    return digest.hexdigest()
