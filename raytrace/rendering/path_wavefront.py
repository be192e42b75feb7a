"""Path tracing: one thread's batches of paths through the passes that the scene needs."""

import time
from collections import Counter, defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel import query
from raytrace.accel.bvh import BVH
from raytrace.accel.lanes import PACKET
from raytrace.passes import compaction, environment, lights, materials, paths, textures
from raytrace.passes.camera import camera_rays
from raytrace.passes.columns import BATCH_COLUMNS, ColumnMemory, shortened_record
from raytrace.passes.film import accumulate
from raytrace.passes.lens import lens_rays
from raytrace.passes.path_records import Incident, Order, Paths, Vertices
from raytrace.records import CONDUCTOR, DIELECTRIC, MIRROR, REFRACTIVE, Columns, Rays, View
from raytrace.rendering.path_scene import PathScene
from raytrace.rendering.scattering import scattering_passes

PATH_COLUMNS, VERTEX_COLUMNS, INCIDENT_COLUMNS = BATCH_COLUMNS + 8, 12, 16


class PathWavefront:
    """One thread's scratch memory, and the passes of path tracing in their order.

    Parameters
    ----------
    scene : PathScene
    view : View
    sampler : Sobol, Stratified or Independent
    n : int
        Most samples of a batch: whole packets.
    """

    def __init__(self, scene: PathScene, view: View, sampler: Any, n: int) -> None:
        dtype = scene.bvh.triangles.dtype
        self.scene, self.view, self.sampler, self.most = scene, view, sampler, n
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.rays: Counter[str] = Counter()
        self.work = scene.bvh.pool_work()
        self.first_bvh = scene.bvh if scene.camera_bvh is None else scene.camera_bvh
        self.first_work = self.work if scene.camera_bvh is None else scene.camera_bvh.pool_work()
        trees = (scene.shadow_bvh, scene.passed_bvh)
        self.shadow_work = {id(bvh): bvh.pool_work() for bvh in trees if bvh is not None}
        textured = scene.textures is not None
        memory = ColumnMemory(2 * PATH_COLUMNS + VERTEX_COLUMNS + INCIDENT_COLUMNS + 5 + 3 * textured, n, dtype)
        ng = memory.take(3)
        ns = memory.take(3) if scene.normals is not None else ng
        place = memory.take(3), ng, ns, memory.take(), memory.take(dtype=np.bool_), memory.take(dtype=np.int32)
        vertices = Vertices(*place, memory.take(3) if textured else None)
        incident = _incident(memory) if scene.lights is not None else None
        self._records = [_paths(memory), _paths(memory), vertices, *([] if incident is None else [incident])]
        self._radiance = memory.take(3)
        self.grid = compaction.make_cells(scene.bvh.tree)
        numbers = memory.take(dtype=np.int32), memory.take(dtype=np.int32)
        self.order = Order(*numbers, compaction.make_counts())
        self.order.numbers[:] = 0
        self.scattering = scattering_passes(scene.kinds) if scene.integrator != "emission" else []
        self.samples_lights = bool(self.scattering) and scene.lights is not None
        self.finds_light = scene.lamps or scene.environment is not None  # whether a ray can meet a light
        self.zero, self.infinity = np.zeros(1, dtype), np.full(1, np.inf, dtype)
        self.resize(n)

    def resize(self, n: int) -> None:
        """Take n samples a batch from now on, whole packets, in the memory that is there; then come misses."""
        self.n, self._rows = n, n + PACKET
        parts = [shortened_record(record, self._rows, self.most + PACKET) for record in self._records]
        self.paths, self.others, self.vertices = parts[:3]
        self.incident: Any = parts[3] if len(parts) == 4 else None  # None: there is no light
        self.radiance = self._radiance[: 3 * self._rows]

    def add_samples(
        self, x: NDArray[np.uint32], y: NDArray[np.uint32], first: int, last: int, sums: Any, begin: int
    ) -> None:
        """Add samples ``first`` .. ``last - 1`` of all pixels (x, y) of a batch to their sums."""
        samples = np.array([first, last])
        self._clock = time.perf_counter()
        if self.scene.lens is None:
            camera_rays(self.view, self.sampler, x, y, samples, self.paths.rays.d)
        else:
            lens_rays(self.view, self.scene.lens, self.sampler, x, y, samples, self.paths.rays)
        paths.begin_paths(self.sampler.seed, x, y, samples, self.paths, self.radiance)
        self._lap("camera")
        self._trace(self.n)
        accumulate(self.radiance, first, last, sums, begin, len(x))
        self._lap("film")

    def _trace(self, n: int) -> None:
        """Follow paths from surface to surface, until none is left or they have met ``max_depth`` surfaces."""
        scene, here, there = self.scene, self.paths, self.others
        self._closest(here, self._origins(here), n, self.first_bvh)
        self.rays["camera"] += n
        for depth in range(1, scene.max_depth + 1):
            self._see(here, n, depth)
            paths.meet_surfaces(here, n, scene.shading, scene.normals, self.vertices)
            self._lap("surface")
            if scene.textures is not None:
                textures.look_up_reflectance(here, n, scene.textures, scene.surfaces, self.vertices)
                self._lap("texture")
            if self.samples_lights:
                self._pick_lights(here, n, depth)
                self._lap("light")
            self._scatter(here, n, depth)
            if self.samples_lights:
                self._add_light(here, n, there)
            n = compaction.go_on(here, n, depth, self.grid, self.order, there)
            self._lap("roulette")
            if n == 0:
                return
            if depth == scene.max_depth and not self.finds_light:
                break
            here, there = there, here
            self._closest(here, self._columns(here.rays.o), n, scene.bvh)
            self.rays["path"] += n
        else:
            self._see(here, n, scene.max_depth + 1)
        self.rays["cut off"] += n

    def _origins(self, here: Paths) -> Columns:
        """Where paths begin: in one point, or each at its own."""
        return Columns(self.view.origin, 0, 0, 1) if self.scene.lens is None else self._columns(here.rays.o)

    def _see(self, here: Paths, n: int, depth: int) -> None:
        """Add what paths see where they arrive."""
        scene = self.scene
        if scene.lamps:
            paths.see_lamps(here, n, scene.shading, scene.surfaces, scene.lamp_textures, self.radiance)
        if scene.image is not None:
            environment.see_image(here, n, scene.image, self.radiance)
        elif scene.environment is not None:
            paths.see_environment(here, n, scene.environment, self.radiance)
        if self.finds_light:
            self._lap("emission")
        if scene.environment is None and scene.background is not None and depth <= scene.max_depth:
            paths.see_background(here, n, scene.background, self.radiance)
            self._lap("background")

    def _pick_lights(self, here: Paths, n: int, depth: int) -> None:
        scene, table, kinds = self.scene, self.scene.lights, self.scene.light_kinds
        paths_, vertices, incident = here, self.vertices, self.incident
        lights.pick_lights(self.sampler, paths_, n, depth, table, scene.surfaces, vertices, incident)
        if lights.TRIANGLE in kinds:
            lamps = scene.shading, scene.lamp_textures
            lights.sample_triangles(self.sampler, paths_, n, depth, table, *lamps, vertices, incident)
        if lights.POINT in kinds:
            lights.sample_points(paths_, n, table, vertices, incident)
        if lights.SPOT in kinds:
            lights.sample_spots(paths_, n, table, vertices, incident)
        if lights.DIRECTIONAL in kinds:
            lights.sample_directions(paths_, n, table, vertices, incident)
        if scene.image is not None:
            environment.sample_image(self.sampler, paths_, n, depth, table, scene.image, vertices, incident)
        elif lights.ENVIRONMENT in kinds:
            lights.sample_environment(self.sampler, paths_, n, depth, table, vertices, incident)
        if scene.passed_bvh is not None:
            self._query(scene.passed_bvh, incident.o, incident.d, incident.tmax, n)
            lights.claim_light(n, incident)

    def _scatter(self, here: Paths, n: int, depth: int) -> None:
        """Send paths on, by the materials that they met."""
        kinds, surfaces, vertices = self.scene.kinds, self.scene.surfaces, self.vertices
        mark = 0 if self.scene.integrator == "path" else paths.ENDING if self.finds_light else paths.DEAD
        for name, scatter in self.scattering:
            scatter(self.sampler, here, n, depth, mark, surfaces, vertices, self.incident)
            self._lap(name)
        if MIRROR in kinds:
            materials.reflect_mirrors(here, n, surfaces, vertices)
            self._lap("mirror")
        if CONDUCTOR in kinds:
            materials.reflect_conductors(here, n, surfaces, vertices)
            self._lap("conductor")
        if DIELECTRIC in kinds:
            materials.pass_dielectrics(here, n, depth, surfaces, vertices)
            self._lap("dielectric")
        if REFRACTIVE in kinds:
            materials.pass_interfaces(here, n, surfaces, vertices)
            self._lap("refractive")

    def _add_light(self, here: Paths, n: int, spare: Paths) -> None:
        """Add the light that nothing stops; the shadow rays are packed in the memory of a spare record of paths."""
        n = compaction.pack_shadow_rays(self.incident, n, self.grid, self.order, spare)
        self._lap("light")
        self._query(self.scene.shadow_bvh, spare.rays.o, spare.rays.d, spare.pdf, n)
        self._lap("shadow")
        compaction.add_light(here, n, self.incident, self.order, self.radiance)
        self._lap("light")

    def _query(self, bvh: BVH, o: NDArray[Any], d: NDArray[Any], tmax: NDArray[Any], n: int) -> None:
        """Whether shadow rays meet anything in a tree."""
        limits = Columns(self.zero, 0, 0, 0), Columns(tmax, 0, 1, 0)
        rays = Rays(self._columns(o), self._columns(d), *limits)
        query.any_hit(bvh.tree, rays, self.incident.occluded, n, self.shadow_work[id(bvh)])
        self.rays["shadow"] += n

    def _lap(self, name: str) -> None:
        now = time.perf_counter()
        self.seconds[name] += now - self._clock
        self._clock = now

    def _columns(self, array: NDArray[np.floating]) -> Columns:
        return Columns(array, 0, 1, self._rows)

    def _closest(self, here: Paths, origins: Columns, n: int, bvh: BVH) -> None:
        limits = Columns(self.zero, 0, 0, 0), Columns(self.infinity, 0, 0, 0)
        rays = Rays(origins, self._columns(here.rays.d), *limits)
        work = self.work if bvh is self.scene.bvh else self.first_work
        query.closest_hit(bvh.tree, rays, here.rays.hits, n, work)
        self._lap("closest hit")


def _paths(memory: ColumnMemory) -> Paths:
    rays = memory.take_batch()
    rest = memory.take(3), memory.take(), memory.take()
    return Paths(rays, *rest, *(memory.take(dtype=kind) for kind in (np.uint32, np.uint32, np.int32)))


def _incident(memory: ColumnMemory) -> Incident:
    rays = memory.take(dtype=np.int32), memory.take(3), memory.take(3), memory.take()
    return Incident(*rays, memory.take(3), memory.take(3), memory.take(), memory.take(dtype=np.bool_))
