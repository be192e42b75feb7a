"""A scene as path tracing uses it: its tree, its lights and its materials in one precision."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.passes import lights
from raytrace.passes.lens import Lens, make_lens
from raytrace.passes.path_records import EnvironmentTable, LightTable, Surfaces, TextureTable
from raytrace.records import CONDUCTOR, PLASTIC, ROUGH_CONDUCTOR, ROUGH_DIELECTRIC, SCATTERING, Scene, Shading
from raytrace.rendering.environment_table import make_environment_table
from raytrace.rendering.light_table import make_light_table
from raytrace.rendering.texture_table import make_texture_table
from raytrace.scene.path_plan import needs_lens


class PathScene(NamedTuple):
    """A scene as path tracing uses it, in one precision."""

    integrator: str  # "path"; "direct": a path ends after the first surface that scatters; "emission": before it
    max_depth: int
    bvh: BVH
    shadow_bvh: BVH  # the same, without the surfaces that shadow rays pass
    passed_bvh: BVH | None  # those surfaces alone; None: there are none, or no light that a path could find too
    shading: Shading
    normals: NDArray[np.floating] | None
    surfaces: Surfaces
    kinds: frozenset[int]  # of materials
    lights: LightTable | None
    light_kinds: frozenset[int]
    lamps: bool  # whether any surface emits
    environment: NDArray[np.floating] | None  # (4,) f: radiance, and the density of its sampling, 1 / sr
    image: EnvironmentTable | None  # None: the environment is constant
    background: NDArray[np.floating] | None  # (3,) f; None: black
    lens: Lens | None  # None: a pinhole, and a box filter
    textures: TextureTable | None = None  # None: no reflectance is a texture
    lamp_textures: TextureTable | None = None  # the same; None: no emission is a texture
    camera_bvh: BVH | None = None  # for the first rays; None: bvh

    def kernel_key(self) -> tuple[Any, ...]:
        """What decides which kernels this scene needs."""
        light = (
            self.light_kinds,
            self.lights is None,
            self.lamps,
            self.environment is None,
            self.image is None,
            self.lens is None,
            self.background is None,
        )
        tables = [table for table in (self.textures, self.lamp_textures) if table is not None]
        textures = tuple((table.uv is None, table.colors is None) for table in tables)
        kinds = self.textures is None, self.lamp_textures is None, *textures
        return (self.integrator, self.kinds, *light, self.passed_bvh is None, *kinds)


def make_path_scene(scene: Scene, bvh: BVH, integrator: str) -> PathScene:
    """Tables of a scene, for its tree."""
    dtype, mesh = bvh.triangles.dtype, scene.mesh
    used = np.flatnonzero(np.bincount(mesh.material_id))
    table = make_light_table(scene, bvh)
    stops = ~scene.materials.transparent_shadow[mesh.material_id]
    shadow, passed = bvh, None
    if not stops.all():
        kind = bvh.precision, bvh.split, bvh.triangle
        shadow = BVH(mesh.vertices, mesh.faces[stops], *kind)
        passed = BVH(mesh.vertices, mesh.faces[~stops], *kind)
    environment = None
    if scene.lights.environment is not None and table is not None:
        density = table.share[table.kind == lights.ENVIRONMENT].sum() / (4 * np.pi)
        environment = np.append(scene.lights.environment, density).astype(dtype)
    image = None
    if environment is not None and scene.lights.image is not None:
        image = make_environment_table(scene.lights.image, 4 * np.pi * density, dtype)
    textures = make_texture_table(scene, dtype)
    return PathScene(
        integrator,
        scene.settings.max_depth,
        bvh,
        shadow,
        passed,
        Shading(bvh.triangles.ravel(), mesh.material_id, np.zeros(0, dtype)),
        None if mesh.normals is None else mesh.normals.astype(dtype).ravel(),
        make_surfaces(scene, table, dtype),
        frozenset(scene.materials.kind[used].tolist()),
        table,
        frozenset() if table is None else frozenset(table.kind.tolist()),
        table is not None and bool((table.kind == lights.TRIANGLE).any()),
        environment,
        image,
        scene.background.astype(dtype) if scene.background.any() else None,
        lens_of(scene, dtype),
        textures if textures is not None and (textures.reflectance >= 0).any() else None,
        textures if textures is not None and (textures.emission >= 0).any() else None,
    )


def lens_of(scene: Scene, dtype: Any) -> Lens | None:
    """Lens and filter of a scene; None where it has a pinhole and a box filter."""
    return make_lens(scene.camera, scene.settings.filter, dtype) if needs_lens(scene) else None


def make_surfaces(scene: Scene, table: LightTable | None, dtype: np.dtype) -> Surfaces:
    """Table of the materials of a scene, and how densely its lamps are sampled."""
    given = scene.materials
    n = len(given.kind)
    emission = np.zeros((n, 3)) if given.emission is None else given.emission
    density = np.zeros(n)
    if table is not None:  # share / area is the same for all triangles of a material: pi L / power of all lights
        for row in np.flatnonzero(table.kind == lights.TRIANGLE)[::-1]:
            material = scene.mesh.material_id[table.prim_id[row]]
            density[material] = table.numbers.reshape(-1, lights.COLUMNS)[row, lights.DENSITY]
    eta = np.repeat(given.ior[:, None], 3, axis=1)
    if given.eta is not None:
        eta = np.where(np.isin(given.kind, (CONDUCTOR, ROUGH_CONDUCTOR))[:, None], given.eta, eta)
    return Surfaces(
        given.kind.astype(np.int32),
        given.albedo.astype(dtype).ravel(),
        emission.astype(dtype).ravel(),
        density.astype(dtype),
        eta.astype(dtype).ravel(),
        (np.zeros((n, 3)) if given.k is None else given.k).astype(dtype).ravel(),
        (given.two_sided | np.isin(given.kind, (ROUGH_DIELECTRIC, ROUGH_CONDUCTOR))).astype(np.int32),
        given.transparent_shadow.astype(np.int32),
        np.isin(given.kind, SCATTERING).astype(np.int32),
        (np.zeros(n) if given.alpha is None else given.alpha).astype(dtype),
        _escape(scene).astype(dtype),
    )


def _escape(scene: Scene) -> NDArray[np.float64]:
    """Share of diffuse light from inside that leaves each material's coat."""
    kind, escape = scene.materials.kind, np.ones(len(scene.materials.kind))
    if (kind == PLASTIC).any():
        from raytrace.passes.plastic import coat_escape

        escape[kind == PLASTIC] = coat_escape(scene.materials.ior[kind == PLASTIC])
    return escape
