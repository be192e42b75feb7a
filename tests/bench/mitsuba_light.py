"""Path-traced scenes as Mitsuba's own objects: the same meshes, lights, materials and camera, and its ``path``."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from peers import mitsuba

from raytrace.records import (
    CONDUCTOR,
    DIELECTRIC,
    DIFFUSE,
    MIRROR,
    PLASTIC,
    ROUGH_CONDUCTOR,
    ROUGH_DIELECTRIC,
    Camera,
    Lights,
    Scene,
)  # fmt: skip
from raytrace.rendering.environment_table import radiance_of
from raytrace.texture_records import ATTRIBUTE, CHECKERBOARD, NEAREST, EnvironmentImage


def rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": np.asarray(value, float).tolist()}


def texture(scene: Scene, row: int) -> dict[str, Any]:
    """A texture; row 0 of Mitsuba's bitmaps is at v = 0, as ours is."""
    assert scene.textures is not None
    mi, made = mitsuba(), scene.textures.table[row]
    u, v = made.scale
    if made.kind == ATTRIBUTE:
        return {"type": "mesh_attribute", "name": "vertex_color"}
    if made.kind == CHECKERBOARD:
        squares = mi.ScalarTransform3f().scale([u / 2, v / 2])
        return {"type": "checkerboard", "color0": rgb(made.codes[0, 0]), "color1": rgb(made.codes[0, 1])} | {
            "to_uv": squares
        }
    values = np.empty((made.codes.size // 3, 3), np.float32)
    made.values(out=values)
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(values.reshape(made.codes.shape)),
        "raw": True,
        "filter_type": "nearest" if made.kind == NEAREST else "bilinear",
        "to_uv": mi.ScalarTransform3f().scale([u, v]),
    }


def colour(scene: Scene, k: int, emits: bool = False) -> dict[str, Any]:
    """The albedo of material k, or its emission."""
    rows = None if scene.textures is None else (scene.textures.emission if emits else scene.textures.reflectance)
    values = scene.materials.emission if emits else scene.materials.albedo
    assert values is not None
    return rgb(values[k]) if rows is None or rows[k] < 0 else texture(scene, int(rows[k]))


def bsdf(scene: Scene, k: int) -> dict[str, Any]:
    """Material k; Mitsuba's diffuse is black from behind, as ours is without ``two_sided``."""
    table = scene.materials
    kind = table.kind[k]
    rough = {"distribution": "ggx", "alpha": 0.0 if table.alpha is None else float(table.alpha[k])}
    if kind in (DIFFUSE, PLASTIC):
        inner = {"type": "diffuse", "reflectance": colour(scene, k)}
        if kind == PLASTIC:
            coat = {"int_ior": float(table.ior[k]), "ext_ior": 1.0, "nonlinear": True}
            inner = {"type": "plastic", "diffuse_reflectance": colour(scene, k), **coat}
        return {"type": "twosided", "inner": inner} if table.two_sided[k] else inner
    if kind == ROUGH_DIELECTRIC:
        return {"type": "roughdielectric", "int_ior": float(table.ior[k]), "ext_ior": 1.0, **rough}
    if kind == ROUGH_CONDUCTOR:
        assert table.eta is not None
        assert table.k is not None
        index = {"eta": rgb(table.eta[k]), "k": rgb(table.k[k])}
        return {"type": "twosided", "inner": {"type": "roughconductor", **index, **rough}}
    if kind == MIRROR:
        inner = {"type": "conductor", "material": "none", "specular_reflectance": rgb(table.albedo[k])}
        return {"type": "twosided", "inner": inner}
    if kind == CONDUCTOR:
        assert table.eta is not None
        assert table.k is not None
        return {"type": "twosided", "inner": {"type": "conductor", "eta": rgb(table.eta[k]), "k": rgb(table.k[k])}}
    if kind == DIELECTRIC:
        return {"type": "dielectric", "int_ior": float(table.ior[k]), "ext_ior": 1.0}
    raise SystemExit(f"Mitsuba has no material of kind {kind}")


def emitters(lights: Lights) -> dict[str, Any]:
    mi, found = mitsuba(), dict[str, Any]()
    for k, (position, flux) in enumerate(zip(lights.position, lights.flux, strict=True)):
        found[f"point{k}"] = {"type": "point", "position": position.tolist(), "intensity": rgb(flux / (4 * np.pi))}
    if lights.spots is not None:
        for k, (position, axis, intensity, cutoff, beam) in enumerate(zip(*lights.spots, strict=True)):
            up = [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0]
            found[f"spot{k}"] = {
                "type": "spot",
                "to_world": mi.ScalarTransform4f().look_at(position.tolist(), (position + axis).tolist(), up),
                "intensity": rgb(intensity),
                "cutoff_angle": float(np.degrees(cutoff)),
                "beam_width": float(np.degrees(beam)),
            }
    if lights.directions is not None:
        for k, (direction, irradiance) in enumerate(zip(*lights.directions, strict=True)):
            found[f"sun{k}"] = {"type": "directional", "direction": direction.tolist(), "irradiance": rgb(irradiance)}
    if lights.image is not None:
        found["sky"] = sky(lights.image)
    elif lights.environment is not None:
        found["sky"] = {"type": "constant", "radiance": rgb(lights.environment)}
    return found


def sky(image: EnvironmentImage) -> dict[str, Any]:
    """An environment image of 2 h + 1 rows, at the centres of ours and halfway between them."""
    mi, texels = mitsuba(), radiance_of(image, np.float32)
    height = len(texels)
    rows = np.clip((np.arange(2 * height + 1) - 1) / 2, 0, height - 1)
    low, high = np.floor(rows).astype(int), np.ceil(rows).astype(int)
    world = np.eye(4)
    world[:3, :3] = image.turn
    bitmap = mi.Bitmap(np.ascontiguousarray((texels[low] + texels[high]) / 2))
    return {"type": "envmap", "bitmap": bitmap, "to_world": mi.ScalarTransform4f(world)}


def meshes(scene: Scene, folder: Path) -> dict[str, Any]:
    """A mesh per material, with vertices of its own for each triangle, written to files."""
    mi, mesh, found = mitsuba(), scene.mesh, dict[str, Any]()
    for k in np.unique(mesh.material_id):
        mine = mesh.material_id == k
        corners = mesh.vertices[mesh.faces[mine]].reshape(-1, 3)
        written = mi.Mesh(
            "mesh",
            len(corners),
            len(corners) // 3,
            has_vertex_normals=mesh.normals is not None,
            has_vertex_texcoords=mesh.uv is not None,
        )
        if mesh.colors is not None and not np.isnan(mesh.colors[mine]).any():
            written.add_attribute("vertex_color", 3, mesh.colors[mine].ravel().astype("f4"))
        parameters = mi.traverse(written)
        parameters["vertex_positions"] = mi.Float(corners.ravel().astype("f4"))
        parameters["faces"] = mi.UInt32(np.arange(len(corners), dtype="u4"))
        if mesh.normals is not None:
            parameters["vertex_normals"] = mi.Float(mesh.normals[mine].ravel().astype("f4"))
        if mesh.uv is not None:
            parameters["vertex_texcoords"] = mi.Float(np.nan_to_num(mesh.uv[mine]).ravel().astype("f4"))
        parameters.update()
        path = folder / f"{k}.ply"
        written.write_ply(str(path))
        shape = {"type": "ply", "filename": str(path), "face_normals": mesh.normals is None, "bsdf": bsdf(scene, k)}
        emission = scene.materials.emission
        if emission is not None and emission[k].any():
            shape["lamp"] = {"type": "area", "radiance": colour(scene, int(k), emits=True)}
        found[f"mesh{k}"] = shape
    return found


def sensor(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """A pinhole, a thin lens, or an orthographic camera."""
    mi = mitsuba()
    look = mi.ScalarTransform4f().look_at(*(a.tolist() for a in (camera.position, camera.look_at, camera.up)))
    near = {"near_clip": 1e-3, "far_clip": 1e5}
    if camera.height is not None:
        half = camera.height / 2 * size[0] / size[1]
        return {"type": "orthographic", "to_world": look @ mi.ScalarTransform4f().scale([half, half, 1]), **near}
    pinhole = {"type": "perspective", "fov": camera.fov, "fov_axis": "y", "to_world": look, **near}
    if camera.aperture > 0:
        lens = {"type": "thinlens", "aperture_radius": camera.aperture, "focus_distance": camera.focus}
        return pinhole | lens
    return pinhole


def peer(scene: Scene, size: tuple[int, int]) -> Callable[[int, int], np.ndarray]:
    """Return a function that renders an image (h, w, 3), given samples per pixel and a seed."""
    mi = mitsuba()
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb", "rfilter": {"type": "box"}}
    with tempfile.TemporaryDirectory() as folder:
        content = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": scene.settings.max_depth + 1, "rr_depth": 10**6},
            "camera": {
                **sensor(scene.camera, size),
                "film": film,
                "sampler": {"type": "independent"},
            },
            **emitters(scene.lights),
            **meshes(scene, Path(folder)),
        }
        loaded = mi.load_dict(content)
    return lambda spp, seed: np.array(mi.render(loaded, spp=spp, seed=seed), np.float64)
