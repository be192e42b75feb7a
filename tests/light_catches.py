"""Bugs of light transport, planted between the passes, so that no kernel is compiled again."""

import numpy as np

from raytrace.passes import lights
from raytrace.rendering import path_wavefront

Usual = path_wavefront.PathWavefront


def numbers(scene):
    return scene.lights.numbers.reshape(-1, lights.COLUMNS)


def brighter(scene):
    surfaces = scene.surfaces._replace(emission=np.float32(1.03) * scene.surfaces.emission)
    if scene.lights is None:
        return scene._replace(surfaces=surfaces)
    table = numbers(scene).copy()
    table[:, :3] *= 1.03
    return scene._replace(surfaces=surfaces, lights=scene.lights._replace(numbers=table.ravel()))


def a_depth_less(scene):
    return scene._replace(max_depth=scene.max_depth - 1)


def weights_do_not_sum_to_one(scene):
    return scene._replace(surfaces=scene.surfaces._replace(density=np.float32(0.5) * scene.surfaces.density))


class BothSidesShine(Usual):
    def _see(self, here, n, depth):
        super()._see(here, n, depth)
        whole = self.scene
        triangles = whole.shading.triangles.copy()
        triangles.reshape(-1, 12)[:, 9:] *= -1
        if whole.lamps:
            other = whole.shading._replace(triangles=triangles)
            path_wavefront.paths.see_lamps(here, n, other, whole.surfaces, whole.lamp_textures, self.radiance)


class NoFactorOfRadiance(Usual):
    def _scatter(self, here, n, depth):
        super()._scatter(here, n, depth)
        here.throughput.reshape(3, -1)[:, :n] /= here.scale[:n]
        here.scale[:n] = 1


class RouletteWithoutCompensation(Usual):
    def add_samples(self, *batch):
        self.before = None
        super().add_samples(*batch)

    def _closest(self, here, origins, n, bvh):
        """As ``go_on`` left them: the largest throughput is 1 where a path survived by chance."""
        throughput = here.throughput.reshape(3, -1)
        before = self.before
        if before is not None and before[0] >= path_wavefront.paths.ROULETTE_FROM:
            throughput[:, :n] = np.minimum(throughput[:, :n], before[1][:, here.rays.slot[:n]])
        super()._closest(here, origins, n, bvh)

    def _scatter(self, here, n, depth):
        super()._scatter(here, n, depth)
        by_slot = np.zeros((3, self._rows), here.throughput.dtype)
        by_slot[:, here.rays.slot[:n]] = here.throughput.reshape(3, -1)[:, :n]
        self.before = depth, by_slot


class CosineTwice(Usual):
    def _pick_lights(self, here, n, depth):
        super()._pick_lights(here, n, depth)
        cosine = np.sum(self.incident.wi.reshape(3, -1) * self.vertices.ns.reshape(3, -1), axis=0)
        self.incident.radiance.reshape(3, -1)[:] *= np.nan_to_num(cosine)


class AreaDensity(Usual):
    def _pick_lights(self, here, n, depth):
        super()._pick_lights(here, n, depth)
        if lights.TRIANGLE in self.scene.light_kinds:
            wrong = numbers(self.scene)[np.maximum(self.incident.light, 0), lights.DENSITY]
            self.incident.radiance.reshape(3, -1)[:] *= self.incident.pdf / wrong
            self.incident.pdf[:] = wrong


def planted(change):
    class Planted(Usual):
        def __init__(self, scene, *rest):
            super().__init__(change(scene), *rest)

    return Planted


BUGS = {
    "light 3 % brighter": planted(brighter),
    "both sides shine": BothSidesShine,
    "no factor (n_from / n_to)^2": NoFactorOfRadiance,
    "a depth less": planted(a_depth_less),
    "weights do not sum to one": planted(weights_do_not_sum_to_one),
    "roulette without compensation": RouletteWithoutCompensation,
    "cosine twice": CosineTwice,
    "area density not converted": AreaDensity,
}
