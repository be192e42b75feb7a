"""The kernels that a render needs, with arguments of the right types, so that they can be compiled in parallel.

No result depends on these lists: a kernel that is missing here is compiled when it is first called.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from raytrace.accel import query, reorder
from raytrace.accel.build import LEAVES, SMALL_MESH, measure
from raytrace.accel.bvh import BVH
from raytrace.accel.flatten import fill_leaves, flatten
from raytrace.accel.grow import Subtree, grow, make_binary, make_grow_scratch
from raytrace.accel.lanes import NODE, PACKET
from raytrace.accel.layout import make_leaves, make_nodes
from raytrace.passes.camera import camera_rays, make_view
from raytrace.passes.edges import edges, weigh
from raytrace.passes.estimate import errors
from raytrace.passes.film import accumulate, develop, make_film, make_frame
from raytrace.passes.light import background, reflect_light, shadow_rays
from raytrace.passes.refraction import land, refract_rays
from raytrace.passes.sampling import make_sampler
from raytrace.passes.surface import surface
from raytrace.records import DIFFUSE, REFRACTIVE, Camera, Columns, Lights, Materials, Mesh, Rays, Scene, Settings
from raytrace.rendering.compiled_scene import compile_scene
from raytrace.rendering.wavefront import Wavefront
from raytrace.scene.path_plan import needs_paths
from raytrace.scene.plan import Plan, make_plan

if TYPE_CHECKING:
    from raytrace.native.workers import Task
    from raytrace.rendering.path_kernels import PathNeeds
    from raytrace.rendering.path_wavefront import PathWavefront

Call = tuple[Callable[..., Any], tuple[Any, ...]]  # a kernel and its arguments


class Traits(NamedTuple):
    """Properties of a render that decide which kernels it needs."""

    precision: str
    sampler: str
    smooth: bool = False  # normals are interpolated
    refractive: bool = False
    lit: bool = True  # there is a light
    large: bool = False  # a mesh has more than `SMALL_MESH` triangles
    layers: bool = False  # there are layers (AOVs)
    adaptive: bool = False  # there is a target error
    path: "PathNeeds | None" = None  # what path tracing needs; None: it does not run


def traits_of(
    scene: Scene,
    plan: Plan,
    precision: str,
    settings: Settings,
    *,
    layers: bool = False,
    adaptive: bool = False,
    light: bool = False,
) -> Traits:
    """Return the traits of a render of a scene."""
    large = len(scene.mesh.faces) > SMALL_MESH
    path = None
    if needs_paths(scene, settings.integrator):
        from raytrace.rendering.path_kernels import path_needs_of

        path = path_needs_of(scene, settings.integrator, light)
    kinds = plan.smooth, plan.refraction, plan.lights > 0
    return Traits(precision, settings.sampler, *kinds, large, layers, adaptive, path)


def needs(traits: Traits) -> list[Call]:
    """List the kernels for a render; those that take longest to compile come first."""
    scene = _small_scene(traits)
    compiled = compile_scene(scene, make_plan(scene), traits.precision)
    view = make_view(scene.camera, scene.settings.size, np.dtype(traits.precision))
    sampler = make_sampler(traits.sampler, 0, 1)
    front: Any = Wavefront(compiled, view, sampler, PACKET)
    if traits.path is not None:
        from raytrace.rendering.path_kernels import small_scene
        from raytrace.rendering.path_scene import make_path_scene
        from raytrace.rendering.path_wavefront import PathWavefront

        kind: type[PathWavefront] = PathWavefront
        if traits.path.light:
            from raytrace.rendering.layered_wavefront import LayeredWavefront

            kind = LayeredWavefront

        scene = small_scene(traits.path, scene)
        bvh = BVH(scene.mesh.vertices, scene.mesh.faces, traits.precision)
        front = kind(make_path_scene(scene, bvh, traits.path.integrator), view, sampler, PACKET)
    calls = list(tracing(front))
    if traits.large:
        calls += _building(np.dtype(traits.precision), compiled.bvh.triangle)
    if traits.layers:
        calls += _sorting(compiled.bvh)
    if traits.adaptive:
        calls.append((edges, (np.zeros(0), 0, np.zeros(0), np.zeros(0), np.zeros(0))))
        calls.append((weigh, (np.zeros(0), 0, np.zeros(0), 0, np.zeros(0))))
    return calls


def compile_ahead(renders: Iterable[Traits], report: Callable[[int, int], None]) -> "list[Task]":
    """Compile in parallel, as far as possible, all kernels that renders need and the store does not have.

    Parameters
    ----------
    renders : iterable of Traits
    report : callable
        Called in this thread with the work that is done, and all work.

    Returns
    -------
    list of (Kernel, kinds of arguments)
        The kernels that the store did not have.
    """
    from raytrace.native.workers import compile_all, missing

    tasks = missing(call for traits in renders for call in needs(traits))
    compile_all(tasks, report)
    return tasks


def _small_scene(traits: Traits) -> Scene:
    """Two triangles with these traits; their tree is so small that no kernel builds it."""
    triangle = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3)).copy() if traits.smooth else None
    kinds, flags = np.array([DIFFUSE, REFRACTIVE if traits.refractive else DIFFUSE], np.int8), np.zeros(2, np.bool_)
    position = np.array([[0.0, 0.0, 3.0]])
    return Scene(
        source=None,
        about="",
        camera=Camera(np.array([0.0, 0.0, 4.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0),
        settings=Settings((8, 8), 2, 4, "sobol", "auto", 0),
        background=np.zeros(3),
        materials=Materials(("white", "glass"), kinds, np.ones((2, 3)), np.ones(2), flags, flags),
        lights=Lights(position, np.ones((1, 3))) if traits.lit else Lights(position[:0], position[:0]),
        mesh=Mesh(
            np.concatenate([triangle, triangle + [0.0, 0.0, 1.0]]),
            np.arange(6).reshape(2, 3),
            normals,
            np.arange(2, dtype=np.int32),
            np.zeros(2, np.int32),
        ),
        objects=("triangles",),
        warnings=(),
    )


def _rays(dtype: np.dtype) -> Rays:
    columns = Columns(np.zeros(3 * PACKET, dtype), 0, 1, PACKET)
    return Rays(columns, columns, columns, columns)


def tracing(front: "Wavefront | PathWavefront") -> Iterator[Call]:
    """Yield the kernels that a wavefront calls."""
    if isinstance(front, Wavefront):
        yield from _tracing(front)
    else:
        from raytrace.rendering.path_kernels import path_tracing

        yield from path_tracing(front, _rays(front.radiance.dtype))
    film = make_film(PACKET)
    yield accumulate, (front.radiance, 0, 0, film.sums, 0, PACKET)
    yield errors, (film.sums.reshape(-1), 0, np.zeros(7), np.zeros(3 * PACKET), film.variance, film.error)
    yield develop, (film, np.zeros(0, np.int64), 0, 0, np.zeros((1, 7)), make_frame(0))


def _tracing(front: Wavefront) -> Iterator[Call]:
    compiled, samples, dtype = front.compiled, front.samples, front.radiance.dtype
    colour = np.zeros(3, dtype)
    yield query.closest_hit, (compiled.bvh.tree, _rays(dtype), samples.hits, 0, front.work)
    if compiled.plan.lights:
        yield query.any_hit, (compiled.bvh.tree, _rays(dtype), front.shadows.occluded, 0, front.work)
    if compiled.plan.refraction:
        yield refract_rays, (compiled.shading, compiled.normals, samples, 0, samples)
    pixels, numbers = np.zeros(PACKET, np.uint32), np.zeros(2, np.int64)
    yield camera_rays, (front.view, front.sampler, pixels, pixels, numbers, samples.d)
    if compiled.plan.lights:
        yield surface, (compiled.shading, compiled.normals, samples.d, samples.hits, front.points)
        yield shadow_rays, (front.points, colour, front.shadows)
        yield reflect_light, (compiled.shading, front.points, front.shadows, colour, front.radiance)
    yield background, (samples.hits, front.radiance, colour)
    if compiled.plan.refraction:
        yield land, (samples, 0, samples)


def _building(dtype: np.dtype, triangle: str) -> Iterator[Call]:
    vertices, faces, triangles = np.zeros((3, 3), dtype), np.zeros((1, 3), np.int32), np.zeros((1, 12), dtype)
    tree = make_binary(np.zeros(1, np.int32), np.zeros(16, dtype))
    yield grow, (tree, 0, NODE, Subtree(0, 0, 1, 0), make_grow_scratch(dtype))
    kind: Any = LEAVES[triangle]
    nodes, leaves = make_nodes(1, dtype), make_leaves(kind, 1, dtype)
    yield flatten, (tree, nodes, tree.order, np.zeros((1, 3), np.int64), np.zeros(NODE, np.int64))
    yield fill_leaves, (tree, tree.order, 0, 1, leaves, triangles)
    yield measure, (vertices, faces, triangles, tree.boxes, tree.order, np.zeros(9))


def _sorting(bvh: BVH) -> Iterator[Call]:
    dtype = bvh.triangles.dtype
    rays, scratch = _rays(dtype), reorder.make_sort_scratch(PACKET, dtype, bvh.pool_work())
    yield query.closest_hit, (bvh.tree, rays, scratch.hits, 0, bvh.work())  # few rays, or coherent ones: no pool
    yield reorder.sort_rays, (rays, 0, bvh.grid, scratch)
    yield reorder.changes, (rays, 0, bvh.grid, scratch)
    yield reorder.take, (rays, 0, scratch.numbers[0], scratch.rays)
    for values in (scratch.hits.t, scratch.hits.prim_id, scratch.occluded):
        yield reorder.give_back, (values, 0, scratch.numbers[0], values)
