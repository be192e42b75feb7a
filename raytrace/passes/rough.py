"""Rough conductors and dielectrics: GGX microfacets, visible normals, separable masking, one scattering [Walter2007].

``evaluate_...`` and ``sample_...`` work in the frame of the shading normal, z up, on the side of the viewer o. They are
functions of lanes, and of NumPy arrays in ``rt.bsdf``. With visible normals f cos = density x Fresnel x G1(i), and the
sample's weight is Fresnel x G1(i): it never exceeds 1 [Heitz2018].
"""

import numpy as np

from raytrace.accel.lanes import bits, gather, load, minimum, packet, packet_width, select, splat, store
from raytrace.accel.vectors import choose3, dot, scaled, unit
from raytrace.jit import inlined, kernel
from raytrace.passes.fresnel import conductor_reflectance
from raytrace.passes.materials import on, send, times
from raytrace.passes.microfacet import (
    fresnel,
    masking,
    reflection_density,
    transmission_density,
    visible_normal,
)
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
from raytrace.passes.refraction import refract_direction
from raytrace.passes.surface import load3, spawn, store3
from raytrace.passes.textures import index_of
from raytrace.passes.warp import around, to_frame
from raytrace.records import ROUGH_CONDUCTOR, ROUGH_DIELECTRIC


@inlined
def facing(wo, ng, ns):
    """The shading normal; the geometric one where the viewer is behind the shading normal."""
    return choose3(dot(wo, ns) > 0.0, ns, ng)


@inlined
def mirrored(o, h):
    """Direction that the microfacet h reflects to o, and the cosine between."""
    cosine = dot(o, h)
    twice = 2.0 * cosine
    return unit((twice * h[0] - o[0], twice * h[1] - o[1], twice * h[2] - o[2])), minimum(cosine, 1.0)


@inlined
def metal_share(cosine, eta, k):
    """Fresnel's reflectance of a conductor, three channels."""
    return (
        conductor_reflectance(cosine, eta[0], k[0]),
        conductor_reflectance(cosine, eta[1], k[1]),
        conductor_reflectance(cosine, eta[2], k[2]),
    )


@inlined
def evaluate_conductor(o, i, alpha, eta, k):
    """F cos, three channels, and the density of i, 1 / sr."""
    h = unit((o[0] + i[0], o[1] + i[1], o[2] + i[2]))
    density = select((o[2] > 0.0) & (i[2] > 0.0), reflection_density(o, h, alpha), splat(0.0, alpha))
    share = metal_share(minimum(dot(o, h), 1.0), eta, k)
    return scaled(share, density * masking(i, alpha)), density


@inlined
def sample_conductor(o, alpha, eta, k, numbers):
    """Direction, weight f cos / density (0 below the surface) and density; ``numbers`` are two of [0, 1)."""
    h = visible_normal(o, alpha, numbers[0], numbers[1])
    i, cosine = mirrored(o, h)
    weight = select(i[2] > 0.0, masking(i, alpha), splat(0.0, alpha))
    return i, scaled(metal_share(cosine, eta, k), weight), reflection_density(o, h, alpha)


@inlined
def evaluate_dielectric(o, i, alpha, eta):
    """F cos and the density of i, 1 / sr; eta = n behind the surface / n of the viewer.

    The microfacet h lies along o + i for reflection, along -(o + eta i) for transmission, turned to the viewer.
    Radiance is divided by eta^2 when it is transmitted towards the viewer [Walter2007, equation 21].
    """
    up = i[2] > 0.0
    s = select(up, splat(1.0, eta), eta)
    h = unit((o[0] + s * i[0], o[1] + s * i[1], o[2] + s * i[2]))
    h = scaled(h, select(~up & (eta > 1.0), splat(-1.0, eta), 1.0))
    before, behind = dot(o, h), dot(i, h)
    there = (o[2] > 0.0) & (before > 0.0) & ((up & (behind > 0.0)) | (~up & (i[2] < 0.0) & (behind < 0.0)))
    density, share = dielectric_density(o, h, alpha, eta, up)
    density = select(there, density * share, splat(0.0, eta))
    return density * dielectric_weight(i, alpha, eta, up), density


@inlined
def dielectric_density(o, h, alpha, eta, up):
    """Density of the direction that h reflects (up) or refracts to o, and the share of the light that goes there."""
    before = dot(o, h)
    share, behind = fresnel(before, eta)
    density = select(up, reflection_density(o, h, alpha), transmission_density(o, h, alpha, (before, behind), eta))
    return density, select(up, share, 1.0 - share)


@inlined
def dielectric_weight(i, alpha, eta, up):
    """F cos / density: masking, and the factor (n_from / n_to)^2 of radiance."""
    return masking(i, alpha) * select(up, splat(1.0, eta), 1.0 / (eta * eta))


@inlined
def sample_dielectric(o, alpha, eta, numbers):
    """Direction, weight f cos / density (0 on the wrong side), density, and whether it is reflected.

    The third of the ``numbers`` chooses reflection with the probability of Fresnel's reflectance at the microfacet.
    """
    h = visible_normal(o, alpha, numbers[0], numbers[1])
    share, _ = fresnel(dot(o, h), eta)
    up = numbers[2] < share
    back, _ = mirrored(o, h)
    through, _ = refract_direction(scaled(o, -1.0), h, eta)
    i = choose3(up, back, through)
    density, share = dielectric_density(o, h, alpha, eta, up)
    there = (up & (i[2] > 0.0)) | (~up & (i[2] < 0.0))
    return i, select(there, dielectric_weight(i, alpha, eta, up), splat(0.0, eta)), density * share, up


@inlined
def scattered(state, mark):
    """State of a path that a surface scatters; ``mark`` are bits that it gains."""
    return state & np.int32(~(DEAD | ONLY_SPECULAR | THROUGH)) | np.int32(AS_SHADOW | mark)


@kernel
def scatter_conductors(sampler, paths, n, depth, mark, surfaces, vertices, incident):
    """Rough conductors; arguments as those of ``scatter_diffuse``."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, ROUGH_CONDUCTOR)
        if bits(here) == 0:
            continue
        ng, before = load3(vertices.ng, i, size, like), load3(paths.rays.d, i, size, like)
        ns = facing(scaled(before, -1.0), ng, load3(vertices.ns, i, size, like))
        viewer, alpha = to_frame(ns, scaled(before, -1.0)), gather(surfaces.alpha, material)
        eta, k = index_of(vertices.reflectance, surfaces, material, i, size)
        throughput = load3(paths.throughput, i, size, like)
        if incident is not None:
            wi, tmax = load3(incident.wi, i, size, like), load(incident.tmax, i, like)
            value, density = evaluate_conductor(viewer, to_frame(ns, wi), alpha, eta, k)
            lit = here & (tmax > 0.0) & (dot(wi, ng) > 0.0) & (density > 0.0)
            value = scaled(times(throughput, value), power_heuristic(load(incident.pdf, i, like), density))
            radiance = load3(incident.radiance, i, size, like)
            store3(incident.radiance, i, size, choose3(here, times(value, radiance), radiance))
            store(incident.tmax, i, select(here & ~lit, -1.0, tmax))
        local, weight, pdf = sample_conductor(viewer, alpha, eta, k, uniform2(sampler, paths, i, depth, DIRECTION_U))
        d = unit(around(ns, local))
        here = here & (local[2] > 0.0) & (dot(d, ng) > 0.0) & (pdf > 0.0)
        o = spawn(load3(vertices.p, i, size, like), ng, load(vertices.offset, i, like))
        send(paths, i, here, (o, d), times(throughput, weight), pdf, scattered(load(paths.state, i, like), mark))


@inlined
def light_behind(incident, vertices, i, mask):
    """Let shadow rays start behind the surface: origins move to the other side, ends stay."""
    like, size = packet(incident.tmax), len(incident.tmax)
    o, d = load3(incident.o, i, size, like), load3(incident.d, i, size, like)
    step = scaled(load3(vertices.ng, i, size, like), 2.0 * load(vertices.offset, i, like))
    near = load(incident.tmax, i, like) < np.inf
    store3(incident.o, i, size, choose3(mask, (o[0] - step[0], o[1] - step[1], o[2] - step[2]), o))
    store3(incident.d, i, size, choose3(mask & near, (d[0] + step[0], d[1] + step[1], d[2] + step[2]), d))


@inlined
def same_side(wi, local, ng):
    """Whether a direction is on the same side of the shading normal as of the geometric one."""
    across = dot(wi, ng)
    return ((local[2] > 0.0) & (across > 0.0)) | ((local[2] < 0.0) & (across < 0.0))


@kernel
def scatter_dielectrics(sampler, paths, n, depth, mark, surfaces, vertices, incident):
    """Rough dielectrics; arguments as those of ``scatter_diffuse``."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, ROUGH_DIELECTRIC)
        if bits(here) == 0:
            continue
        ng, before = load3(vertices.ng, i, size, like), load3(paths.rays.d, i, size, like)
        ns = facing(scaled(before, -1.0), ng, load3(vertices.ns, i, size, like))
        viewer, alpha = to_frame(ns, scaled(before, -1.0)), gather(surfaces.alpha, material)
        ior = gather(surfaces.eta, material * np.int32(3))
        eta = select(load(vertices.front, i, like), ior, 1.0 / ior)
        throughput = load3(paths.throughput, i, size, like)
        if incident is not None:
            wi, tmax = load3(incident.wi, i, size, like), load(incident.tmax, i, like)
            local = to_frame(ns, wi)
            value, density = evaluate_dielectric(viewer, local, alpha, eta)
            lit = here & (tmax > 0.0) & same_side(wi, local, ng) & (density > 0.0)
            value = value * power_heuristic(load(incident.pdf, i, like), density)
            radiance = load3(incident.radiance, i, size, like)
            store3(incident.radiance, i, size, choose3(here, scaled(times(throughput, radiance), value), radiance))
            store(incident.tmax, i, select(here & ~lit, -1.0, tmax))
            light_behind(incident, vertices, i, lit & (local[2] < 0.0))
        u, v = uniform2(sampler, paths, i, depth, DIRECTION_U)
        local, weight, pdf, up = sample_dielectric(viewer, alpha, eta, (u, v, uniform(paths, i, depth, LOBE)))
        d = unit(around(ns, local))
        here = here & (weight > 0.0) & same_side(d, local, ng) & (pdf > 0.0)
        offset, scale = load(vertices.offset, i, like), load(paths.scale, i, like)
        o = spawn(load3(vertices.p, i, size, like), ng, select(up, offset, -offset))
        store(paths.scale, i, select(here & ~up, scale / (eta * eta), scale))
        send(paths, i, here, (o, d), scaled(throughput, weight), pdf, scattered(load(paths.state, i, like), mark))
