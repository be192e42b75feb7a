"""Which kernels a picture needs, with arguments of the kinds that it gives them: to have them compiled side by side.

Nothing depends on these lists: a kernel that they lack is compiled when it is called.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from raytrace.accel import query, reorder
from raytrace.accel.build import FEW, LEAVES, measure
from raytrace.accel.bvh import BVH
from raytrace.accel.flatten import flatten
from raytrace.accel.grow import Part, grow, make_binary, make_scratch
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
from raytrace.rendering.wavefront import Wavefront, compile_scene
from raytrace.scene.path_plan import needs_paths
from raytrace.scene.plan import Plan, make_plan

if TYPE_CHECKING:
    from raytrace.native.workers import Task
    from raytrace.rendering.path_kernels import PathNeeds
    from raytrace.rendering.path_wavefront import PathWavefront

Call = tuple[Callable[..., Any], tuple[Any, ...]]  # a kernel and its arguments


class Picture(NamedTuple):
    """What of a picture decides which kernels it needs."""

    precision: str
    sampler: str
    smooth: bool = False  # normals are interpolated
    refractive: bool = False
    lit: bool = True  # there is a light
    large: bool = False  # a mesh has more than `FEW` triangles
    layers: bool = False  # there are layers (AOVs)
    aimed: bool = False  # an error is wanted
    path: "PathNeeds | None" = None  # what path tracing needs; None: it does not run


def picture_of(
    scene: Scene, plan: Plan, precision: str, settings: Settings, *, layers: bool = False, aimed: bool = False
) -> Picture:
    """What of a scene's picture decides which kernels it needs."""
    large = len(scene.mesh.faces) > FEW
    path = None
    if needs_paths(scene, settings.integrator):
        from raytrace.rendering.path_kernels import path_needs_of

        path = path_needs_of(scene, settings.integrator)
    kinds = plan.smooth, plan.refraction, plan.lights > 0
    return Picture(precision, settings.sampler, *kinds, large, layers, aimed, path)


def needs(picture: Picture) -> list[Call]:
    """Kernels for a picture; those that take longest to compile come first."""
    scene = _small_scene(picture)
    stage = compile_scene(scene, make_plan(scene), picture.precision)
    view = make_view(scene.camera, scene.settings.size, np.dtype(picture.precision))
    sampler = make_sampler(picture.sampler, 0, 1)
    front: Any = Wavefront(stage, view, sampler, PACKET)
    if picture.path is not None:
        from raytrace.rendering.path_kernels import small_scene
        from raytrace.rendering.path_scene import make_path_scene
        from raytrace.rendering.path_wavefront import PathWavefront

        scene = small_scene(picture.path, scene)
        bvh = BVH(scene.mesh.vertices, scene.mesh.faces, picture.precision)
        front = PathWavefront(make_path_scene(scene, bvh, picture.path.integrator), view, sampler, PACKET)
    calls = list(tracing(front))
    if picture.large:
        calls += _building(np.dtype(picture.precision), stage.bvh.triangle)
    if picture.layers:
        calls += _sorting(stage.bvh)
    if picture.aimed:
        calls.append((edges, (np.zeros(0), 0, np.zeros(0), np.zeros(0), np.zeros(0))))
        calls.append((weigh, (np.zeros(0), 0, np.zeros(0), 0, np.zeros(0))))
    return calls


def compile_ahead(pictures: Iterable[Picture], report: Callable[[int, int], None]) -> "list[Task]":
    """Have all compiled side by side that pictures need and the store lacks, as far as that can be done.

    Parameters
    ----------
    pictures : iterable of Picture
    report : callable
        Is called here with how much of the work is done, and how much it is.

    Returns
    -------
    list of (Kernel, kinds of arguments)
        What it lacked.
    """
    from raytrace.native.workers import compile_all, missing

    tasks = missing(call for picture in pictures for call in needs(picture))
    compile_all(tasks, report)
    return tasks


def _small_scene(picture: Picture) -> Scene:
    """Two triangles that have it all, so few that the interpreter builds their tree."""
    triangle = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3)).copy() if picture.smooth else None
    kinds, flags = np.array([DIFFUSE, REFRACTIVE if picture.refractive else DIFFUSE], np.int8), np.zeros(2, np.bool_)
    place = np.array([[0.0, 0.0, 3.0]])
    return Scene(
        source=None,
        about="",
        camera=Camera(np.array([0.0, 0.0, 4.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 40.0),
        settings=Settings((8, 8), 2, 4, "sobol", "auto", 0),
        background=np.zeros(3),
        materials=Materials(("white", "glass"), kinds, np.ones((2, 3)), np.ones(2), flags, flags),
        lights=Lights(place, np.ones((1, 3))) if picture.lit else Lights(place[:0], place[:0]),
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
    """Kernels that a wavefront calls."""
    dtype = front.radiance.dtype
    if isinstance(front, Wavefront):
        yield from _tracing(front)
    else:
        from raytrace.rendering.path_kernels import path_tracing

        yield from path_tracing(front, _rays(dtype))
    film = make_film(PACKET)
    yield accumulate, (front.radiance, 0, 0, film.sums, 0, PACKET)
    yield errors, (film.sums.reshape(-1), 0, np.zeros(7), np.zeros(3 * PACKET), film.variance, film.error)
    yield develop, (film, np.zeros(0, np.int64), 0, 0, make_frame(0))


def _tracing(front: Wavefront) -> Iterator[Call]:
    stage, samples, dtype = front.stage, front.samples, front.radiance.dtype
    colour = np.zeros(3, dtype)
    yield query.closest_hit, (stage.bvh.tree, _rays(dtype), samples.hits, 0, front.work)
    if stage.plan.lights:
        yield query.any_hit, (stage.bvh.tree, _rays(dtype), front.shadows.occluded, 0, front.work)
    if stage.plan.refraction:
        yield refract_rays, (stage.shading, stage.normals, samples, 0, samples)
    pixels, numbers = np.zeros(PACKET, np.uint32), np.zeros(2, np.int64)
    yield camera_rays, (front.view, front.sampler, pixels, pixels, numbers, samples.d)
    if stage.plan.lights:
        yield surface, (stage.shading, stage.normals, samples.d, samples.hits, front.points)
        yield shadow_rays, (front.points, colour, front.shadows)
        yield reflect_light, (stage.shading, front.points, front.shadows, colour, front.radiance)
    yield background, (samples.hits, front.radiance, colour)
    if stage.plan.refraction:
        yield land, (samples, 0, samples)


def _building(dtype: np.dtype, triangle: str) -> Iterator[Call]:
    vertices, faces, triangles = np.zeros((3, 3), dtype), np.zeros((1, 3), np.int32), np.zeros((1, 12), dtype)
    tree = make_binary(np.zeros(1, np.int32), np.zeros(16, dtype))
    yield grow, (tree, 0, NODE, Part(0, 0, 1, 0), make_scratch(dtype))
    kind: Any = LEAVES[triangle]
    nodes, leaves = make_nodes(1, dtype), make_leaves(kind, 1, dtype)
    yield flatten, (tree, nodes, leaves, triangles, np.zeros((1, 3), np.int64), np.zeros(NODE, np.int64))
    yield measure, (vertices, faces, triangles, tree.boxes, tree.order, np.zeros(9))


def _sorting(bvh: BVH) -> Iterator[Call]:
    dtype = bvh.triangles.dtype
    rays, room = _rays(dtype), reorder.make_room(PACKET, dtype, bvh.work())
    yield reorder.sort_rays, (rays, 0, bvh.grid, room)
    yield reorder.changes, (rays, 0, bvh.grid, room)
    yield reorder.take, (rays, 0, room.numbers[0], room.rays)
    for values in (room.hits.t, room.hits.prim_id, room.occluded):
        yield reorder.give_back, (values, 0, room.numbers[0], values)
