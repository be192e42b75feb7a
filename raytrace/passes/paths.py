"""Path tracing, pass by pass: how paths begin, what they see where they arrive, and which of them go on."""

import numpy as np

from raytrace.accel.lanes import (
    bits,
    gather,
    lane_numbers,
    load,
    machine_epsilon,
    packet,
    packet_width,
    select,
    splat,
    splat_int,
    store,
)  # fmt: skip
from raytrace.accel.vectors import dot, scaled
from raytrace.jit import inlined, kernel
from raytrace.passes.sampling import independent_bits, key, mix, path_bits, pixel_key, unit_interval
from raytrace.passes.surface import load3, numbers_of, point_on, shading_normal, store3, vector_of
from raytrace.passes.textures import varied

# bits of Paths.state: no surface has scattered yet; the path ends at the next surface; it has ended; since a surface
# scattered, it has gone straight as its shadow ray did; and so through a surface that shadow rays pass
ONLY_SPECULAR, ENDING, DEAD, AS_SHADOW, THROUGH = 1, 2, 4, 8, 16
# dimensions of random numbers: those of the film, then eight for each surface
FIRST, PER_SURFACE = 8, 8
LIGHT, LIGHT_KEEP, LIGHT_U, LIGHT_V, DIRECTION_U, DIRECTION_V, LOBE, ROULETTE = range(8)
STRUCTURED = 2  # surfaces: beyond, points of any sampler are independent
ROULETTE_FROM = 5  # surfaces: before that, no path is ended by chance
SURVIVE = 0.05  # least probability to go on


@inlined
def random_bits(sampler, paths, i, depth, number):
    """Two numbers of 32 random bits of paths i, i + 1, ...: of a pair of dimensions at the surface number ``depth``."""
    pixel, sample = load_keys(paths.key, paths, i), load_keys(paths.sample, paths, i)
    dimension = FIRST + PER_SURFACE * (depth - 1) + number
    if depth <= STRUCTURED:
        return path_bits(sampler, pixel, sample, dimension)
    return independent_bits(pixel, sample, dimension)


@inlined
def load_keys(a, paths, i):
    """Lanes of a column of uint32, as many as the floats have."""
    return load(a, i, packet(paths.pdf))


@inlined
def uniform2(sampler, paths, i, depth, number):
    """Two random numbers in [0, 1) of paths i, i + 1, ..."""
    like = packet(paths.pdf)
    a, b = random_bits(sampler, paths, i, depth, number)
    return unit_interval(a, like), unit_interval(b, like)


@inlined
def uniform(paths, i, depth, number):
    """One random number in [0, 1) of paths i, i + 1, ..., independent of all others."""
    pixel, sample = load_keys(paths.key, paths, i), load_keys(paths.sample, paths, i)
    return unit_interval(mix(key(pixel, FIRST + PER_SURFACE * (depth - 1) + number) + sample), packet(paths.pdf))


@inlined
def power_heuristic(pdf, other):
    """Veach's weight pdf^2 / (pdf^2 + other^2), from the ratio, so that no square leaves the range [Veach1995].

    An infinite density is that of a direction that no other technique can find: its weight is 1.
    """
    ratio = other / pdf
    return select(pdf < np.inf, 1.0 / (1.0 + ratio * ratio), splat(1.0, pdf))


@inlined
def brought(state):
    """Which lamps and environments a shadow ray has brought already, through surfaces that it passes."""
    return (state & np.int32(AS_SHADOW | THROUGH)) == np.int32(AS_SHADOW | THROUGH)


@inlined
def add(radiance, size, slots, value, mask):
    """Add a colour to the radiance of the samples that lanes belong to."""
    left = bits(mask)
    k = 0
    while left != 0:
        if left & 1:
            slot = slots[k]
            radiance[slot] += value[0][k]
            radiance[size + slot] += value[1][k]
            radiance[2 * size + slot] += value[2][k]
        left >>= 1
        k += 1


@kernel
def begin_paths(seed, x, y, samples, paths, radiance):
    """Begin paths at the camera; path number = sample * len(x) + pixel, as ``camera_rays`` has it.

    Parameters
    ----------
    seed : uint32
    x, y : (m,) uint32 arrays, pixels
    samples : (2,) int64 array
        First sample and the one after the last.
    paths : Paths
        All but the rays' origins and directions is set.
    radiance : (3n,) f array
        Is set to 0.
    """
    like = packet(paths.pdf)
    m, width, size = len(x), packet_width(paths.pdf), len(paths.pdf)
    for j in range(0, m, width):
        pixel = pixel_key(seed, load(x, j, like), load(y, j, like))
        for sample in range(samples[0], samples[1]):
            at = (sample - samples[0]) * m + j
            store(paths.key, at, pixel)
            store(paths.sample, at, (pixel ^ pixel) + np.uint32(sample))
            store(paths.rays.slot, at, lane_numbers(like) + np.int32(at))
            store(paths.pdf, at, splat(np.inf, like))
            store(paths.scale, at, splat(1.0, like))
            store(paths.state, at, splat_int(ONLY_SPECULAR, like))
            store3(paths.throughput, at, size, (splat(1.0, like), splat(1.0, like), splat(1.0, like)))
            store3(radiance, at, size, (splat(0.0, like), splat(0.0, like), splat(0.0, like)))


@kernel
def see_lamps(paths, n, shading, surfaces, textures, radiance):
    """Add the radiance of the lamps that paths met from their front, weighted by multiple importance."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        prim = load(paths.rays.hits.prim_id, i, like)
        found = (prim >= 0) & (lane_numbers(like) < np.int32(n - i))
        prim = numbers_of(prim, found)
        material = gather(shading.material_id, prim)
        density = gather(surfaces.density, material)
        found = found & (density > 0.0)
        if bits(found) == 0:
            continue
        ng = vector_of(shading.triangles, prim, 12, 9)
        cosine = -dot(load3(paths.rays.d, i, size, like), ng)
        found = found & (cosine > 0.0) & ~brought(load(paths.state, i, like))
        t = load(paths.rays.hits.t, i, like)
        weight = power_heuristic(load(paths.pdf, i, like), density * (t * t) / cosine)
        emission, throughput = vector_of(surfaces.emission, material, 3, 0), load3(paths.throughput, i, size, like)
        if textures is not None:
            u, v = load(paths.rays.hits.u, i, like), load(paths.rays.hits.v, i, like)
            emission = varied(textures, textures.emission, material, (prim, u, v), emission)
        value = (
            weight * throughput[0] * emission[0],
            weight * throughput[1] * emission[1],
            weight * throughput[2] * emission[2],
        )
        add(radiance, size, load(paths.rays.slot, i, like), value, found)


@kernel
def see_environment(paths, n, environment, radiance):
    """Add the constant environment that paths see where they leave the scene, weighted by multiple importance.

    ``environment`` is its radiance (3,) and the density of its sampling, 1 / sr.
    """
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        gone = (load(paths.rays.hits.prim_id, i, like) < np.int32(0)) & (lane_numbers(like) < np.int32(n - i))
        gone = gone & ~brought(load(paths.state, i, like))
        if bits(gone) == 0:
            continue
        weight = power_heuristic(load(paths.pdf, i, like), splat(environment[3], like))
        throughput = load3(paths.throughput, i, size, like)
        value = (
            weight * throughput[0] * environment[0],
            weight * throughput[1] * environment[1],
            weight * throughput[2] * environment[2],
        )
        add(radiance, size, load(paths.rays.slot, i, like), value, gone)


@kernel
def see_background(paths, n, colour, radiance):
    """Add the background where paths leave the scene that only met perfectly specular surfaces."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        gone = (load(paths.rays.hits.prim_id, i, like) < np.int32(0)) & (lane_numbers(like) < np.int32(n - i))
        gone = gone & ((load(paths.state, i, like) & np.int32(ONLY_SPECULAR)) > np.int32(0))
        if bits(gone) == 0:
            continue
        throughput = load3(paths.throughput, i, size, like)
        value = throughput[0] * colour[0], throughput[1] * colour[1], throughput[2] * colour[2]
        add(radiance, size, load(paths.rays.slot, i, like), value, gone)


@kernel
def meet_surfaces(paths, n, shading, normals, vertices):
    """Points, normals and materials where paths meet surfaces; all paths are dead until a material sends them on."""
    like, eps = packet(paths.pdf), machine_epsilon(paths.pdf)
    size = len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        state = load(paths.state, i, like)
        prim = load(paths.rays.hits.prim_id, i, like)
        found = (prim >= 0) & (lane_numbers(like) < np.int32(n - i)) & ((state & np.int32(ENDING)) == np.int32(0))
        store(paths.state, i, state | np.int32(DEAD))
        if bits(found) == 0:
            store(vertices.material_id, i, splat_int(-1, like))
            continue
        prim = numbers_of(prim, found)
        u, v = load(paths.rays.hits.u, i, like), load(paths.rays.hits.v, i, like)
        p, ng, offset = point_on(shading.triangles, prim, u, v, eps)
        front = dot(load3(paths.rays.d, i, size, like), ng) < 0.0
        side = select(front, splat(1.0, like), -1.0)
        store3(vertices.p, i, size, p)
        store3(vertices.ng, i, size, scaled(ng, side))
        if normals is not None:
            store3(vertices.ns, i, size, scaled(shading_normal(normals, prim, u, v), side))
        store(vertices.offset, i, offset)
        store(vertices.front, i, front)
        store(vertices.material_id, i, select(found, gather(shading.material_id, prim), np.int32(-1)))
