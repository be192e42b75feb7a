"""The wavefront: one thread's batches of samples through the passes that the scene needs."""

import time
from collections import Counter, defaultdict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel import query
from raytrace.accel.bvh import BVH
from raytrace.accel.lanes import PACKET
from raytrace.accel.layout import aligned
from raytrace.memory import check_tree
from raytrace.passes.camera import camera_rays
from raytrace.passes.film import accumulate
from raytrace.passes.light import background, reflect_light, shadow_rays, triangles_at
from raytrace.passes.refraction import land, refract_rays
from raytrace.passes.surface import surface
from raytrace.records import REFRACTIVE, Batch, Columns, Hits, Points, Rays, Scene, Shading, Shadows, View
from raytrace.scene.path_plan import needs_paths
from raytrace.scene.plan import Plan

BATCH = 16384  # samples in flight in one thread: about 100 bytes each; fewer make Python a tenth of the time
EXHAUSTED = -2  # prim_id of a sample that was still under way at max_depth


class CompiledScene(NamedTuple):
    """A scene as the passes use it, in one precision."""

    plan: Plan
    max_depth: int
    bvh: BVH
    shadow_bvhs: tuple[BVH, ...]  # one a light: the same, but for surfaces that its rays pass, or that it lies on
    shading: Shading
    normals: NDArray[np.floating] | None  # (m * 9,) f: unit shading normals of corners; None: all flat
    background: NDArray[np.floating]  # (3,) f
    light_position: NDArray[np.floating]  # (l, 3) f
    light_flux: NDArray[np.floating]  # (l, 3) f


def compile_scene(
    scene: Scene, plan: Plan, precision: str, split: str = "sah", triangle: str = "watertight"
) -> CompiledScene:
    """Trees and tables of a scene; split and triangle as ``BVH`` takes them."""
    dtype = np.dtype(precision)
    mesh = scene.mesh
    bvh = BVH(mesh.vertices, mesh.faces, precision, split, triangle)
    positions = scene.lights.position.astype(dtype)
    return CompiledScene(
        plan,
        scene.settings.max_depth,
        bvh,
        _shadow_bvhs(scene, bvh, positions),
        Shading(bvh.triangles.ravel(), mesh.material_id, _table(scene, dtype)),
        None if mesh.normals is None else mesh.normals.astype(dtype).ravel(),
        scene.background.astype(dtype),
        positions,
        scene.lights.flux.astype(dtype),
    )


def recompiled(stage: CompiledScene, scene: Scene) -> CompiledScene:
    """The same trees, for a scene that differs in its camera, its fluxes or its materials' numbers alone."""
    dtype = stage.light_flux.dtype
    shading = stage.shading._replace(materials=_table(scene, dtype))
    return stage._replace(shading=shading, light_flux=scene.lights.flux.astype(dtype))


def _table(scene: Scene, dtype: np.dtype) -> NDArray[np.floating]:
    """What shading looks up of materials."""
    materials = scene.materials
    refractive = materials.kind == REFRACTIVE
    table = np.column_stack([materials.albedo, materials.ior, materials.two_sided, refractive])
    return table.astype(dtype).ravel()


def _shadow_bvhs(scene: Scene, bvh: BVH, positions: NDArray[np.floating]) -> tuple[BVH, ...]:
    """Trees for the shadow rays of each light; the tree itself where nothing is left out."""
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
            check_tree(len(mesh.faces), bvh.triangles.itemsize)  # how many there will be is known but now
        trees.append(common if alike else BVH(mesh.vertices, mesh.faces[rest], *kind))
    return tuple(trees)


class _Memory:
    """One block for the columns of batches.

    A column is a packet longer than a batch of whole pages, so that each begins at another place of a page: where all
    begin at the same, they compete for the few lines that a cache has for it.
    """

    def __init__(self, columns: int, rows: int, dtype: np.dtype) -> None:
        self._block, self._taken = aligned(columns * rows, dtype).reshape(columns, rows), 0

    def take(self, columns: int = 1, dtype: Any = None) -> NDArray[Any]:
        """The next columns, one after the other, of a type that is no larger."""
        first, self._taken = self._taken, self._taken + columns
        taken = self._block[first : self._taken]
        return taken.reshape(-1).view(dtype or taken.dtype)[: taken.size]


def _batch(memory: _Memory) -> Batch:
    d, o, slot = memory.take(3), memory.take(3), memory.take(dtype=np.int32)
    return Batch(o, d, slot, Hits(memory.take(), memory.take(dtype=np.int32), memory.take(), memory.take()))


BATCH_COLUMNS, OTHER_COLUMNS = 11, 23  # of a batch; of points, shadows and radiance


def _part(record: Any, rows: int, most: int) -> Any:
    """What a record of columns with room for ``most`` samples holds of fewer, in the same memory."""
    return record._make(_part(a, rows, most) if isinstance(a, tuple) else a[: len(a) // most * rows] for a in record)


class Wavefront:
    """One thread's scratch memory, and the passes in their order.

    Parameters
    ----------
    stage : Stage
    view : View
    sampler : Sobol, Stratified or Independent
    n : int
        Most samples of a batch: whole packets.
    """

    def __init__(self, stage: CompiledScene, view: View, sampler: Any, n: int) -> None:
        dtype = stage.bvh.triangles.dtype
        self.stage, self.view, self.sampler, self.most = stage, view, sampler, n
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.rays: Counter[str] = Counter()
        self.work = stage.bvh.work()
        self.shadow_work = [bvh.work() for bvh in stage.shadow_bvhs]
        batches = 1 + 2 * stage.plan.refraction
        memory = _Memory(BATCH_COLUMNS * batches + OTHER_COLUMNS, n + PACKET, dtype)
        samples, *bounced = (_batch(memory) for _ in range(batches))
        p, ng = memory.take(3), memory.take(3)
        ns = memory.take(3) if stage.plan.smooth else ng
        points = Points(p, ng, ns, memory.take(), memory.take(dtype=np.int32))
        rays = memory.take(3), memory.take(3), memory.take()
        shadows = Shadows(*rays, memory.take(), memory.take(dtype=np.bool_))
        self._records, self._radiance = (samples, points, shadows, *bounced), memory.take(3)
        self.zero, self.infinity = np.zeros(1, dtype), np.full(1, np.inf, dtype)
        self.resize(n)

    def resize(self, n: int) -> None:
        """Take n samples a batch from now on, whole packets, in the memory that is there; then come misses."""
        self.n, self._rows = n, n + PACKET
        parts = [_part(record, self._rows, self.most + PACKET) for record in self._records]
        self.samples, self.points, self.shadows, *self.bounced = parts
        self.radiance = self._radiance[: 3 * self._rows]
        self.samples.hits.prim_id[n:] = -1
        if self.bounced:
            self.samples.slot[:] = np.arange(self._rows)

    def add_samples(
        self, x: NDArray[np.uint32], y: NDArray[np.uint32], first: int, last: int, sums: Any, begin: int
    ) -> None:
        """Add samples ``first`` .. ``last - 1`` of all pixels (x, y) of a batch to their sums."""
        samples, stage = self.samples, self.stage
        clock = time.perf_counter()
        camera_rays(self.view, self.sampler, x, y, np.array([first, last]), samples.d)
        clock = self._lap("camera", clock)
        origins = Columns(self.view.origin, 0, 0, 1)
        self._closest(samples, origins, self.n)
        clock = self._lap("closest hit", clock)
        self.rays["camera"] += self.n
        if stage.plan.refraction:
            self._refract()
            clock = self._lap("refraction", clock)
        background(samples.hits, self.radiance, stage.background)
        if stage.plan.lights:
            surface(stage.shading, stage.normals, samples.d, samples.hits, self.points)
            clock = self._lap("surface", clock)
            for number in range(stage.plan.lights):
                self._light(number)
        clock = time.perf_counter()
        accumulate(self.radiance, first, last, sums, begin, len(x))
        self._lap("film", clock)

    def _lap(self, name: str, since: float) -> float:
        now = time.perf_counter()
        self.seconds[name] += now - since
        return now

    def _limit(self, value: NDArray[np.floating]) -> Columns:
        return Columns(value, 0, 0, 0)

    def _columns(self, array: NDArray[np.floating]) -> Columns:
        return Columns(array, 0, 1, self._rows)

    def _closest(self, batch: Batch, origins: Columns, count: int) -> None:
        rays = Rays(origins, self._columns(batch.d), self._limit(self.zero), self._limit(self.infinity))
        query.closest_hit(self.stage.bvh.tree, rays, batch.hits, count, self.work)

    def _refract(self) -> None:
        """Follow samples through interfaces until they land, leave, or have met ``max_depth`` surfaces."""
        stage = self.stage
        source, target = self.samples, self.bounced[0]
        count = refract_rays(stage.shading, stage.normals, source, self.n, target)
        depth = 1
        while count and depth < stage.max_depth:
            source, target = target, self.bounced[depth % 2]
            self._closest(source, self._columns(source.o), count)
            self.rays["refraction"] += count
            land(source, count, self.samples)
            count = refract_rays(stage.shading, stage.normals, source, count, target)
            depth += 1
        self.samples.hits.prim_id[target.slot[:count]] = EXHAUSTED

    def _light(self, number: int) -> None:
        """Add the light of one point light."""
        stage, shadows = self.stage, self.shadows
        clock = time.perf_counter()
        self.rays["shadow"] += shadow_rays(self.points, stage.light_position[number], shadows)
        clock = self._lap("light", clock)
        tmax = Columns(shadows.tmax, 0, 1, 0)
        rays = Rays(self._columns(shadows.o), self._columns(shadows.d), self._limit(self.zero), tmax)
        query.any_hit(stage.shadow_bvhs[number].tree, rays, shadows.occluded, self.n, self.shadow_work[number])
        clock = self._lap("shadow", clock)
        reflect_light(stage.shading, self.points, shadows, stage.light_flux[number], self.radiance)
        self._lap("light", clock)
