"""Render our scenes with Mitsuba 3: the same meshes, camera, point lights, lamps and box filter."""

from collections.abc import Callable
from typing import Any

import numpy as np
from peers import mitsuba

from raytrace.passes.paths import ROULETTE_FROM
from raytrace.records import REFRACTIVE, Scene


def integrator(scene: Scene) -> dict[str, Any]:
    """Mitsuba's own for all light, or for direct light with one shadow ray a sample; with refractive surfaces, ours."""
    if scene.settings.integrator == "path":  # its depth counts the camera's ray too
        return {"type": "path", "max_depth": scene.settings.max_depth + 1, "rr_depth": ROULETTE_FROM}
    iors = set(scene.materials.ior[scene.materials.kind == REFRACTIVE].tolist())
    if not iors:
        return {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    (ior,) = iors  # one is enough for the scenes that are compared
    mitsuba().register_integrator("through", lambda properties: _through()(properties))
    return {"type": "through", "ior": ior, "max_depth": scene.settings.max_depth}


def _through() -> type:
    """Direct light seen through ideal interfaces: Mitsuba's own integrators split light there by Fresnel.

    It is written in Mitsuba's rays, samplers, lights and materials, and compiled by it into one loop.
    """
    import drjit as dr

    mi = mitsuba()

    class Through(mi.SamplingIntegrator):  # type: ignore[misc, name-defined]
        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.ior, self.depth = properties["ior"], properties["max_depth"]
            self.modules = mi, dr  # the function below is compiled anew, and knows no names but its own

        @dr.syntax
        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            mi, dr = self.modules
            ray, depth = mi.Ray3f(ray), mi.UInt32(1)
            hit = scene.ray_intersect(ray, active)
            on = active & hit.is_valid() & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.DeltaTransmission)
            while on & (depth < self.depth):
                reflected, cos_t, _, eta_ti = mi.fresnel(mi.Frame3f.cos_theta(hit.wi), self.ior)
                wo = dr.select(reflected == 1, mi.reflect(hit.wi), mi.refract(hit.wi, cos_t, eta_ti))
                ray = hit.spawn_ray(hit.to_world(wo))
                hit = scene.ray_intersect(ray, on)
                on &= hit.is_valid() & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.DeltaTransmission)
                depth += 1
            lit = active & hit.is_valid() & ~on
            light, weight = scene.sample_emitter_direction(hit, sampler.next_2d(lit), True, lit)
            value = hit.bsdf().eval(mi.BSDFContext(), hit, hit.to_local(light.d), lit)
            return dr.select(lit, value * weight, 0.0), active, []

    return Through


def peer_scene(scene: Scene, size: tuple[int, int], sampler: str = "independent") -> Any:
    """Return the scene as Mitsuba's own objects."""
    mi = mitsuba()
    camera, materials = scene.camera, scene.materials
    look = mi.ScalarTransform4f().look_at(*(a.tolist() for a in (camera.position, camera.look_at, camera.up)))
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb", "rfilter": {"type": "box"}}
    content = {
        "type": "scene",
        "integrator": integrator(scene),
        "camera": {"type": "perspective", "fov": camera.fov, "fov_axis": "y", "to_world": look, "film": film,
                   "sampler": {"type": sampler}},
    }  # fmt: skip
    for k, (position, flux) in enumerate(zip(scene.lights.position, scene.lights.flux, strict=True)):
        intensity = {"type": "rgb", "value": (flux / (4 * np.pi)).tolist()}
        content[f"light{k}"] = {"type": "point", "position": position.tolist(), "intensity": intensity}
    for k in np.unique(scene.mesh.material_id):
        bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": materials.albedo[k].tolist()}}
        if materials.kind[k] == REFRACTIVE:
            bsdf = {"type": "dielectric", "int_ior": float(materials.ior[k]), "ext_ior": 1.0}
        emission = None if materials.emission is None else materials.emission[k]
        faces = scene.mesh.faces[scene.mesh.material_id == k]
        content[f"mesh{k}"] = _peer_mesh(scene.mesh.vertices, faces, bsdf, emission)
    return mi.load_dict(content)


def _peer_mesh(vertices: np.ndarray, faces: np.ndarray, bsdf: dict[str, Any], emission: np.ndarray | None) -> Any:
    mi = mitsuba()
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    if emission is not None and emission.any():
        radiance = {"type": "rgb", "value": emission.tolist()}
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": radiance})
    mesh = mi.Mesh("mesh", len(vertices), len(faces), props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(vertices.ravel().astype("f4"))
    parameters["faces"] = mi.UInt32(faces.ravel().astype("u4"))
    parameters.update()
    return mesh


def peer_picture(scene: Scene, size: tuple[int, int], sampler: str = "independent") -> Callable[[int, int], Any]:
    """Return a function that renders an image, given samples per pixel and a seed."""
    import drjit as dr

    mi, loaded = mitsuba(), peer_scene(scene, size, sampler)

    def draw(spp: int, seed: int) -> Any:
        image = mi.render(loaded, spp=spp, seed=seed)
        dr.eval(image)
        dr.sync_thread()
        return image

    return draw
