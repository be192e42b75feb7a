"""Sampling of lights: one light for each path, a point on it, and the shadow ray towards that.

Each kind of light is a pass of its own; a scene compiles those of the lights that it has.
"""

import numpy as np

from raytrace.accel.hit_points import gamma
from raytrace.accel.lanes import (
    absolute,
    bits,
    gather,
    load,
    machine_epsilon,
    packet,
    packet_width,
    select,
    splat,
    splat_int,
    sqrt,
    store,
    to_int,
    to_real,
)  # fmt: skip
from raytrace.accel.vectors import choose3, dot, scaled
from raytrace.jit import inlined, kernel
from raytrace.passes.light import SPAN
from raytrace.passes.paths import LIGHT, LIGHT_U, random_bits, uniform2
from raytrace.passes.sampling import unit_interval
from raytrace.passes.surface import load3, point_on, row_of, spawn, store3
from raytrace.passes.textures import varied
from raytrace.passes.warp import sphere, triangle

TRIANGLE, POINT, SPOT, DIRECTIONAL, ENVIRONMENT = range(5)  # LightTable.kind
COLUMNS = 16  # of LightTable.numbers: radiance, intensity or irradiance (3), then by kind:
DENSITY = 3  # TRIANGLE: 1 / m2 on the triangle; ENVIRONMENT: 1 / sr; both with the probability of the light
PLACE, AXIS, CUTOFF, BEAM, NUDGE = 3, 6, 9, 10, 11  # POINT, SPOT: position; SPOT: axis, angles; NUDGE (3)
TOWARDS = 3  # DIRECTIONAL: unit vector to the light


@inlined
def high_product(h, n):
    """The high 32 bits of h n, for lanes of uint32 and a number of the same kind: h n / 2^32, rounded down."""
    low, high = np.uint32(n & np.uint32(0xFFFF)), np.uint32(n >> np.uint32(16))
    h0, h1 = h & np.uint32(0xFFFF), h >> np.uint32(16)
    middle = h1 * low + ((h0 * low) >> np.uint32(16))
    other = (middle & np.uint32(0xFFFF)) + h0 * high
    return h1 * high + (middle >> np.uint32(16)) + (other >> np.uint32(16))


@kernel
def pick_lights(sampler, paths, n, depth, table, surfaces, vertices, incident):
    """Choose a light for each path on a surface that scatters, by an alias table [Walker1977]; no shadow rays yet."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        store(incident.tmax, i, splat(-1.0, like))
        material = load(vertices.material_id, i, like)
        there = material >= np.int32(0)
        material = select(there, material, np.int32(0))
        there = there & (gather(surfaces.scatters, material) > np.int32(0))
        there = there & (load(vertices.front, i, like) | (gather(surfaces.two_sided, material) > np.int32(0)))
        if bits(there) == 0:
            store(incident.light, i, splat_int(-1, like))
            continue
        which, whether = random_bits(sampler, paths, i, depth, LIGHT)
        row = to_rows(high_product(which, np.uint32(len(table.keep))), like)
        kept = unit_interval(whether, like) < gather(table.keep, row)
        row = select(kept, row, gather(table.other, row))
        store(incident.light, i, select(there, row, np.int32(-1)))


@inlined
def to_rows(x, like):
    """Lanes of uint32 below 2^24 as int32."""
    return to_int(to_real(x, like))


@inlined
def chosen(table, incident, i, kind):
    """Rows of the lights that paths i, i + 1, ... chose, and which of them are of a kind."""
    row = load(incident.light, i, packet(incident.tmax))
    there = row >= np.int32(0)
    row = select(there, row, np.int32(0))
    return row, there & (gather(table.kind, row) == np.int32(kind))


@inlined
def numbers3(table, row, k):
    """Three numbers of lights."""
    return (
        row_of(table.numbers, row, COLUMNS, k),
        row_of(table.numbers, row, COLUMNS, k + 1),
        row_of(table.numbers, row, COLUMNS, k + 2),
    )


@inlined
def put(incident, i, mask, rays, light):
    """Write shadow rays (o, d, tmax) and their light (wi, radiance, pdf) to the lanes of a mask."""
    like, size = packet(incident.tmax), len(incident.tmax)
    o, d, tmax = rays
    wi, radiance, pdf = light
    store3(incident.o, i, size, choose3(mask, o, load3(incident.o, i, size, like)))
    store3(incident.d, i, size, choose3(mask, d, load3(incident.d, i, size, like)))
    store(incident.tmax, i, select(mask, tmax, load(incident.tmax, i, like)))
    store3(incident.wi, i, size, choose3(mask, wi, load3(incident.wi, i, size, like)))
    store3(incident.radiance, i, size, choose3(mask, radiance, load3(incident.radiance, i, size, like)))
    store(incident.pdf, i, select(mask, pdf, load(incident.pdf, i, like)))


@inlined
def starts(vertices, i):
    """Where shadow rays start: on the side that the paths come from."""
    like, size = packet(vertices.offset), len(vertices.offset)
    p, ng = load3(vertices.p, i, size, like), load3(vertices.ng, i, size, like)
    return spawn(p, ng, load(vertices.offset, i, like))


@inlined
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def end_offset(nl, d, offset, eps):
    """How far before a lamp a shadow ray of length |d| ends, so that it never finds that lamp's triangle at t < 1.

    It measures its distance from the plane with an error of gamma(24) (|d_k| + D_k) along each axis, D the extent of
    the triangle, beside the error of the point itself [docs/numerics.md]; gamma(24) D is at most 2 ``offset``.
    """
    across = absolute(nl[0]) * absolute(d[0]) + absolute(nl[1]) * absolute(d[1]) + absolute(nl[2]) * absolute(d[2])
    return 3.0 * offset + SPAN * (gamma(eps) * across)


@kernel
def sample_triangles(sampler, paths, n, depth, table, shading, textures, vertices, incident):
    """Points on emitting triangles, uniform by area; both ends of the shadow ray lie off their surfaces."""
    like, eps = packet(paths.pdf), machine_epsilon(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        row, wanted = chosen(table, incident, i, TRIANGLE)
        if bits(wanted) == 0:
            continue
        u, v = triangle(*uniform2(sampler, paths, i, depth, LIGHT_U))
        prim = select(wanted, gather(table.prim_id, row), np.int32(0))
        q, nl, offset = point_on(shading.triangles, prim, u, v, eps)
        o = starts(vertices, i)
        d = minus(spawn(q, nl, end_offset(nl, minus(q, o), offset, eps)), o)
        r2 = dot(d, d)
        wi = scaled(d, 1.0 / sqrt(r2))
        cosine = -dot(wi, nl)
        wanted = wanted & (cosine > 0.0)  # NaN where the points coincide
        pdf = row_of(table.numbers, row, COLUMNS, DENSITY) * r2 / cosine
        radiance = numbers3(table, row, 0)
        if textures is not None:
            material = gather(shading.material_id, prim)
            radiance = varied(textures, textures.emission, material, (prim, u, v), radiance)
        put(incident, i, wanted, (o, d, splat(1.0, like)), (wi, scaled(radiance, 1.0 / pdf), pdf))


@kernel
def sample_points(paths, n, table, vertices, incident):
    """Point lights: intensity / r^2; a light that lies on a surface is moved off it, to the side that it lights."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        row, wanted = chosen(table, incident, i, POINT)
        if bits(wanted) != 0:
            o = starts(vertices, i)
            d, wi, r2 = to_place(table, row, o)
            radiance = scaled(numbers3(table, row, 0), 1.0 / (r2 * gather(table.share, row)))
            put(incident, i, wanted & (r2 > 0.0), (o, d, splat(1.0, like)), (wi, radiance, splat(np.inf, like)))


@inlined
def to_place(table, row, o):
    """To the position of a light: vector, direction and squared length."""
    place, nudge = numbers3(table, row, PLACE), numbers3(table, row, NUDGE)
    d = minus(place, o)
    side = select(dot(d, nudge) < 0.0, splat(1.0, d[0]), -1.0)
    d = d[0] + side * nudge[0], d[1] + side * nudge[1], d[2] + side * nudge[2]
    r2 = dot(d, d)
    return d, scaled(d, 1.0 / sqrt(r2)), r2


@kernel
def sample_spots(paths, n, table, vertices, incident):
    """Spot lights: as point lights, full within the beam, 0 from the cutoff on, linear in the angle between."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        row, wanted = chosen(table, incident, i, SPOT)
        if bits(wanted) != 0:
            o = starts(vertices, i)
            d, wi, r2 = to_place(table, row, o)
            angle = angle_between(scaled(wi, -1.0), numbers3(table, row, AXIS))
            cutoff, beam = row_of(table.numbers, row, COLUMNS, CUTOFF), row_of(table.numbers, row, COLUMNS, BEAM)
            falloff = select(angle <= beam, splat(1.0, like), (cutoff - angle) / (cutoff - beam))
            wanted = wanted & (angle < cutoff) & (r2 > 0.0)
            radiance = scaled(numbers3(table, row, 0), falloff / (r2 * gather(table.share, row)))
            put(incident, i, wanted, (o, d, splat(1.0, like)), (wi, radiance, splat(np.inf, like)))


@inlined
def angle_between(a, b):
    """Angle of two unit vectors, 0 .. pi / 2 exactly enough, and more than that beyond.

    tan of half the angle is sin / (1 + cos); halved twice more by t / (1 + sqrt(1 + t^2)), it is at most 0.2, and eight
    times the series of the arc tangent, whose first term left out is below 1e-17.
    """
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    cosine = dot(a, b)
    t = sqrt(dot((x, y, z), (x, y, z))) / (1.0 + select(cosine < 0.0, splat(0.0, cosine), cosine))
    t = t / (1.0 + sqrt(1.0 + t * t))
    t = t / (1.0 + sqrt(1.0 + t * t))
    z2 = t * t
    series = 1 / 11 - z2 * (1 / 13 - z2 * (1 / 15 - z2 * (1 / 17 - z2 * (1 / 19 - z2 * (1 / 21)))))
    series = 1.0 - z2 * (1 / 3 - z2 * (1 / 5 - z2 * (1 / 7 - z2 * (1 / 9 - z2 * series))))
    return select(cosine < 0.0, splat(np.pi, t), 8.0 * (t * series))


@kernel
def sample_directions(paths, n, table, vertices, incident):
    """Directional lights: irradiance from infinitely far away."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        row, wanted = chosen(table, incident, i, DIRECTIONAL)
        if bits(wanted) != 0:
            wi = numbers3(table, row, TOWARDS)
            radiance = scaled(numbers3(table, row, 0), 1.0 / gather(table.share, row))
            far = splat(np.inf, like)
            put(incident, i, wanted, (starts(vertices, i), wi, far), (wi, radiance, far))


@kernel
def sample_environment(sampler, paths, n, depth, table, vertices, incident):
    """A constant environment: directions uniform over the sphere."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        row, wanted = chosen(table, incident, i, ENVIRONMENT)
        if bits(wanted) != 0:
            wi = sphere(*uniform2(sampler, paths, i, depth, LIGHT_U))
            pdf = row_of(table.numbers, row, COLUMNS, DENSITY)
            radiance = scaled(numbers3(table, row, 0), 1.0 / pdf)
            put(incident, i, wanted, (starts(vertices, i), wi, splat(np.inf, like)), (wi, radiance, pdf))


@kernel
def claim_light(n, incident):
    """Give light the weight 1 whose shadow ray passes a surface: a path bent there can't find the same."""
    like = packet(incident.pdf)
    for i in range(0, n, packet_width(incident.pdf)):
        passed = load(incident.occluded, i, like)
        store(incident.pdf, i, select(passed, np.inf, load(incident.pdf, i, like)))
