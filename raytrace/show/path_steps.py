"""Trace one sample with the wavefront of ``render``, and record every step of its path."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.bvh import BVH
from raytrace.accel.lanes import PACKET
from raytrace.errors import printable
from raytrace.passes.sampling import make_sampler
from raytrace.records import DIELECTRIC, REFRACTIVE, Batch, Columns
from raytrace.rendering.wavefront import Wavefront
from raytrace.scene.path_plan import needs_paths
from raytrace.show.prepared_scene import PreparedScene

ONE, BLACK = np.ones(3), np.zeros(3)
ONE.flags.writeable = BLACK.flags.writeable = False


class Step(NamedTuple):
    """A ray of the path and its hit; points, normals and angles are NaN for a miss."""

    o: NDArray[np.floating]  # (3,) f, world units
    d: NDArray[np.floating]  # (3,) f: unit
    t: float  # world units; inf: a miss
    prim_id: int  # row of the faces; -1: a miss
    p: NDArray[np.floating]  # (3,) f, world units
    ng: NDArray[np.floating]  # (3,) f: unit geometric normal, on the ray's side
    ns: NDArray[np.floating]  # (3,) f: unit shading normal, on the ray's side
    material: str
    event: str  # what happens at the hit
    onward: NDArray[np.floating] | None  # (3,) f: unit direction of the next ray; None: the path ends
    eta: float  # transmitted / incident; NaN where nothing is refracted
    angle_in: float  # degrees, to the shading normal
    angle_out: float  # degrees; NaN where the path ends
    throughput: NDArray[np.floating] = ONE  # (3,) f: of the path before the hit: factor of the light along the ray
    pdf: float = np.inf  # 1 / sr: density of d; inf: a camera ray, or after a perfectly specular surface
    added: NDArray[np.floating] = BLACK  # (3,) f: what the sample gains of the light that the ray meets
    weight: float = np.nan  # of that light, by multiple importance sampling; NaN: there is none
    survival: float = 1.0  # probability with which Russian roulette let the path go on after the hit


class ShadowRay(NamedTuple):
    """A shadow ray from a surface that scatters to a light."""

    light: int  # row of the scene's lights; -1: a lamp
    o: NDArray[np.floating]  # (3,) f, world units
    d: NDArray[np.floating]  # (3,) f, world units: to the light at t = 1; unit length to a light infinitely far away
    event: str  # "reaches", "blocked", "faces away", or "sends nothing here"
    t: float  # its end: 1, inf, or the hit that blocks it; NaN if there is no ray
    irradiance: NDArray[np.floating]  # (3,) f, W / m^2: at the surface, divided by the density
    radiance: NDArray[np.floating]  # (3,) f: contribution to the sample
    name: str = ""  # of the light
    step: int = 0  # row of the path: where it starts
    pdf: float = np.inf  # 1 / sr: density of its direction, with the probability of the light; inf: a light of no size
    weight: float = 1.0  # by multiple importance sampling
    far: bool = False  # the light is infinitely far away


class Steps(NamedTuple):
    """One sample of one pixel."""

    path: tuple[Step, ...]
    shadows: tuple[ShadowRay, ...]
    radiance: NDArray[np.floating]  # (3,) f: of the sample
    traced: bool = False  # by path tracing


class TracedRay(NamedTuple):
    """A ray and its hit, as computed by the wavefront."""

    o: NDArray[np.floating]
    d: NDArray[np.floating]
    t: float
    prim_id: int
    u: float
    v: float


class _TracedShadow(NamedTuple):
    """A shadow ray and its result, as computed by the wavefront."""

    o: NDArray[np.floating]
    d: NDArray[np.floating]
    sent: bool
    occluded: bool
    irradiance: float  # per flux
    added: NDArray[np.floating]


class _Recorder(Wavefront):
    """A wavefront whose rays are all the same; it records the first one."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.sent: list[TracedRay] = []
        self.lit: list[_TracedShadow] = []

    def first(self, field: NDArray[np.floating]) -> NDArray[np.floating]:
        """Components x, y and z of the first ray."""
        return field.reshape(3, -1)[:, 0].copy()

    def _closest(self, batch: Batch, origins: Columns, count: int, bvh: BVH) -> None:
        super()._closest(batch, origins, count, bvh)
        o = origins.data[origins.start + origins.axis * np.arange(3)]
        self.sent.append(TracedRay(o, self.first(batch.d), *(column[0] for column in batch.hits)))

    def _light(self, number: int) -> None:
        before = self.first(self.radiance)
        super()._light(number)
        ray, added = self.shadows, self.first(self.radiance) - before
        o, d = self.first(ray.o), self.first(ray.d)
        self.lit.append(
            _TracedShadow(o, d, bool(ray.tmax[0] > 0), bool(ray.occluded[0]), float(ray.irradiance[0]), added)
        )


def follow(prepared: PreparedScene, pixel: tuple[int, int], sample: int) -> Steps:
    """Trace a sample of a pixel; the numbers are those of ``render``."""
    settings = prepared.settings
    if needs_paths(prepared.scene, settings.integrator):
        from raytrace.show.path_vertices import follow_path

        return follow_path(prepared, pixel, sample)
    sampler = make_sampler(settings.sampler, settings.seed, settings.spp)
    recorder = _Recorder(prepared.compiled, prepared.view, sampler, PACKET)
    x, y = (np.full(PACKET, number, np.uint32) for number in pixel)
    recorder.add_samples(x, y, sample, sample + 1, np.zeros((12, PACKET)), 0)
    onward = [ray.d for ray in recorder.sent[1:]] + [None]
    path = tuple(_step(prepared, ray, next_d) for ray, next_d in zip(recorder.sent, onward, strict=True))
    landed = "lands" in path[-1].event
    shadows = tuple(_shadow(prepared, number, ray) for number, ray in enumerate(recorder.lit)) if landed else ()
    shadows = tuple(ray._replace(name=f"lights[{ray.light}]: point", step=len(path) - 1) for ray in shadows)
    return Steps(path, shadows, recorder.first(recorder.radiance))


def _step(prepared: PreparedScene, ray: TracedRay, onward: NDArray[np.floating] | None) -> Step:
    """Describe a ray, its hit and the next direction."""
    step = describe(prepared, ray, onward)
    if step.prim_id < 0:
        background = prepared.compiled.background
        return step._replace(added=background, weight=1.0) if background.any() else step
    row = prepared.scene.mesh.material_id[step.prim_id]
    front = step.ng @ prepared.compiled.bvh.triangles[step.prim_id, 9:] > 0
    if not np.isnan(step.eta):
        return step._replace(event=passage(bool(front), onward, step.ng))
    seen = front or prepared.scene.materials.two_sided[row]
    return step._replace(event="lands" if seen else "meets the back: black")


def describe(prepared: PreparedScene, ray: TracedRay, onward: NDArray[np.floating] | None) -> Step:
    """Describe a ray, its hit and the next direction, but not what happens there."""
    o, d, t, prim_id, u, v = ray
    nothing = np.full(3, np.nan)
    if prim_id < 0:
        return Step(o, d, np.inf, -1, nothing, nothing, nothing, "", "leaves the scene", None, np.nan, np.nan, np.nan)
    scene, triangle = prepared.scene, prepared.compiled.bvh.triangles[prim_id]
    p, ng = triangle[:3] + (u * (triangle[3:6] - triangle[:3]) + v * (triangle[6:9] - triangle[:3])), triangle[9:]
    ns = ng
    if scene.mesh.normals is not None:
        ns = np.array([1 - u - v, u, v]) @ scene.mesh.normals[prim_id]
        ns = ns / np.linalg.norm(ns)
    side = 1 if d @ ng < 0 else -1
    row = scene.mesh.material_id[prim_id]
    eta = np.nan
    if scene.materials.kind[row] in (REFRACTIVE, DIELECTRIC):
        eta = scene.materials.ior[row] if side > 0 else 1 / scene.materials.ior[row]
    out = np.nan if onward is None else _degrees(abs(onward @ ns))
    name = printable(scene.materials.name[row])
    angle = _degrees(-d @ ns * side)
    return Step(o, d, float(t), int(prim_id), p, side * ng, side * ns, name, "", onward, float(eta), angle, out)


def passage(front: bool, onward: NDArray[np.floating] | None, ng: NDArray[np.floating]) -> str:
    """What happens at an interface; ``ng`` is on the side of the ray."""
    if onward is None:
        return "stops: max_depth"
    if onward @ ng > 0:
        return "is reflected totally"
    return "enters" if front else "leaves"


def _degrees(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _shadow(prepared: PreparedScene, number: int, ray: _TracedShadow) -> ShadowRay:
    """Describe the shadow ray to a light; a blocked one ends at the nearest triangle."""
    arriving = ray.irradiance * prepared.compiled.light_flux[number]
    if not ray.sent:
        return ShadowRay(number, ray.o, ray.d, "faces away", np.nan, 0 * arriving, ray.added)
    if not ray.occluded:
        return ShadowRay(number, ray.o, ray.d, "reaches", 1.0, arriving, ray.added)
    blocker = prepared.compiled.shadow_bvhs[number].closest_hit(ray.o[None], ray.d[None], tmax=1.0)
    return ShadowRay(number, ray.o, ray.d, "blocked", float(blocker.t[0]), 0 * arriving, ray.added)
