"""Last passes of a sample: direct light. Shadow rays to one point light, then what arrives, reflected."""

import numpy as np

from raytrace.accel.lanes import count, load, packet, packet_width, select, splat, sqrt, store
from raytrace.accel.vectors import dot
from raytrace.jit import kernel
from raytrace.passes.surface import load3, row_of, spawn, store3

FOUR_PI = 4.0 * np.pi


@kernel
def background(hits, radiance, colour):
    """Begin the radiance of samples: the background where a ray left the scene, else 0."""
    like = packet(radiance)
    n = len(radiance) // 3
    for i in range(0, n, packet_width(radiance)):
        escaped = load(hits.prim_id, i, like) == np.int32(-1)
        for k in range(3):
            store(radiance, k * n + i, select(escaped, splat(colour[k], like), 0.0))


@kernel
def shadow_rays(points, position, shadows):
    """Rays from points to a point light, and the irradiance per flux cos / (4 pi r^2) that they carry; how many."""
    like = packet(points.p)
    n = len(points.p) // 3
    sent = 0
    for i in range(0, n, packet_width(points.p)):
        offset = load(points.offset, i, like)
        ng, ns = load3(points.ng, i, n, like), load3(points.ns, i, n, like)
        o = spawn(load3(points.p, i, n, like), ng, offset)
        d = position[0] - o[0], position[1] - o[1], position[2] - o[2]
        r2 = dot(d, d)
        cosine = dot(d, ns)  # times r
        lit = (offset >= 0.0) & (dot(d, ng) > 0.0) & (cosine > 0.0)
        store3(shadows.o, i, n, o)
        store3(shadows.d, i, n, d)
        store(shadows.tmax, i, select(lit, splat(1.0, like), -1.0))
        store(shadows.irradiance, i, select(lit, cosine / (FOUR_PI * r2 * sqrt(r2)), 0.0))
        sent += count(lit)
    return sent


@kernel
def reflect_light(shading, points, shadows, flux, radiance):
    """Add albedo / pi times the irradiance that nothing stopped."""
    like = packet(radiance)
    n = len(radiance) // 3
    for i in range(0, n, packet_width(radiance)):
        material = load(points.material_id, i, like)
        occluded = load(shadows.occluded, i, like)
        arriving = select(occluded, 0.0, load(shadows.irradiance, i, like)) / np.pi
        for k in range(3):
            old = load(radiance, k * n + i, like)
            store(radiance, k * n + i, old + row_of(shading.materials, material, 6, k) * flux[k] * arriving)
