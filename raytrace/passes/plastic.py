"""Plastic: a smooth dielectric coat over a diffuse base.

Light is reflected by the coat, or enters it, is scattered by the base, and leaves; what the coat sends back to the base
is scattered again, any number of times, which the factor 1 / (1 - albedo F_in) sums up:
f = (albedo / pi) (1 - F_i) (1 - F_o) / (ior^2 (1 - albedo F_in)), beside the reflection.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import bits, gather, load, maximum, packet, packet_width, select, splat, store
from raytrace.accel.vectors import choose3, dot, scaled, unit
from raytrace.jit import inlined, kernel
from raytrace.passes.materials import on, send, times
from raytrace.passes.microfacet import fresnel
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
from raytrace.passes.refraction import reflect_direction
from raytrace.passes.rough import facing, scattered
from raytrace.passes.surface import load3, spawn, store3
from raytrace.passes.textures import reflectance_of
from raytrace.passes.warp import around, cosine_hemisphere
from raytrace.records import PLASTIC

NODES = 128  # of the quadrature; the next digits of the reflectance are below 1e-12 for an ior of 1.01 to 10


@inlined
def base_colour(albedo, escape):
    """Albedo / (1 - albedo F_in): the base with all that the coat sends back to it; ``escape`` is 1 - F_in."""
    return (
        albedo[0] / (1.0 - albedo[0] + albedo[0] * escape),
        albedo[1] / (1.0 - albedo[1] + albedo[1] * escape),
        albedo[2] / (1.0 - albedo[2] + albedo[2] * escape),
    )


@inlined
def coat_share(cosine, base, ior, escape):
    """Fresnel's reflectance of the coat, and the probability with which a path is reflected by it.

    It is F / (F + B), with B = (1 - F) (1 - F_in) max(base) the light that the base reflects to the viewer from an even
    environment, in the channel that has most.
    """
    share, _ = fresnel(cosine, ior)
    most = (1.0 - share) * escape * maximum(maximum(base[0], base[1]), base[2])
    return share, select(share + most > 0.0, share / (share + most), splat(1.0, share))


@inlined
def evaluate_base(cosines, base, ior, chance):
    """F cos / base, and the density, 1 / sr, of light that the base scatters from cosine to cosine."""
    to, of = cosines
    enter, _ = fresnel(of, ior)
    leave, _ = fresnel(to, ior)
    flat = of / np.pi
    return flat * ((1.0 - enter) * (1.0 - leave) / (ior * ior)), flat * (1.0 - chance)


@inlined
def sample_base(cosine, base, ior, chance, numbers):
    """Direction, weight f cos / density, and density, where the coat does not reflect."""
    local = cosine_hemisphere(numbers[0], numbers[1])
    enter, _ = fresnel(local[2], ior)
    leave, _ = fresnel(cosine, ior)
    weight = (1.0 - enter) * (1.0 - leave) / (ior * ior * (1.0 - chance))
    return local, scaled(base, weight), local[2] / np.pi * (1.0 - chance)


@kernel
def scatter_plastic(sampler, paths, n, depth, mark, surfaces, vertices, incident):
    """Plastic; arguments as those of ``scatter_diffuse``. The reflection of the coat is perfectly specular."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        material, here = on(surfaces, vertices, i, PLASTIC)
        here = here & (load(vertices.front, i, like) | (gather(surfaces.two_sided, material) > np.int32(0)))
        if bits(here) == 0:
            continue
        ng, before = load3(vertices.ng, i, size, like), load3(paths.rays.d, i, size, like)
        ns = facing(scaled(before, -1.0), ng, load3(vertices.ns, i, size, like))
        ior, escape = gather(surfaces.eta, material * np.int32(3)), gather(surfaces.escape, material)
        base = base_colour(reflectance_of(vertices.reflectance, surfaces, material, i, size), escape)
        to = -dot(before, ns)
        share, chance = coat_share(to, base, ior, escape)
        throughput = load3(paths.throughput, i, size, like)
        if incident is not None:
            wi, tmax = load3(incident.wi, i, size, like), load(incident.tmax, i, like)
            of = dot(wi, ns)
            value, density = evaluate_base((to, of), base, ior, chance)
            lit = here & (tmax > 0.0) & (dot(wi, ng) > 0.0) & (of > 0.0)
            value = scaled(times(throughput, base), value * power_heuristic(load(incident.pdf, i, like), density))
            radiance = load3(incident.radiance, i, size, like)
            store3(incident.radiance, i, size, choose3(here, times(value, radiance), radiance))
            store(incident.tmax, i, select(here & ~lit, -1.0, tmax))
        coat = uniform(paths, i, depth, LOBE) < chance
        local, weight, pdf = sample_base(to, base, ior, chance, uniform2(sampler, paths, i, depth, DIRECTION_U))
        d = unit(choose3(coat, reflect_direction(before, ns), around(ns, local)))
        bright = share / chance
        weight = choose3(coat, (bright, bright, bright), weight)
        here = here & (dot(d, ng) > 0.0) & (coat | (local[2] > 0.0))
        o = spawn(load3(vertices.p, i, size, like), ng, load(vertices.offset, i, like))
        old = load(paths.state, i, like)
        mirror = old & np.int32(~(DEAD | ONLY_SPECULAR | THROUGH | AS_SHADOW)) | np.int32(mark)
        state, pdf = select(coat, mirror, scattered(old, mark)), select(coat, np.inf, pdf)
        send(paths, i, here, (o, d), times(throughput, weight), pdf, state)


def coat_escape(ior: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share 1 - F_in of diffuse light from inside that leaves a coat: 1 - 2 integral of F c dc, by Gauss's quadrature.

    The side from which no reflection is total is integrated, with c = t^2, where F has no kink; the other follows from
    (1 - F_out) = ior^2 (1 - F_in), because both sides transmit the same light.

    Examples
    --------
    >>> import numpy as np
    >>> coat_escape(np.array([1.0, 1.5])).round(4)
    array([1.    , 0.4037])
    """
    nodes, weights = _gauss()
    t = (0.5 + 0.5 * nodes)[:, None]
    dense = np.maximum(ior, 1 / ior)
    share, _ = fresnel(t * t + 0 * dense, dense + 0 * t)
    outside = np.asarray((2 * weights[:, None] * t * t * t * share).sum(axis=0))
    return np.where(ior > 1, (1 - outside) / (ior * ior), 1 - outside)


@functools.cache
def _gauss() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights for -1 .. 1."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    return nodes, weights
