"""Third pass: from hits to points with normals, and how far from them the next ray must start."""

import numpy as np

from raytrace.accel.lanes import (
    absolute,
    bits,
    first_bit,
    gather,
    load,
    machine_epsilon,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    select,
    splat,
    store,
)
from raytrace.accel.vectors import dot, scaled, unit
from raytrace.jit import inlined, kernel

# A point is off by roundings of its coordinates, and the test of a ray from it by roundings of the triangle's extent: 3
# of the first and 12 of the second bound both, gamma(3) (|p| + 4 extents) with gamma(n) = n u / (1 - n u)
# [Higham2002, 3.1]. docs/numerics.md counts them.
ROUNDINGS, EXTENTS = 3, 4


@inlined
def one_row(index):
    """Whether all lanes look up the same row, as neighbours mostly do: a gather takes as long as many loads."""
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
    """Rows to look up: those that were found, and for all other lanes one of them (0 if there is none)."""
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


@inlined
def blend(a, b, c, u, v):
    """(1 - u - v) a + u b + v c, as a + (u (b - a) + v (c - a)): most roundings are of numbers no larger than edges."""
    return a + (u * (b - a) + v * (c - a))


@inlined
def blend3(a, b, c, u, v):
    """``blend`` of vectors."""
    return blend(a[0], b[0], c[0], u, v), blend(a[1], b[1], c[1], u, v), blend(a[2], b[2], c[2], u, v)


@inlined
def extent(a, b, c):
    """Largest minus smallest of three."""
    return maximum(maximum(a, b), c) - minimum(minimum(a, b), c)


@inlined
def point_on(triangles, prim, u, v, eps):
    """Point, unit geometric normal, and how far along it a ray must start, of hits."""
    a, b, c = vector_of(triangles, prim, 12, 0), vector_of(triangles, prim, 12, 3), vector_of(triangles, prim, 12, 6)
    n = vector_of(triangles, prim, 12, 9)
    p = blend3(a, b, c, u, v)
    x = absolute(n[0]) * (absolute(p[0]) + EXTENTS * extent(a[0], b[0], c[0]))
    y = absolute(n[1]) * (absolute(p[1]) + EXTENTS * extent(a[1], b[1], c[1]))
    z = absolute(n[2]) * (absolute(p[2]) + EXTENTS * extent(a[2], b[2], c[2]))
    return p, n, (x + y + z) * (ROUNDINGS * (0.5 * eps) / (1.0 - ROUNDINGS * (0.5 * eps)))


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
def surface(shading, normals, d, hits, points):
    """Points that samples landed on, seen from where they are seen.

    Parameters
    ----------
    shading : Shading
    normals : (m * 9,) f array or None
        Shading normals of the corners of each triangle; None: all flat.
    d : (3n,) f array
        Directions that hit.
    hits : Hits
    points : Points
        Is filled. What can't be lit (nothing hit, refractive, seen from behind) gets offset -1.
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
