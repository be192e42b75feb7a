"""Path-traced scenes as Mitsuba's own objects: the same meshes, lights, materials and camera, and its ``path``."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from peers import mitsuba

from raytrace.records import CONDUCTOR, DIELECTRIC, DIFFUSE, MIRROR, Lights, Scene


def rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": np.asarray(value, float).tolist()}


def bsdf(scene: Scene, k: int) -> dict[str, Any]:
    """Material k; Mitsuba's diffuse is black from behind, as ours is without ``two_sided``."""
    table = scene.materials
    kind = table.kind[k]
    if kind == DIFFUSE:
        inner = {"type": "diffuse", "reflectance": rgb(table.albedo[k])}
        return {"type": "twosided", "inner": inner} if table.two_sided[k] else inner
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
    if lights.environment is not None:
        found["sky"] = {"type": "constant", "radiance": rgb(lights.environment)}
    return found


def meshes(scene: Scene, folder: Path) -> dict[str, Any]:
    """A mesh per material, with vertices of its own for each triangle, written to files."""
    mi, mesh, found = mitsuba(), scene.mesh, dict[str, Any]()
    for k in np.unique(mesh.material_id):
        mine = mesh.material_id == k
        corners = mesh.vertices[mesh.faces[mine]].reshape(-1, 3)
        written = mi.Mesh("mesh", len(corners), len(corners) // 3, has_vertex_normals=mesh.normals is not None)
        parameters = mi.traverse(written)
        parameters["vertex_positions"] = mi.Float(corners.ravel().astype("f4"))
        parameters["faces"] = mi.UInt32(np.arange(len(corners), dtype="u4"))
        if mesh.normals is not None:
            parameters["vertex_normals"] = mi.Float(mesh.normals[mine].ravel().astype("f4"))
        parameters.update()
        path = folder / f"{k}.ply"
        written.write_ply(str(path))
        shape = {"type": "ply", "filename": str(path), "face_normals": mesh.normals is None, "bsdf": bsdf(scene, k)}
        emission = scene.materials.emission
        if emission is not None and emission[k].any():
            shape["lamp"] = {"type": "area", "radiance": rgb(emission[k])}
        found[f"mesh{k}"] = shape
    return found


def peer(scene: Scene, size: tuple[int, int]) -> Callable[[int, int], np.ndarray]:
    """Return a function that renders an image (h, w, 3), given samples per pixel and a seed."""
    mi, camera = mitsuba(), scene.camera
    look = mi.ScalarTransform4f().look_at(*(a.tolist() for a in (camera.position, camera.look_at, camera.up)))
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb", "rfilter": {"type": "box"}}
    with tempfile.TemporaryDirectory() as folder:
        content = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": scene.settings.max_depth + 1, "rr_depth": 10**6},
            "camera": {
                "type": "perspective",
                "fov": camera.fov,
                "fov_axis": "y",
                "near_clip": 1e-3,
                "far_clip": 1e5,
                "to_world": look,
                "film": film,
                "sampler": {"type": "independent"},
            },
            **emitters(scene.lights),
            **meshes(scene, Path(folder)),
        }
        loaded = mi.load_dict(content)
    return lambda spp, seed: np.array(mi.render(loaded, spp=spp, seed=seed), np.float64)
