"""The bounce: rays that hit an ideal interface continue behind it or are reflected; all other rays end."""

import numpy as np

from raytrace.accel.lanes import (
    bits,
    compress,
    count,
    gather,
    lane_numbers,
    load,
    machine_epsilon,
    maximum,
    packet,
    packet_width,
    select,
    splat,
    sqrt,
)  # fmt: skip
from raytrace.accel.vectors import choose3, dot, scaled, unit
from raytrace.jit import inlined, kernel
from raytrace.passes.surface import load3, numbers_of, point_on, row_of, shading_normal, spawn
from raytrace.records import Batch, Shading


@inlined
def reflect_direction(d, n):
    """Mirror direction d - 2 (d . n) n, for registers and for NumPy arrays of components."""
    twice = 2.0 * dot(d, n)
    return d[0] - twice * n[0], d[1] - twice * n[1], d[2] - twice * n[2]


@inlined
def refract_direction(d, n, eta):
    """Unit direction by Snell's law, and whether reflection is total; for registers and NumPy arrays of components.

    n is the normal on the ray's side; eta is the index of the transmitted medium over that of the incident one. The
    part of d along the surface has length sin_i and is divided by eta; the rest of the unit length goes against n. That
    part is computed from d + n, which is small near normal incidence and exact there. cos_t^2 is computed from the
    cosine or the sine, whichever is smaller, so that no digits cancel [Pharr2023, 9.3; docs/numerics.md].
    """
    inverse = 1.0 / eta
    cosine = dot(d, n)
    between = d[0] + n[0], d[1] + n[1], d[2] + n[2]
    along = dot(between, n)
    s = scaled((between[0] - along * n[0], between[1] - along * n[1], between[2] - along * n[2]), inverse)
    level = (eta - 1.0) * inverse * (1.0 + inverse) + (cosine * inverse) * (cosine * inverse)
    rest = select(cosine * cosine < 0.5, level, 1.0 - dot(s, s))
    same = eta == 1.0
    total = ~(rest > 0.0) & ~same
    down = sqrt(maximum(rest, 0.0))
    through = unit((s[0] - down * n[0], s[1] - down * n[1], s[2] - down * n[2]))
    mirror = unit(reflect_direction(d, n))
    return choose3(total, mirror, choose3(same, d, through)), total


@inlined
def interface_direction(d, ng, ns, eta):
    """Direction after an interface, and whether it stays on the ray's side (total internal reflection).

    Refracts about the shading normal ns. Where that direction would leave on the wrong side of the surface, refracts
    about the geometric normal ng instead. Both normals are on the ray's side.
    """
    ns = choose3(dot(d, ns) < 0.0, ns, ng)
    wt, total = refract_direction(d, ns, eta)
    away = dot(wt, ng)
    right = (total & (away > 0.0)) | (~total & (away < 0.0))
    if bits(~right) == 0:
        return wt, total
    flat, flat_total = refract_direction(d, ng, eta)
    return choose3(right, wt, flat), (right & total) | (~right & flat_total)


@kernel
def refract_rays(shading: Shading, normals, batch: Batch, n: int, out: Batch):
    """Write the next rays of those of the first n of a batch that hit an interface to ``out``; return their number."""
    like = packet(batch.d)
    eps = machine_epsilon(batch.d)
    size = len(batch.slot)
    one = splat(1.0, like)
    sent = 0
    for i in range(0, n, packet_width(batch.d)):
        prim = load(batch.hits.prim_id, i, like)
        found = (prim >= 0) & (lane_numbers(like) < np.int32(n - i))
        prim = numbers_of(prim, found)
        material = gather(shading.material_id, prim)
        found = found & (row_of(shading.materials, material, 6, 5) > 0.0)
        if bits(found) == 0:
            continue
        u, v = load(batch.hits.u, i, like), load(batch.hits.v, i, like)
        d = load3(batch.d, i, size, like)
        p, ng, offset = point_on(shading.triangles, prim, u, v, eps)
        front = dot(d, ng) < 0.0
        side = select(front, one, -1.0)
        ior = row_of(shading.materials, material, 6, 3)
        eta = select(front, ior, 1.0 / ior)
        ng = scaled(ng, side)
        ns = ng
        if normals is not None:
            ns = scaled(shading_normal(normals, prim, u, v), side)
        wt, total = interface_direction(d, ng, ns, eta)
        o = spawn(p, ng, select(total, offset, -offset))
        for k in range(3):
            compress(out.o, k * size + sent, found, o[k])
            compress(out.d, k * size + sent, found, wt[k])
        compress(out.slot, sent, found, load(batch.slot, i, like))
        sent += count(found)
    return sent


@kernel
def land(batch: Batch, n: int, landed: Batch):
    """Copy hits and directions of the first n rays of a batch to the samples that they belong to."""
    size = len(batch.slot)
    for i in range(n):
        slot = batch.slot[i]
        landed.hits.t[slot] = batch.hits.t[i]
        landed.hits.prim_id[slot] = batch.hits.prim_id[i]
        landed.hits.u[slot] = batch.hits.u[i]
        landed.hits.v[slot] = batch.hits.v[i]
        for k in range(3):
            landed.d[k * size + slot] = batch.d[k * size + i]
