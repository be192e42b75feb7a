"""The two queries: nearest hits and occlusion of a batch of rays, packet by packet."""

import numpy as np

from raytrace.accel.box import Slabs, make_slabs
from raytrace.accel.lanes import (
    absolute,
    bits,
    compress,
    first_bit,
    gather,
    lane_numbers,
    load,
    machine_epsilon,
    machine_largest,
    maximum,
    minimum,
    packet,
    packet_width,
    power_of_two,
    select,
    splat,
    store,
)  # fmt: skip
from raytrace.accel.traverse import Alike, Axes, any_packet, any_single, closest_packet, closest_single
from raytrace.accel.triangle import Frame
from raytrace.accel.vectors import scaled
from raytrace.jit import inlined, kernel

ORDINARY = 2.0**20  # directions whose largest component lies within 1 / this .. this are taken as they are
LIFT = 2.0**64  # brings the shortest directions to where their exponent is normal


@inlined
def read(columns, i, axis, n, like):
    """Component ``axis`` of rays i, i + 1, ...; past the last ray, that one again."""
    at = columns.start + axis * columns.axis
    if columns.row == 0:
        return splat(columns.data[at], like)
    if columns.row == 1 and i + packet_width(columns.data) <= n:
        return load(columns.data, at + i, like)
    rows = lane_numbers(like) + np.int32(i)
    rows = select(rows < np.int32(n), rows, np.int32(n - 1))
    return gather(columns.data, rows * np.int32(columns.row) + np.int32(at))


@inlined
def read_rays(rays, i, n, like):
    """Origins, directions, their scale, tmin and tmax in units of the scaled directions.

    Packets with extreme directions have all of theirs scaled to a largest component in [1, 2), by powers of two, which
    is exact. Rays that can't hit (not finite, no length, an empty range, past the last) get tmax = -inf.
    """
    o = read(rays.o, i, 0, n, like), read(rays.o, i, 1, n, like), read(rays.o, i, 2, n, like)
    d = read(rays.d, i, 0, n, like), read(rays.d, i, 1, n, like), read(rays.d, i, 2, n, like)
    tmin, tmax = read(rays.tmin, i, 0, n, like), read(rays.tmax, i, 0, n, like)
    zero = ((o[0] - o[0]) + (o[1] - o[1]) + (o[2] - o[2])) + ((d[0] - d[0]) + (d[1] - d[1]) + (d[2] - d[2]))
    longest = maximum(maximum(absolute(d[0]), absolute(d[1])), absolute(d[2]))
    alive = (zero == 0.0) & (longest > 0.0) & (tmin < tmax) & (lane_numbers(like) < np.int32(n - i))
    scale = splat(1.0, like)
    if bits(alive & ((longest < 1.0 / ORDINARY) | (longest > ORDINARY))) != 0:
        lift = select(longest < 1.0 / LIFT, LIFT, scale)
        scale = power_of_two(longest * lift)
        d = scaled(scaled(d, lift), 1.0 / scale)
        scale = scale / lift
        tmin, tmax = tmin * scale, minimum(tmax, machine_largest(rays.d.data)) * scale
    return o, d, scale, select(alive, tmin, np.inf), select(alive, tmax, -np.inf)


@inlined
def permute(dominant, a):
    """Components with the dominant one last."""
    if dominant == 0:
        return a[1], a[2], a[0]
    if dominant == 1:
        return a[2], a[0], a[1]
    return a


@inlined
def make_frame(dominant, o, d, scale):
    """Frame of rays that share their dominant axis."""
    ox, oy, oz = permute(dominant, o)
    dx, dy, dz = permute(dominant, d)
    return Frame(ox, oy, oz, dx, dy, dz, -(dx / dz), -(dy / dz), scale)


@inlined
def kinds_of(d):
    """Bits of the lanes that are negative in x, y, z, and whose dominant axis is x, or else y."""
    ax, ay, az = absolute(d[0]), absolute(d[1]), absolute(d[2])
    on_x = (ax >= ay) & (ax >= az)
    return bits(d[0] < 0.0), bits(d[1] < 0.0), bits(d[2] < 0.0), bits(on_x), bits(~on_x & (ay >= az))


@inlined
def alike(kinds, alive):
    """All live rays have the same signs and dominant axis."""
    mixed = 0
    for flags in kinds:
        mixed |= (flags & alive) != 0 and (flags & alive) != alive
    return mixed == 0


@inlined
def kind_of(kinds, k):
    """Dominant axis and axes of the ray in lane k."""
    dominant = 0 if kinds[3] >> k & 1 else 1 if kinds[4] >> k & 1 else 2
    axes = Axes(
        24 if kinds[0] >> k & 1 else 0, 32 if kinds[1] >> k & 1 else 8, 40 if kinds[2] >> k & 1 else 16,
        8 * ((dominant + 1) % 3), 8 * ((dominant + 2) % 3), 8 * dominant,
    )  # fmt: skip
    return dominant, axes


@inlined
def slabs_of(slabs, k):
    """Slabs of the ray in lane k."""
    return Slabs(
        slabs.near_ix[k], slabs.near_iy[k], slabs.near_iz[k], slabs.near_cx[k], slabs.near_cy[k], slabs.near_cz[k],
        slabs.far_ix[k], slabs.far_iy[k], slabs.far_iz[k], slabs.far_cx[k], slabs.far_cy[k], slabs.far_cz[k],
    )  # fmt: skip


@inlined
def write(a, i, n, x):
    """Write a register to elements i, i + 1, ... of an array of length n."""
    if i + packet_width(a) <= n:
        store(a, i, x)
    else:
        compress(a, i, lane_numbers(x) < np.int32(n - i), x)


@kernel
def closest_hit(tree, rays, hits, n, work):
    """Nearest hits of n rays."""
    like = packet(tree.nodes.bounds)
    eps = machine_epsilon(tree.nodes.bounds)
    width = packet_width(tree.nodes.bounds)
    for i in range(0, n, width):
        o, d, scale, tmin, tmax = read_rays(rays, i, n, like)
        slabs = make_slabs(o, d, eps)
        kinds = kinds_of(d)
        alive = bits(tmin < tmax)
        if alike(kinds, alive):
            dominant, axes = kind_of(kinds, first_bit(alive | 1 << 62) % 62)
            frame = make_frame(dominant, o, d, scale)
            t, prim, u, v = closest_packet(tree, Alike(slabs, frame, axes, tmin), tmax, work)
            write(hits.t, i, n, select(prim < 0, np.inf, t / scale))
            write(hits.prim_id, i, n, prim)
            write(hits.u, i, n, u)
            write(hits.v, i, n, v)
            continue
        for k in range(width if width < n - i else n - i):
            dominant, axes = kind_of(kinds, k)
            frame = make_frame(dominant, (o[0][k], o[1][k], o[2][k]), (d[0][k], d[1][k], d[2][k]), scale[k])
            t_k, prim_k, u_k, v_k = closest_single(tree, Alike(slabs_of(slabs, k), frame, axes, tmin[k]), tmax[k], work)
            found = prim_k >= 0
            hits.t[i + k] = t_k / scale[k] if found else np.inf
            hits.prim_id[i + k] = prim_k
            hits.u[i + k] = u_k if found else 0.0
            hits.v[i + k] = v_k if found else 0.0


@kernel
def any_hit(tree, rays, occluded, n, work):
    """Whether n rays hit anything."""
    like = packet(tree.nodes.bounds)
    eps = machine_epsilon(tree.nodes.bounds)
    width = packet_width(tree.nodes.bounds)
    for i in range(0, n, width):
        o, d, scale, tmin, tmax = read_rays(rays, i, n, like)
        slabs = make_slabs(o, d, eps)
        kinds = kinds_of(d)
        alive = bits(tmin < tmax)
        hit = 0
        if alike(kinds, alive):
            dominant, axes = kind_of(kinds, first_bit(alive | 1 << 62) % 62)
            frame = make_frame(dominant, o, d, scale)
            hit = any_packet(tree, Alike(slabs, frame, axes, tmin), tmax, work)
        else:
            for k in range(width if width < n - i else n - i):
                dominant, axes = kind_of(kinds, k)
                frame = make_frame(dominant, (o[0][k], o[1][k], o[2][k]), (d[0][k], d[1][k], d[2][k]), scale[k])
                hit |= any_single(tree, Alike(slabs_of(slabs, k), frame, axes, tmin[k]), tmax[k], work) << k
        for k in range(width if width < n - i else n - i):
            occluded[i + k] = hit >> k & 1
