"""Path tracing: all the light, by random paths from the camera, with multiple importance sampling of lamps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.records import (
    DIELECTRIC,
    DIFFUSE,
    MIRROR,
    PLASTIC,
    REFRACTIVE,
    ROUGH_CONDUCTOR,
    ROUGH_DIELECTRIC,
    Hits,
    Scene,
)
from raytrace.scene.path_plan import needs_lens
from raytrace.textbook.sampling import cosine_hemisphere, power_heuristic, to_world, uniform_triangle
from raytrace.textbook.shading import Point, dot, offset_origin, pass_interface, reflect, refract, surface_at
from raytrace.textbook.tree import Tree, traverse

F8 = NDArray[np.floating]
ROULETTE_FROM = 3  # surfaces
KNOWN = (DIFFUSE, REFRACTIVE, MIRROR, DIELECTRIC)


class Lamps:
    """The triangles of a scene that emit light, drawn by their power pi A L."""

    def __init__(self, scene: Scene) -> None:
        of_materials = scene.materials.emission
        emission = np.zeros((len(scene.materials.kind), 3)) if of_materials is None else of_materials
        self.emission = emission[scene.mesh.material_id]  # of each triangle
        self.prim_id = np.flatnonzero(self.emission.any(axis=1))
        self.corners = scene.mesh.vertices[scene.mesh.faces[self.prim_id]]
        cross = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        self.normal, area = cross / length, length[:, 0] / 2
        power = area * self.emission[self.prim_id].sum(axis=1)
        self.cdf = np.cumsum(power) / max(power.sum(), 1e-300)
        self.density = np.zeros(len(scene.mesh.faces))  # 1 / area of a point on each triangle of the scene
        self.density[self.prim_id] = power / max(power.sum(), 1e-300) / area

    def seen(self, prim_id: NDArray[np.integer], t: F8, cos: F8, pdf: F8) -> F8:
        """Emission that paths see where they meet triangles, weighted by the power heuristic.

        ``pdf`` is the density of their direction; density t^2 / cos is that of the same direction by ``sample``.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.where(np.isinf(pdf), 1.0, power_heuristic(pdf, self.density[prim_id, None] * t**2 / cos))
        return np.where(cos > 0, self.emission[prim_id] * weight, 0)

    def sample(self, u: F8) -> tuple[F8, F8, NDArray[np.int64]]:
        """Points on lamps, their normals, and the triangles; from random numbers (n, 3)."""
        row = np.minimum(np.searchsorted(self.cdf, u[:, 0], side="right"), len(self.cdf) - 1)
        q = np.einsum("nk,nkc->nc", uniform_triangle(u[:, 1:]), self.corners[row])
        return q, self.normal[row], self.prim_id[row]


def next_rays(scene: Scene, point: Point, scatters: NDArray[np.bool_], rng: Any) -> tuple[F8, F8, F8, F8]:
    """Origins, directions, f cos / pdf and pdf of the rays that go on from points; factor 0 where a path ends."""
    kind = scene.materials.kind[point.material]
    o, d, factor = np.empty_like(point.p), np.empty_like(point.p), np.zeros_like(point.p)
    pdf = np.full((len(point.p), 1), np.inf)
    for rows, go_on in (
        (np.flatnonzero(scatters), scatter),
        (np.flatnonzero(kind == MIRROR), bounce),
        (np.flatnonzero(kind == DIELECTRIC), split),
        (np.flatnonzero(kind == REFRACTIVE), pass_all),
    ):
        o[rows], d[rows], factor[rows], pdf[rows] = go_on(scene, _of(point, rows), rng)
    return o, d, factor, pdf


def path_trace(scene: Scene, tree: Tree, blockers: Tree | None, o: F8, d: F8, rng: Any) -> F8:
    """Radiance (n, 3) that arrives along rays: an unbiased estimate, one path each.

    The rendering equation [Kajiya1986]: L = Le + integral of f L cos over the hemisphere. At each surface a path adds
    the light of one point on a lamp (and of all point lights), then goes on in one random direction. A lamp that it
    meets in this way counts too; the power heuristic shares between the two.

    Parameters
    ----------
    scene : Scene
    tree, blockers : Tree
        All triangles, and those that stop shadow rays.
    o, d : (n, 3) arrays
        Origins and unit directions.
    rng : numpy.random.Generator

    Raises
    ------
    OptionError
        The scene holds what this textbook does not have, by name.
    """
    refuse(scene)
    lamps = Lamps(scene)
    radiance, throughput = np.zeros_like(o), np.ones_like(o)
    path = np.arange(len(o))  # the row of each ray that is under way; all arrays below have a row for each of these
    pdf = np.full((len(o), 1), np.inf)  # density of d per solid angle; inf: no choice
    specular = np.ones(len(o), bool)  # only perfectly specular surfaces so far
    for depth in range(scene.settings.max_depth + 1):
        hits = traverse(tree, o, d)
        met = np.flatnonzero(hits.prim_id >= 0)
        gone = np.flatnonzero((hits.prim_id < 0) & specular)
        if depth < scene.settings.max_depth:
            radiance[path[gone]] += throughput[gone] * scene.background
        t, prim_id = hits.t[met, None], hits.prim_id[met]
        point = surface_at(scene, Hits(hits.t[met], prim_id, hits.u[met], hits.v[met]), d[met])
        path, throughput, pdf, specular = path[met], throughput[met], pdf[met], specular[met]

        radiance[path] += throughput * lamps.seen(prim_id, t, -dot(point.d, point.ng), pdf)
        if depth == scene.settings.max_depth or not len(path):
            break

        front = dot(point.d, point.ng)[:, 0] < 0
        kind = scene.materials.kind[point.material]
        scatters = (kind == DIFFUSE) & (front | scene.materials.two_sided[point.material])
        rows = np.flatnonzero(scatters)
        seen = _of(point, rows)
        radiance[path[rows]] += throughput[rows] * light_at(scene, blockers, lamps, seen, rng)

        o, d, factor, pdf = next_rays(scene, point, scatters, rng)
        throughput, specular = throughput * factor, specular & ~scatters
        chance = np.ones(len(path)) if depth < ROULETTE_FROM else np.clip(throughput.max(axis=1), 0.05, 1)
        alive = np.flatnonzero((throughput.max(axis=1) > 0) & (rng.random(len(path)) < chance))
        throughput = throughput / chance[:, None]  # Russian roulette: the expectation stays
        o, d, path = o[alive], d[alive], path[alive]
        throughput, pdf, specular = throughput[alive], pdf[alive], specular[alive]
    return radiance


def _of(point: Point, rows: NDArray[np.int64]) -> Point:
    return Point(point.p[rows], point.ng[rows], point.ns[rows], point.d[rows], point.material[rows])


def refuse(scene: Scene) -> None:
    """Refuse, by name, what only the kernels have."""
    kinds = scene.materials.kind[np.unique(scene.mesh.material_id)]
    lacking = {
        "rough surfaces": np.isin(kinds, (ROUGH_DIELECTRIC, ROUGH_CONDUCTOR)).any(),
        "plastic": (kinds == PLASTIC).any(),
        "materials other than diffuse, refractive, mirror and dielectric": not np.isin(kinds, KNOWN).all(),
        "spot lights": scene.lights.spots is not None,
        "directional lights": scene.lights.directions is not None,
        "transparent shadows among lamps": bool(
            scene.materials.emission is not None and scene.materials.transparent_shadow[scene.mesh.material_id].any()
        ),
        "environments": scene.lights.environment is not None,
        "textures": scene.textures is not None,
        "lenses, orthographic cameras and filters": needs_lens(scene),
    }
    for what, found in lacking.items():
        if found:
            raise OptionError(f"raytrace.textbook does not have {what}; use raytrace.render")


def light_at(scene: Scene, blockers: Tree | None, lamps: Lamps, point: Point, rng: Any) -> F8:
    """Light (n, 3) that diffuse surfaces reflect: of one point on a lamp, and of each point light."""
    side = np.where(dot(point.d, point.ng) < 0, 1.0, -1.0)
    ng, ns = side * point.ng, side * point.ns
    f = scene.materials.albedo[point.material] / math.pi
    total = np.zeros_like(point.p)
    for position, flux in zip(scene.lights.position, scene.lights.flux, strict=True):
        to_light = position - point.p
        r2 = dot(to_light, to_light)
        cos = np.where(dot(to_light, ng) > 0, dot(to_light, ns) / np.sqrt(r2), 0)
        total += visible(scene, blockers, point.p, ng, to_light) * f * flux / (4 * math.pi * r2) * np.maximum(cos, 0)
    if len(lamps.prim_id):
        q, nl, prim_id = lamps.sample(rng.random((len(point.p), 3)))
        to_light = q - point.p
        r2 = dot(to_light, to_light)
        wi = to_light / np.sqrt(r2)
        cos, cos_lamp = np.where(dot(wi, ng) > 0, dot(wi, ns), 0), -dot(wi, nl)
        lit = (cos > 0) & (cos_lamp > 0)
        cos, cos_lamp = np.where(lit, cos, 0), np.where(lit, cos_lamp, 1)
        pdf = lamps.density[prim_id, None] * r2 / cos_lamp  # from area to solid angle
        weight = power_heuristic(pdf, cos / math.pi)
        total += visible(scene, blockers, point.p, ng, to_light) * f * lamps.emission[prim_id] * cos * weight / pdf
    return total


def visible(scene: Scene, blockers: Tree | None, p: F8, ng: F8, to_light: F8) -> F8:
    """1 where nothing lies between points and lights, else 0: (n, 1)."""
    if blockers is None:
        return np.ones((len(p), 1))
    o = offset_origin(scene, p, ng, to_light)
    return np.where(traverse(blockers, o, p + to_light - o, 1 - 1e-6).prim_id < 0, 1.0, 0.0)[:, None]


# How paths go on: origin, direction, f cos / pdf, and pdf -------------------------------------------------------------


def scatter(scene: Scene, point: Point, rng: Any) -> tuple[F8, F8, F8, F8]:
    """Diffuse: f cos / pdf = (albedo / pi) cos / (cos / pi) = albedo."""
    side = np.where(dot(point.d, point.ng) < 0, 1.0, -1.0)
    w, pdf = cosine_hemisphere(rng.random((len(point.p), 2)))
    d = to_world(side * point.ns, w)
    above = dot(d, side * point.ng) > 0
    return offset_origin(scene, point.p, point.ng, d), d, above * scene.materials.albedo[point.material], pdf


def bounce(scene: Scene, point: Point, rng: Any) -> tuple[F8, F8, F8, F8]:
    """Mirror: one direction."""
    d = _mirrored(point)
    return offset_origin(scene, point.p, point.ng, d), d, scene.materials.albedo[point.material], _certain(point)


def split(scene: Scene, point: Point, rng: Any) -> tuple[F8, F8, F8, F8]:
    """Dielectric: reflection with the probability of Fresnel's reflectance, else transmission.

    The share of the light cancels against the probability. Radiance is compressed by 1 / eta^2 when it is transmitted
    towards the camera [Veach1997, 5.2].
    """
    entering = dot(point.d, point.ng) < 0
    ior = scene.materials.ior[point.material][:, None]
    eta = np.where(entering, ior, 1 / ior)
    n = np.where(entering, point.ns, -point.ns)
    through, total = refract(point.d, n, eta)
    reflects = total[:, None] | (rng.random((len(point.p), 1)) < fresnel(-dot(point.d, n), eta))
    d = np.where(reflects, _mirrored(point), through)
    factor = np.where(reflects, 1.0, 1 / eta**2) * np.ones_like(point.p)
    return offset_origin(scene, point.p, point.ng, d), d, factor, _certain(point)


def fresnel(cos_i: F8, eta: F8) -> F8:
    """Reflectance of a dielectric for unpolarised light: the mean of r_s^2 and r_p^2 [Pharr2023, 9.3.5].

    Examples
    --------
    >>> import numpy as np
    >>> fresnel(np.array([1.0, 0.0]), 1.5)
    array([0.04, 1.  ])
    """
    cos_t = np.sqrt(np.maximum(1 - (1 - cos_i**2) / eta**2, 0))
    rs = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    rp = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return (rs**2 + rp**2) / 2


def pass_all(scene: Scene, point: Point, rng: Any) -> tuple[F8, F8, F8, F8]:
    """The ideal interface of the course: all light goes through, or is reflected where that is total."""
    return *pass_interface(scene, point), np.ones_like(point.p), _certain(point)


def _mirrored(point: Point) -> F8:
    n = np.where(dot(point.d, point.ng) < 0, point.ns, -point.ns)
    return reflect(point.d, n)


def _certain(point: Point) -> F8:
    return np.full((len(point.p), 1), np.inf)
