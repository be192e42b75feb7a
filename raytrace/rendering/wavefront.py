"""The wavefront: one thread sends batches of samples through the passes that the scene needs."""

import time
from collections import Counter, defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel import query
from raytrace.accel.bvh import BVH
from raytrace.accel.lanes import PACKET
from raytrace.passes.camera import camera_rays
from raytrace.passes.columns import BATCH_COLUMNS, ColumnMemory, shortened_record
from raytrace.passes.film import accumulate
from raytrace.passes.light import background, reflect_light, shadow_rays
from raytrace.passes.refraction import land, refract_rays
from raytrace.passes.surface import surface
from raytrace.records import Batch, Columns, Points, Rays, Shadows, View
from raytrace.rendering.compiled_scene import CompiledScene

BATCH = 32768  # samples in flight per thread, about 100 bytes each; with fewer, threads wait for Python more often
EXHAUSTED = -2  # prim_id of a sample that has met max_depth surfaces and has not ended
OTHER_COLUMNS = 23  # of points, shadows and radiance


class Wavefront:
    """One thread's scratch memory, and the passes in their order.

    Parameters
    ----------
    compiled : CompiledScene
    view : View
    sampler : Sobol, Stratified or Independent
    n : int
        Most samples of a batch: a multiple of the packet size.
    """

    def __init__(self, compiled: CompiledScene, view: View, sampler: Any, n: int) -> None:
        dtype = compiled.bvh.triangles.dtype
        self.compiled, self.view, self.sampler, self.most = compiled, view, sampler, n
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.rays: Counter[str] = Counter()
        self.work = compiled.bvh.work()
        self.first_bvh = compiled.bvh if compiled.camera_bvh is None else compiled.camera_bvh
        self.first_work = self.work if compiled.camera_bvh is None else compiled.camera_bvh.work()
        self.shadow_work = [bvh.work() for bvh in compiled.shadow_bvhs]
        batches = 1 + 2 * compiled.plan.refraction
        memory = ColumnMemory(BATCH_COLUMNS * batches + OTHER_COLUMNS, n, dtype)
        samples, *bounced = (memory.take_batch() for _ in range(batches))
        p, ng = memory.take(3), memory.take(3)
        ns = memory.take(3) if compiled.plan.smooth else ng
        points = Points(p, ng, ns, memory.take(), memory.take(dtype=np.int32))
        rays = memory.take(3), memory.take(3), memory.take()
        shadows = Shadows(*rays, memory.take(), memory.take(dtype=np.bool_))
        self._records, self._radiance = (samples, points, shadows, *bounced), memory.take(3)
        self.zero, self.infinity = np.zeros(1, dtype), np.full(1, np.inf, dtype)
        self.resize(n)

    def resize(self, n: int) -> None:
        """Use batches of n samples (whole packets) in the same memory; the packet after them is all misses."""
        self.n, self._rows = n, n + PACKET
        records = [shortened_record(record, self._rows, self.most + PACKET) for record in self._records]
        self.samples, self.points, self.shadows, *self.bounced = records
        self.radiance = self._radiance[: 3 * self._rows]
        self.samples.hits.prim_id[n:] = -1
        if self.bounced:
            self.samples.slot[:] = np.arange(self._rows)

    def add_samples(
        self, x: NDArray[np.uint32], y: NDArray[np.uint32], first: int, last: int, sums: Any, begin: int
    ) -> None:
        """Add samples ``first`` .. ``last - 1`` of all pixels (x, y) of a batch to their sums."""
        samples, compiled = self.samples, self.compiled
        clock = time.perf_counter()
        camera_rays(self.view, self.sampler, x, y, np.array([first, last]), samples.d)
        clock = self._lap("camera", clock)
        origins = Columns(self.view.origin, 0, 0, 1)
        self._closest(samples, origins, self.n, self.first_bvh)
        clock = self._lap("closest hit", clock)
        self.rays["camera"] += self.n
        if compiled.plan.refraction:
            self._refract()
            clock = self._lap("refraction", clock)
        background(samples.hits, self.radiance, compiled.background)
        if compiled.plan.lights:
            surface(compiled.shading, compiled.normals, samples.d, samples.hits, self.points)
            clock = self._lap("surface", clock)
            for number in range(compiled.plan.lights):
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

    def _closest(self, batch: Batch, origins: Columns, count: int, bvh: BVH) -> None:
        rays = Rays(origins, self._columns(batch.d), self._limit(self.zero), self._limit(self.infinity))
        work = self.work if bvh is self.compiled.bvh else self.first_work
        query.closest_hit(bvh.tree, rays, batch.hits, count, work)

    def _refract(self) -> None:
        """Follow samples until they hit a diffuse surface, leave the scene, or have met ``max_depth`` surfaces."""
        compiled = self.compiled
        source, target = self.samples, self.bounced[0]
        count = refract_rays(compiled.shading, compiled.normals, source, self.n, target)
        depth = 1
        while count and depth < compiled.max_depth:
            source, target = target, self.bounced[depth % 2]
            self._closest(source, self._columns(source.o), count, compiled.bvh)
            self.rays["refraction"] += count
            land(source, count, self.samples)
            count = refract_rays(compiled.shading, compiled.normals, source, count, target)
            depth += 1
        self.samples.hits.prim_id[target.slot[:count]] = EXHAUSTED

    def _light(self, number: int) -> None:
        """Add the radiance that one point light causes."""
        compiled, shadows = self.compiled, self.shadows
        clock = time.perf_counter()
        self.rays["shadow"] += shadow_rays(self.points, compiled.light_position[number], shadows)
        clock = self._lap("light", clock)
        tmax = Columns(shadows.tmax, 0, 1, 0)
        rays = Rays(self._columns(shadows.o), self._columns(shadows.d), self._limit(self.zero), tmax)
        query.any_hit(compiled.shadow_bvhs[number].tree, rays, shadows.occluded, self.n, self.shadow_work[number])
        clock = self._lap("shadow", clock)
        reflect_light(compiled.shading, self.points, shadows, compiled.light_flux[number], self.radiance)
        self._lap("light", clock)
