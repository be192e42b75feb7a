"""Trace one sample with the wavefront of path tracing, and record every vertex of its path."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.accel.lanes import PACKET, packet_width
from raytrace.passes import environment, lights, paths
from raytrace.passes.path_records import Paths
from raytrace.passes.sampling import make_sampler
from raytrace.passes.textures import varied
from raytrace.records import DIELECTRIC, DIFFUSE, REFRACTIVE, SCATTERING, Columns
from raytrace.rendering.compiled_scene import paths_of
from raytrace.rendering.path_scene import PathScene
from raytrace.rendering.path_wavefront import PathWavefront
from raytrace.scene.tables import light_number
from raytrace.show.path_steps import BLACK, ShadowRay, Step, Steps, TracedRay, describe, passage
from raytrace.show.prepared_scene import PreparedScene


class _LightSample(NamedTuple):
    """A light that was sampled at a vertex, as computed by the wavefront."""

    row: int  # of the table of lights
    o: NDArray[np.floating]
    d: NDArray[np.floating]
    wi: NDArray[np.floating]
    tmax: float  # -1: the light sends nothing here
    incident: NDArray[np.floating]  # radiance / pdf
    pdf: float
    cosine: float  # at the surface, to the shading normal
    sent: bool = False
    occluded: bool = False
    added: NDArray[np.floating] = BLACK


class _Vertex(NamedTuple):
    """A ray of a path and what happened where it arrived."""

    ray: TracedRay
    throughput: NDArray[np.floating]  # before the hit
    pdf: float
    state: int
    added: NDArray[np.floating]  # by what the ray met
    after: NDArray[np.floating] | None = None  # throughput with which a material sends the path on; None: it does not
    light: _LightSample | None = None


class _PathRecorder(PathWavefront):
    """A wavefront whose paths are all the same; it records the first one."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.met: list[_Vertex] = []

    def first(self, field: NDArray[np.floating]) -> NDArray[np.floating]:
        """Components x, y and z of the first path."""
        return field.reshape(3, -1)[:, 0].copy()

    def _note(self, **fields: Any) -> None:
        self.met[-1] = self.met[-1]._replace(**fields)

    def _gain(self) -> NDArray[np.floating]:
        """Set the radiance to 0, so that what a pass adds is seen without rounding; what it was."""
        before = self.radiance.copy()
        self.radiance[:] = 0
        return before

    def _closest(self, here: Paths, origins: Columns, n: int, bvh: BVH) -> None:
        super()._closest(here, origins, n, bvh)
        o = origins.data[origins.start + origins.axis * np.arange(3)]
        ray = TracedRay(o, self.first(here.rays.d), *(column[0] for column in here.rays.hits))
        self.met.append(_Vertex(ray, self.first(here.throughput), float(here.pdf[0]), int(here.state[0]), BLACK))

    def _see(self, here: Paths, n: int, depth: int) -> None:
        before = self._gain()
        super()._see(here, n, depth)
        self._note(added=self.first(self.radiance))
        self.radiance[:] += before

    def _pick_lights(self, here: Paths, n: int, depth: int) -> None:
        super()._pick_lights(here, n, depth)
        incident = self.incident
        if incident.light[0] >= 0:
            o, d, wi = (self.first(field) for field in (incident.o, incident.d, incident.wi))
            sample = float(incident.tmax[0]), self.first(incident.radiance), float(incident.pdf[0])
            cosine = float(wi @ self.first(self.vertices.ns))
            self._note(light=_LightSample(int(incident.light[0]), o, d, wi, *sample, cosine))

    def _scatter(self, here: Paths, n: int, depth: int) -> None:
        super()._scatter(here, n, depth)
        if not here.state[0] & paths.DEAD:
            self._note(after=self.first(here.throughput))
        if self.met[-1].light is not None:
            self._note(light=self.met[-1].light._replace(sent=bool(self.incident.tmax[0] > 0)))

    def _add_light(self, here: Paths, n: int, spare: Paths) -> None:
        before = self._gain()
        super()._add_light(here, n, spare)
        sample = self.met[-1].light
        if sample is not None:
            occluded = bool(sample.sent and self.incident.occluded[0])
            self._note(light=sample._replace(occluded=occluded, added=self.first(self.radiance)))
        self.radiance[:] += before


def follow_path(prepared: PreparedScene, pixel: tuple[int, int], sample: int) -> Steps:
    """Trace a sample of a pixel; the numbers are those of ``render``."""
    settings = prepared.settings
    scene = paths_of(prepared.scene, prepared.compiled, settings.integrator)
    assert scene is not None
    sampler = make_sampler(settings.sampler, settings.seed, settings.spp)
    recorder = _PathRecorder(scene, prepared.view, sampler, PACKET)
    x, y = (np.full(PACKET, number, np.uint32) for number in pixel)
    recorder.add_samples(x, y, sample, sample + 1, np.zeros((12, PACKET)), 0)
    met = recorder.met
    path = tuple(_step(prepared, scene, k, met) for k in range(len(met)))
    shadows = tuple(_shadow(prepared, scene, k, vertex) for k, vertex in enumerate(met) if vertex.light)
    return Steps(path, shadows, recorder.first(recorder.radiance), traced=True)


def _step(prepared: PreparedScene, scene: PathScene, k: int, met: list[_Vertex]) -> Step:
    """Describe vertex number k."""
    vertex, following = met[k], met[k + 1] if k + 1 < len(met) else None
    onward = None if following is None else following.ray.d
    step = describe(prepared, vertex.ray, onward)
    step = step._replace(throughput=vertex.throughput, pdf=vertex.pdf)
    radiance = _radiance_met(scene, step, vertex.ray)
    if vertex.added.any():
        channel = int(np.argmax(radiance * vertex.throughput))
        weight = vertex.added[channel] / (radiance * vertex.throughput)[channel]
        step = step._replace(added=vertex.added, weight=float(weight))
    if following is not None and vertex.after is not None and following.throughput.any():
        channel = int(np.argmax(following.throughput))
        step = step._replace(survival=float(vertex.after[channel] / following.throughput[channel]))
    return step if step.prim_id < 0 else step._replace(event=_event(scene, k, vertex, step))


def _radiance_met(scene: PathScene, step: Step, ray: TracedRay) -> NDArray[np.floating]:
    """Radiance of what a ray meets: a lamp's, the environment's or the background's."""
    if step.prim_id >= 0:
        return _emission(scene, ray)
    if scene.image is not None:
        colour, _ = environment.seen(scene.image, tuple(step.d[:, None].astype(scene.image.texels.dtype)))
        return np.array(colour)[:, 0]
    if scene.environment is not None:
        return scene.environment[:3]
    return BLACK if scene.background is None else scene.background


def _emission(scene: PathScene, ray: TracedRay) -> NDArray[np.floating]:
    """Radiance of the surface that a ray meets."""
    row = scene.shading.material_id[ray.prim_id]
    constant = scene.surfaces.emission.reshape(-1, 3)[row]
    if scene.lamp_textures is None:
        return constant
    dtype, lanes = constant.dtype, packet_width(constant)  # as a packet of equal lanes
    point = np.full(lanes, ray.prim_id, np.int32), np.full(lanes, ray.u, dtype), np.full(lanes, ray.v, dtype)
    values = tuple(np.full(lanes, value, dtype) for value in constant)
    textures = scene.lamp_textures
    colour = varied(textures, textures.emission, np.full(lanes, row, np.int32), point, values)
    return np.array(colour)[:, 0]


def _event(scene: PathScene, k: int, vertex: _Vertex, step: Step) -> str:
    """What happens at the surface that ray number k meets."""
    if vertex.state & paths.ENDING:
        return "stops: direct light only"
    if k == scene.max_depth:
        return "stops: max_depth"
    front = bool(step.ng @ scene.bvh.triangles[step.prim_id, 9:] > 0)
    row = scene.shading.material_id[step.prim_id]
    kind = scene.surfaces.kind[row]
    if kind in SCATTERING:
        if not front and not scene.surfaces.two_sided[row]:
            return "meets the back: black"
        if scene.integrator != "path":
            return "lands"
        if vertex.after is None:
            return "stops: below the surface"
        return _stop(scene, k) if step.onward is None else "scatters"
    if step.onward is None:
        return _stop(scene, k)
    if kind == REFRACTIVE:
        return passage(front, step.onward, step.ng)
    if kind == DIELECTRIC and not (step.onward @ step.ng > 0 and np.sin(np.radians(step.angle_in)) < step.eta):
        return passage(front, step.onward, step.ng)
    return "is reflected"


def _stop(scene: PathScene, k: int) -> str:
    return "stops: max_depth" if k + 1 == scene.max_depth else "stops: roulette"


def _shadow(prepared: PreparedScene, scene: PathScene, k: int, vertex: _Vertex) -> ShadowRay:
    """Describe the shadow ray of vertex number k; a blocked one ends at the nearest triangle."""
    sample, table = vertex.light, scene.lights
    assert sample is not None
    assert table is not None
    light, name = _light_of(prepared, scene, sample.row)
    ray = ShadowRay(light, sample.o, sample.d, "reaches", sample.tmax, BLACK, sample.added, name, k, sample.pdf)
    ray = ray._replace(far=np.isinf(sample.tmax))
    if sample.tmax < 0:
        return ray._replace(event="sends nothing here", t=np.nan, pdf=np.nan, weight=np.nan)
    ratio = sample.cosine / np.pi / sample.pdf
    diffuse = scene.surfaces.kind[scene.shading.material_id[vertex.ray.prim_id]] == DIFFUSE
    ray = ray._replace(
        weight=float(1 / (1 + ratio * ratio)) if diffuse else np.nan
    )  # the density of others is not kept
    if not sample.sent:
        return ray._replace(event="faces away", t=np.nan)
    if sample.occluded:
        hit = scene.shadow_bvh.closest_hit(sample.o[None], sample.d[None], tmax=sample.tmax)
        return ray._replace(event="blocked", t=float(hit.t[0]))
    return ray._replace(irradiance=sample.incident * sample.cosine)


def _light_of(prepared: PreparedScene, scene: PathScene, row: int) -> tuple[int, str]:
    """Row of the scene's lights, -1 for a lamp, and a name of a row of the table of lights."""
    table, given = scene.lights, prepared.scene.lights
    assert table is not None
    kind = int(table.kind[row])
    if kind == lights.TRIANGLE:
        return -1, f"lamp: triangle {table.prim_id[row]}"
    earlier = {lights.POINT: 0, lights.SPOT: len(given.flux)}
    earlier[lights.DIRECTIONAL] = earlier[lights.SPOT] + (0 if given.spots is None else len(given.spots.cutoff))
    other = 0 if given.directions is None else len(given.directions.direction)
    earlier[lights.ENVIRONMENT] = earlier[lights.DIRECTIONAL] + other
    names = {lights.POINT: "point", lights.SPOT: "spot", lights.DIRECTIONAL: "directional"}
    number = light_number(given, earlier[kind] + _row_of_kind(prepared, table, row))
    return number, f"lights[{number}]: {names.get(kind, 'environment')}"


def _row_of_kind(prepared: PreparedScene, table: Any, row: int) -> int:
    """Row of a light among those of its kind in the scene; the table lacks lights of no power."""
    given, kind = prepared.scene.lights, int(table.kind[row])
    colours = {lights.POINT: given.flux}
    if given.spots is not None:
        colours[lights.SPOT] = given.spots.intensity
    if given.directions is not None:
        colours[lights.DIRECTIONAL] = given.directions.irradiance
    if kind not in colours:
        return 0
    shining = np.flatnonzero(colours[kind].any(axis=1))
    return int(shining[np.count_nonzero(table.kind[:row] == kind)])
