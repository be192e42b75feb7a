"""What materials do with paths: the light that they scatter to the viewer, and the direction in which a path goes on.

Each kind of material is a pass of its own; a scene compiles those of the materials that it has.
"""

import numpy as np

from raytrace.accel.lanes import (
    bits,
    gather,
    load,
    packet,
    packet_width,
    select,
    splat,
    sqrt,
    store,
)  # fmt: skip
from raytrace.accel.vectors import choose3, dot, scaled, unit
from raytrace.jit import inlined, kernel
from raytrace.passes.fresnel import conductor_reflectance, dielectric_reflectance, transmitted_cosine
from raytrace.passes.paths import (
    AS_SHADOW,
    DEAD,
    DIRECTION_U,
    LOBE,
    ONLY_SPECULAR,
    THROUGH,
    power_heuristic,
    uniform,
    uniform2,
)  # fmt: skip
from raytrace.passes.refraction import interface_direction, reflect_direction
from raytrace.passes.surface import load3, spawn, store3, vector_of
from raytrace.passes.warp import around, cosine_hemisphere
from raytrace.records import CONDUCTOR, DIELECTRIC, DIFFUSE, MIRROR, REFRACTIVE


@inlined
def on(surfaces, vertices, i, kind):
    """Materials of paths i, i + 1, ..., and which of them are of a kind."""
    material = load(vertices.material_id, i, packet(vertices.offset))
    there = material >= np.int32(0)
    material = select(there, material, np.int32(0))
    return material, there & (gather(surfaces.kind, material) == np.int32(kind))


@inlined
def send(paths, i, mask, ray, throughput, pdf, state):
    """Write how the paths of a mask go on: origin and direction, throughput, density and state."""
    like, size = packet(paths.pdf), len(paths.pdf)
    o, d = ray
    store3(paths.rays.o, i, size, choose3(mask, o, load3(paths.rays.o, i, size, like)))
    store3(paths.rays.d, i, size, choose3(mask, d, load3(paths.rays.d, i, size, like)))
    store3(paths.throughput, i, size, choose3(mask, throughput, load3(paths.throughput, i, size, like)))
    store(paths.pdf, i, select(mask, pdf, load(paths.pdf, i, like)))
    old = load(paths.state, i, like)
    store(paths.state, i, select(mask, state, old))


@inlined
def times(a, b):
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@kernel
def scatter_diffuse(sampler, paths, n, depth, mark, surfaces, vertices, incident):
    """Diffuse surfaces: f = albedo / pi; the next direction by its cosine, so that f cos / pdf = albedo.

    Incident light becomes what the sample gains if nothing stops the shadow ray. ``mark`` are bits
    that the state of the paths gains: ENDING, or 0.
    """
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, DIFFUSE)
        here = here & (load(vertices.front, i, like) | (gather(surfaces.two_sided, material) > np.int32(0)))
        if bits(here) == 0:
            continue
        ng, ns = load3(vertices.ng, i, size, like), load3(vertices.ns, i, size, like)
        throughput = times(load3(paths.throughput, i, size, like), vector_of(surfaces.reflectance, material, 3, 0))
        if incident is not None:
            wi, tmax = load3(incident.wi, i, size, like), load(incident.tmax, i, like)
            cosine, pdf = dot(wi, ns), load(incident.pdf, i, like)
            lit = here & (tmax > 0.0) & (dot(wi, ng) > 0.0) & (cosine > 0.0)
            factor = power_heuristic(pdf, cosine / np.pi) * (cosine / np.pi)
            arriving = load3(incident.radiance, i, size, like)
            gained = scaled(times(throughput, arriving), factor)
            store3(incident.radiance, i, size, choose3(here, gained, arriving))
            store(incident.tmax, i, select(here & ~lit, -1.0, tmax))
        local = cosine_hemisphere(*uniform2(sampler, paths, i, depth, DIRECTION_U))
        d = unit(around(ns, local))
        here = here & (local[2] > 0.0) & (dot(d, ng) > 0.0)
        o = spawn(load3(vertices.p, i, size, like), ng, load(vertices.offset, i, like))
        state = load(paths.state, i, like) & np.int32(~(DEAD | ONLY_SPECULAR | THROUGH)) | np.int32(AS_SHADOW | mark)
        send(paths, i, here, (o, d), throughput, local[2] / np.pi, state)


@inlined
def mirror_direction(d, ng, ns):
    """Reflect about the shading normal; about the geometric one where that would end behind the surface."""
    wi = reflect_direction(d, ns)
    return unit(choose3((dot(d, ns) < 0.0) & (dot(wi, ng) > 0.0), wi, reflect_direction(d, ng)))


@kernel
def reflect_mirrors(paths, n, surfaces, vertices):
    """Mirrors: one direction, and a reflectance that does not depend on the angle."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, MIRROR)
        if bits(here) == 0:
            continue
        ng, ns = load3(vertices.ng, i, size, like), load3(vertices.ns, i, size, like)
        d = mirror_direction(load3(paths.rays.d, i, size, like), ng, ns)
        throughput = times(load3(paths.throughput, i, size, like), vector_of(surfaces.reflectance, material, 3, 0))
        o = spawn(load3(vertices.p, i, size, like), ng, load(vertices.offset, i, like))
        state = load(paths.state, i, like) & np.int32(~(DEAD | AS_SHADOW))
        send(paths, i, here, (o, d), throughput, splat(np.inf, like), state)


@kernel
def reflect_conductors(paths, n, surfaces, vertices):
    """Smooth conductors: as mirrors, with Fresnel's reflectance."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, CONDUCTOR)
        if bits(here) == 0:
            continue
        ng, ns = load3(vertices.ng, i, size, like), load3(vertices.ns, i, size, like)
        before = load3(paths.rays.d, i, size, like)
        d = mirror_direction(before, ng, ns)
        cosine = half_cosine(before, d)
        eta, k = vector_of(surfaces.eta, material, 3, 0), vector_of(surfaces.k, material, 3, 0)
        share = (
            conductor_reflectance(cosine, eta[0], k[0]),
            conductor_reflectance(cosine, eta[1], k[1]),
            conductor_reflectance(cosine, eta[2], k[2]),
        )
        throughput = times(load3(paths.throughput, i, size, like), share)
        o = spawn(load3(vertices.p, i, size, like), ng, load(vertices.offset, i, like))
        state = load(paths.state, i, like) & np.int32(~(DEAD | AS_SHADOW))
        send(paths, i, here, (o, d), throughput, splat(np.inf, like), state)


@inlined
def half_cosine(d, wi):
    """Cosine of the angle of incidence of d that is reflected to wi: half the length of their difference."""
    x, y, z = wi[0] - d[0], wi[1] - d[1], wi[2] - d[2]
    cosine = 0.5 * sqrt(dot((x, y, z), (x, y, z)))
    return select(cosine < 1.0, cosine, splat(1.0, cosine))


@inlined
def passes(surfaces, material):
    """Whether shadow rays pass surfaces of materials."""
    return gather(surfaces.transparent_shadow, material) > np.int32(0)


@inlined
def passed_state(state, straight):
    """State of paths that go on from an interface; straight: behind a surface that shadow rays pass."""
    state = state & np.int32(~DEAD)
    return select(straight, state | np.int32(THROUGH), state & np.int32(~AS_SHADOW))


@kernel
def pass_dielectrics(paths, n, depth, surfaces, vertices):
    """Smooth dielectrics: reflection with the probability of Fresnel's share, else transmission.

    Radiance over index squared is conserved, so the throughput of a path from the camera is multiplied by
    (n_from / n_to)^2 at each transmission [Veach1997, 5.2].
    """
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, DIELECTRIC)
        if bits(here) == 0:
            continue
        ng, ns = load3(vertices.ng, i, size, like), load3(vertices.ns, i, size, like)
        before = load3(paths.rays.d, i, size, like)
        ior = gather(surfaces.eta, material * np.int32(3))
        eta = select(load(vertices.front, i, like), ior, 1.0 / ior)
        through, total = interface_direction(before, ng, ns, eta)
        back = mirror_direction(before, ng, ns)
        cos_i = half_cosine(before, back)
        share = dielectric_reflectance(cos_i, transmitted_cosine(cos_i, eta), eta)
        share = select(total, splat(1.0, like), share)
        reflected = total | (uniform(paths, i, depth, LOBE) < share)
        d = choose3(reflected & ~total, back, through)
        p, offset = load3(vertices.p, i, size, like), load(vertices.offset, i, like)
        o = spawn(p, ng, select(reflected, offset, -offset))
        factor = select(reflected, splat(1.0, like), 1.0 / (eta * eta))
        scale = load(paths.scale, i, like)
        store(paths.scale, i, select(here, scale * factor, scale))
        throughput = scaled(load3(paths.throughput, i, size, like), factor)
        state = passed_state(load(paths.state, i, like), ~reflected & passes(surfaces, material))
        send(paths, i, here, (o, d), throughput, splat(np.inf, like), state)


@kernel
def pass_interfaces(paths, n, surfaces, vertices):
    """The ideal interface of the course: all light is transmitted, or reflected where that is total."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, REFRACTIVE)
        if bits(here) == 0:
            continue
        ng, ns = load3(vertices.ng, i, size, like), load3(vertices.ns, i, size, like)
        ior = gather(surfaces.eta, material * np.int32(3))
        eta = select(load(vertices.front, i, like), ior, 1.0 / ior)
        d, total = interface_direction(load3(paths.rays.d, i, size, like), ng, ns, eta)
        offset = load(vertices.offset, i, like)
        o = spawn(load3(vertices.p, i, size, like), ng, select(total, offset, -offset))
        throughput = load3(paths.throughput, i, size, like)
        state = passed_state(load(paths.state, i, like), ~total & passes(surfaces, material))
        send(paths, i, here, (o, d), throughput, splat(np.inf, like), state)
