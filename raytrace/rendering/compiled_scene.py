"""Compiled scenes: trees and tables of a scene in one precision, built once and kept as long as the scene lives."""

from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.memory import Trees, check_tree
from raytrace.passes.light import triangles_at
from raytrace.records import REFRACTIVE, Scene, Shading
from raytrace.scene.other_camera import base_of, root_of
from raytrace.scene.path_plan import needs_paths
from raytrace.scene.plan import Plan, make_plan

if TYPE_CHECKING:
    from raytrace.rendering.path_scene import PathScene


class CompiledScene(NamedTuple):
    """A scene as the passes use it, in one precision."""

    plan: Plan
    max_depth: int
    bvh: BVH
    shadow_bvhs: tuple[BVH, ...]  # one per light, without surfaces that its rays pass through, or that it lies on
    shading: Shading
    normals: NDArray[np.floating] | None  # (m * 9,) f: unit shading normals of corners; None: all flat
    background: NDArray[np.floating]  # (3,) f
    light_position: NDArray[np.floating]  # (l, 3) f
    light_flux: NDArray[np.floating]  # (l, 3) f
    camera_bvh: BVH | None = None  # for the first rays, without triangles hidden in the viewer; None: bvh


_paths: WeakKeyDictionary[Scene, dict[tuple[str, str], "PathScene"]] = WeakKeyDictionary()  # precision, integrator
_trees: WeakKeyDictionary[Scene, dict[str, BVH]] = WeakKeyDictionary()  # by the root of scenes, and by precision
_compiled: WeakKeyDictionary[Scene, dict[str, CompiledScene]] = WeakKeyDictionary()  # by precision


def compiled_of(scene: Scene, plan: Plan, precision: str) -> CompiledScene:
    """Return the compiled scene in a precision; it is built at the first call, for all cameras of a scene."""
    by_precision, base = _compiled.setdefault(scene, {}), base_of(scene)
    if precision not in by_precision and base is not scene:
        compiled = compiled_of(base, plan_of(base), precision)
        if needs_paths(base, "direct") and not needs_paths(scene, "direct"):  # the base has a lens, and no such trees
            positions = scene.lights.position.astype(precision)
            compiled = compiled._replace(shadow_bvhs=_shadow_bvhs(scene, compiled.bvh, positions))
        by_precision[precision] = compiled._replace(plan=plan)
    elif precision not in by_precision:
        trees = _trees.setdefault(
            root_of(scene), {}
        )  # of scenes of the same triangles, as ``Scene.replace`` makes them
        by_precision[precision] = compile_scene(scene, plan, precision, bvh=trees.get(precision))
        trees[precision] = by_precision[precision].bvh
    return by_precision[precision]


def set_compiled(scene: Scene, compiled: CompiledScene) -> None:
    """Render a scene from this compiled scene from now on, in that precision."""
    _compiled.setdefault(scene, {})[compiled.bvh.precision] = compiled


def is_compiled(scene: Scene, precision: str) -> bool:
    """Whether a scene is compiled in a precision."""
    return precision in _compiled.get(base_of(scene), {})


def plan_of(scene: Scene) -> Plan:
    """Return the plan of a scene; a compiled scene has it already."""
    for compiled in _compiled.get(scene, {}).values():
        return compiled.plan
    return make_plan(scene)


def paths_of(scene: Scene, compiled: CompiledScene, integrator: str) -> "PathScene | None":
    """Return the tables of path tracing for a compiled scene; None where it does not need them."""
    return path_scene_of(scene, compiled, integrator) if needs_paths(scene, integrator) else None


def path_scene_of(scene: Scene, compiled: CompiledScene, integrator: str) -> "PathScene":
    """Return the tables of path tracing for a compiled scene, whether a render needs them or not."""
    from raytrace.rendering.path_scene import lens_of, make_path_scene

    base = base_of(scene)
    known, key = _paths.setdefault(base, {}), (compiled.bvh.precision, integrator)
    if key not in known:
        known[key] = make_path_scene(base, compiled.bvh, integrator)._replace(camera_bvh=compiled.camera_bvh)
    return known[key] if base is scene else known[key]._replace(lens=lens_of(scene, key[0]))


def trees_of(scene: Scene, plan: Plan, precision: str, paths: bool = False) -> Trees:
    """Return what the memory of a compiled scene depends on."""
    triangles = 0 if is_compiled(scene, precision) else len(scene.mesh.faces)
    width = 4 if precision == "float32" else 8
    trees = 1 + (1 + paths) * plan.transparent
    textures = 0
    if paths and (scene.textures is not None or scene.lights.image is not None):
        from raytrace.rendering.texture_table import texture_bytes

        textures = texture_bytes(scene, width)
    return Trees(triangles, trees, width, plan.refraction, plan.lights > 0, paths, textures)


def compile_scene(
    scene: Scene,
    plan: Plan,
    precision: str,
    split: str = "sah",
    triangle: str = "watertight",
    *,
    bvh: BVH | None = None,
) -> CompiledScene:
    """Build the trees and tables of a scene; ``split`` and ``triangle`` as in ``BVH``; bvh: its tree, if known."""
    dtype = np.dtype(precision)
    mesh = scene.mesh
    if bvh is None:
        bvh = BVH(mesh.vertices, mesh.faces, precision, split, triangle)
    positions = scene.lights.position.astype(dtype)
    return CompiledScene(
        plan,
        scene.settings.max_depth,
        bvh,
        _shadow_bvhs(scene, bvh, positions),
        Shading(bvh.triangles.ravel(), mesh.material_id, _material_table(scene, dtype)),
        None if mesh.normals is None else mesh.normals.astype(dtype).ravel(),
        scene.background.astype(dtype),
        positions,
        scene.lights.flux.astype(dtype),
    )


def recompiled(compiled: CompiledScene, scene: Scene) -> CompiledScene:
    """Return the same trees for a scene that differs only in its camera, its point lights or its materials' numbers."""
    dtype = compiled.light_flux.dtype
    shading = compiled.shading._replace(materials=_material_table(scene, dtype))
    compiled = compiled._replace(shading=shading, light_flux=scene.lights.flux.astype(dtype))
    positions = scene.lights.position.astype(dtype)
    if np.array_equal(positions, compiled.light_position):
        return compiled
    shadow_bvhs = _shadow_bvhs(scene, compiled.bvh, positions)  # a light may leave a triangle, or lie on another one
    return compiled._replace(light_position=positions, shadow_bvhs=shadow_bvhs)


def _material_table(scene: Scene, dtype: np.dtype) -> NDArray[np.floating]:
    """Return the numbers of materials that shading reads."""
    materials = scene.materials
    refractive = materials.kind == REFRACTIVE
    table = np.column_stack([materials.albedo, materials.ior, materials.two_sided, refractive])
    return table.astype(dtype).ravel()


def _shadow_bvhs(scene: Scene, bvh: BVH, positions: NDArray[np.floating]) -> tuple[BVH, ...]:
    """Return the trees for the shadow rays of each light: ``bvh`` itself where no triangle is left out."""
    if not len(positions) or needs_paths(scene, "direct"):  # path tracing has trees of its own
        return ()
    mesh, kind = scene.mesh, (bvh.precision, bvh.split, bvh.triangle)
    stops = ~scene.materials.transparent_shadow[mesh.material_id]
    common = bvh if stops.all() else BVH(mesh.vertices, mesh.faces[stops], *kind)
    trees = []
    for position in positions:
        rest = stops.copy()
        rest[triangles_at(bvh.tree, bvh.triangles, position)] = False
        alike = np.array_equal(rest, stops)
        if not alike:
            check_tree(len(mesh.faces), bvh.triangles.itemsize)  # the number of such trees is not known earlier
        trees.append(common if alike else BVH(mesh.vertices, mesh.faces[rest], *kind))
    return tuple(trees)
