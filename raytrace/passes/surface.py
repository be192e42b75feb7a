"""Third pass: from hits to points with normals, and how far from them the next ray must start."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.hit_points import blend3, error_scale, gamma
from raytrace.accel.lanes import (
    absolute,
    bits,
    first_bit,
    gather,
    load,
    machine_epsilon,
    packet,
    packet_width,
    peek,
    select,
    splat,
    store,
)
from raytrace.accel.vectors import dot, scaled, unit
from raytrace.jit import inlined, kernel
from raytrace.records import Hits, Points, Shading


@inlined
def one_row(index):
    """Whether all lanes look up the same row, as neighbours mostly do: one load is much faster than a gather."""
    return bits(index != index[0]) == 0


@inlined
def row_of(table, index, width, k):
    """Column k of rows of a flat table."""
    return gather(table, index * np.int32(width) + np.int32(k))


@inlined
def vector_of(table, index, width, k):
    """Columns k, k + 1, k + 2 of rows of a flat table."""
    if one_row(index):
        like, at = packet(table), np.int64(index[0]) * width + k
        return splat(peek(table, at), like), splat(peek(table, at + 1), like), splat(peek(table, at + 2), like)
    return row_of(table, index, width, k), row_of(table, index, width, k + 1), row_of(table, index, width, k + 2)


@inlined
def numbers_of(index, found):
    """Row to look up in each lane; lanes without a hit use the row of the first hit (0 if there is none)."""
    any_found = bits(found)
    other = index[first_bit(any_found)] if any_found != 0 else np.int32(0)
    return select(found, index, other)


@inlined
def load3(a, i, n, like):
    """Components i, n + i, 2n + i of a structure of arrays."""
    return load(a, i, like), load(a, n + i, like), load(a, 2 * n + i, like)


@inlined
def store3(a, i, n, x):
    """Write components i, n + i, 2n + i of a structure of arrays."""
    store(a, i, x[0])
    store(a, n + i, x[1])
    store(a, 2 * n + i, x[2])


class SurfacePoint(NamedTuple):
    """Points of hits: lanes."""

    p: tuple  # x, y, z, world units
    ng: tuple  # x, y, z: unit geometric normal
    offset: float  # world units: how far along ng a ray must start


@inlined
def point_on(triangles, prim, u, v, eps) -> SurfacePoint:
    """Points of hits, their unit geometric normals, and how far along them a ray must start."""
    a, b, c = vector_of(triangles, prim, 12, 0), vector_of(triangles, prim, 12, 3), vector_of(triangles, prim, 12, 6)
    n = vector_of(triangles, prim, 12, 9)
    p = blend3(a, b, c, u, v)
    x = absolute(n[0]) * error_scale(p[0], a[0], b[0], c[0])
    y = absolute(n[1]) * error_scale(p[1], a[1], b[1], c[1])
    z = absolute(n[2]) * error_scale(p[2], a[2], b[2], c[2])
    return SurfacePoint(p, n, (x + y + z) * gamma(eps))


@inlined
def shading_normal(normals, prim, u, v):
    """Unit normal interpolated between the corners."""
    a, b, c = vector_of(normals, prim, 9, 0), vector_of(normals, prim, 9, 3), vector_of(normals, prim, 9, 6)
    return unit(blend3(a, b, c, u, v))


@inlined
def spawn(p, n, offset):
    """A point moved along n."""
    return p[0] + n[0] * offset, p[1] + n[1] * offset, p[2] + n[2] * offset


@kernel
def surface(shading: Shading, normals, d, hits: Hits, points: Points):
    """Points where samples hit surfaces, with normals on the viewer's side.

    Parameters
    ----------
    shading : Shading
    normals : (m * 9,) f array or None
        Shading normals of the corners of each triangle; None: all surfaces are flat.
    d : (3n,) f array
        Directions of the rays that hit.
    hits : Hits
    points : Points
        Output. Samples that cannot be lit (no hit, refractive, seen from behind) get offset -1.
    """
    like = packet(d)
    eps = machine_epsilon(d)
    n = len(d) // 3
    for i in range(0, n, packet_width(d)):
        prim = load(hits.prim_id, i, like)
        found = prim >= 0
        prim = numbers_of(prim, found)
        u, v = load(hits.u, i, like), load(hits.v, i, like)
        p, ng, offset = point_on(shading.triangles, prim, u, v, eps)
        material = gather(shading.material_id, prim)
        one = splat(1.0, like)
        front = dot(load3(d, i, n, like), ng) < 0.0
        side = select(front, one, -1.0)
        _, two_sided, refractive = vector_of(shading.materials, material, 6, 3)
        store3(points.p, i, n, p)
        store3(points.ng, i, n, scaled(ng, side))
        if normals is not None:
            store3(points.ns, i, n, scaled(shading_normal(normals, prim, u, v), side))
        store(points.offset, i, select(found & (front | (two_sided > 0.0)) & (refractive == 0.0), offset, -1.0))
        store(points.material_id, i, material)
