"""The slow, obvious twin of path tracing: NumPy, float64, every ray against every triangle.

No light is sampled, so there is nothing to weight: light counts where a path meets it. Directions are uniform over the
hemisphere, and no path is ended by chance. What remains is the rendering equation, surface by surface. Scenes may hold
lamps, an environment and a background, and all materials that are diffuse or perfectly specular.
"""

import math

import numpy as np
from numpy.typing import NDArray

import naive
from naive import F8, dot, unit
from raytrace.records import CONDUCTOR, DIELECTRIC, DIFFUSE, MIRROR, REFRACTIVE, Mesh, Scene


class Paths:
    """Paths in flight; all arrays have a row per path."""

    def __init__(self, o: F8, d: F8) -> None:
        self.o, self.d, self.weight = o, d, np.ones_like(o)
        self.row = np.arange(len(o))  # of the result
        self.specular = np.ones(len(o), bool)  # has met perfectly specular surfaces only
        self.straight = np.zeros(len(o), bool)  # since it scattered, has met nothing but surfaces that shadow rays pass

    def keep(self, which: NDArray) -> None:
        for name, value in vars(self).items():
            setattr(self, name, value[which])


def radiance(scene: Scene, o: F8, d: F8, rng: np.random.Generator) -> F8:
    """Radiance (n, 3) along rays: one path each."""
    total, paths = np.zeros_like(o), Paths(o, d)
    passed = scene.materials.transparent_shadow[scene.mesh.material_id]
    for depth in range(1, scene.settings.max_depth + 2):
        hits = naive.closest_hit(scene.mesh.vertices, scene.mesh.faces, paths.o, paths.d)
        light = shining(scene, scene.mesh, hits.prim_id, paths.d)
        total[paths.row] += np.where(paths.straight[:, None], 0, paths.weight * light)
        missed = hits.prim_id < 0
        if scene.lights.environment is None and depth <= scene.settings.max_depth:
            total[paths.row] += np.where((missed & paths.specular)[:, None], paths.weight * scene.background, 0)
        if depth > scene.settings.max_depth:
            break
        paths.keep(~missed)
        hits = type(hits)(*(field[~missed] for field in hits))
        scatter(scene, hits, paths, rng)
        if passed.any():  # light that comes straight through such surfaces, or through none
            rows = np.flatnonzero(paths.straight & ~paths.specular & paths.fresh)
            stops = scene.mesh._replace(
                faces=scene.mesh.faces[~passed], material_id=scene.mesh.material_id[~passed], normals=None
            )
            ends = naive.closest_hit(stops.vertices, stops.faces, paths.o[rows], paths.d[rows]).prim_id
            total[paths.row[rows]] += paths.weight[rows] * shining(scene, stops, ends, paths.d[rows])
        elif len(paths.row):
            paths.straight[:] = False
    return total


def shining(scene: Scene, mesh: Mesh, prim_id: NDArray, d: F8) -> F8:
    """Radiance (n, 3) of what rays meet: the front of a lamp, or the environment."""
    light, met = np.zeros_like(d), prim_id >= 0
    if scene.lights.environment is not None:
        light[~met] = scene.lights.environment
    if scene.materials.emission is not None:
        v0, v1, v2 = np.moveaxis(mesh.vertices[mesh.faces[prim_id[met]]], 1, 0)
        front = dot(np.cross(v1 - v0, v2 - v0), d[met]) < 0
        light[met] = np.where(front[:, None], scene.materials.emission[mesh.material_id[prim_id[met]]], 0)
    return light


def scatter(scene: Scene, hits: naive.Hits, paths: Paths, rng: np.random.Generator) -> None:
    """Send paths on from the surfaces that they met, by their materials."""
    table, (p, error, ng, ns) = scene.materials, naive.surface(scene.mesh, hits)
    material = scene.mesh.material_id[hits.prim_id]
    kind, front = table.kind[material], dot(paths.d, ng) < 0
    side = np.where(front, 1.0, -1.0)[:, None]
    n, s = side * ng, side * ns
    d, factor = paths.d.copy(), np.zeros_like(p)
    through = np.zeros(len(p), bool)

    here = (kind == DIFFUSE) & (front | table.two_sided[material])
    w = rng.normal(size=p.shape)
    w = unit(w)
    w *= np.where(dot(w, s) < 0, -1.0, 1.0)[:, None]  # uniform over the hemisphere: density 1 / (2 pi)
    d[here] = w[here]
    cosine = np.where(dot(w, n) > 0, dot(w, s), 0)[:, None]
    factor[here] = (table.albedo[material] / math.pi * cosine * 2 * math.pi)[here]

    mirrored = naive.reflect(paths.d, np.where((dot(paths.d, s) < 0)[:, None], s, n))
    mirrored = np.where((dot(mirrored, n) > 0)[:, None], mirrored, naive.reflect(paths.d, n))
    cos_i = dot(unit(mirrored - paths.d), mirrored)
    shiny = (kind == MIRROR) | (kind == CONDUCTOR)
    d[shiny] = mirrored[shiny]
    factor[kind == MIRROR] = table.albedo[material][kind == MIRROR]
    if (kind == CONDUCTOR).any():
        c = kind == CONDUCTOR
        factor[c] = metal(cos_i[c, None], table.eta[material][c], table.k[material][c])

    clear = (kind == DIELECTRIC) | (kind == REFRACTIVE)
    if clear.any():
        eta = np.where(front, table.ior[material], 1 / table.ior[material])
        bent = naive.bounce(paths.d, ng, ns, table.ior[material])
        crosses = dot(bent, n) < 0
        share = np.where(crosses, np.where(kind == DIELECTRIC, glass(cos_i, eta), 0), 1)
        turns = rng.random(len(p)) < share
        through = clear & ~turns
        d[clear] = np.where((turns & crosses)[:, None], mirrored, bent)[clear]
        radiance_factor = np.where(through & (kind == DIELECTRIC), 1 / eta**2, 1.0)
        factor[clear] = np.broadcast_to(radiance_factor[:, None], p.shape)[clear]

    paths.o, paths.d = naive.spawn(p, error, ng, d), d
    paths.weight = paths.weight * factor
    paths.fresh = here
    paths.straight = here | (paths.straight & through & table.transparent_shadow[material])
    paths.specular = paths.specular & ~here
    paths.keep(factor.max(axis=1) > 0)


def glass(cos_i: F8, eta: F8) -> F8:
    """Fresnel's reflectance of a dielectric, by the angles: tan^2 and sin^2 of their difference over their sum."""
    i = np.arccos(np.clip(cos_i, 0, 1))
    i = np.maximum(i, 1e-6)
    t = np.arcsin(np.clip(np.sin(i) / eta, 0, 1))
    return (np.sin(i - t) / np.sin(i + t)) ** 2 / 2 + (np.tan(i - t) / np.tan(i + t)) ** 2 / 2


def metal(cos_i: F8, eta: F8, k: F8) -> F8:
    """Fresnel's reflectance of a conductor, in complex numbers."""
    m = eta - 1j * np.where(np.isfinite(k), k, 1e9)
    cos_t = np.sqrt(1 - (1 - cos_i**2) / m**2)
    rs, rp = (cos_i - m * cos_t) / (cos_i + m * cos_t), (m * cos_i - cos_t) / (m * cos_i + cos_t)
    return (np.abs(rs) ** 2 + np.abs(rp) ** 2) / 2


def render(scene: Scene, size: tuple[int, int], spp: int, seed: int) -> F8:
    """Image (h, w, 3): independent samples, uniform over the pixels."""
    rng = np.random.default_rng(seed)
    width, height = size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    corner = np.repeat(np.stack([x, y], axis=-1).reshape(-1, 1, 2), spp, axis=1)
    o, d = naive.camera_rays(scene.camera, size, (corner + rng.random(corner.shape)).reshape(-1, 2))
    return radiance(scene, o, d, rng).reshape(height, width, spp, 3).mean(axis=2)
