"""The two queries: nearest hits and occlusion of a batch of rays, bundle by bundle.

A bundle of packets that run close together goes through the tree as one. Otherwise each packet is split by kind, and
rays of one kind go through the tree side by side.
"""

import numpy as np

from raytrace.accel.box import make_beam, make_slabs, wide_beam
from raytrace.accel.bundle import Bundle, any_in_packet, closest_in_packet, trace_bundle
from raytrace.accel.frustum import make_frusta
from raytrace.accel.kinds import (
    FRAME,
    HIT,
    RAW,
    TMIN,
    Axes,
    RayPacket,
    hits_row,
    kind_of,
    kinds_of,
    make_frame,
    put,
    row,
    same_kind,
    slot,
)
from raytrace.accel.lanes import (
    absolute,
    bits,
    compress,
    first_bit,
    gather,
    group_size,
    lane_numbers,
    load,
    load_rows,
    machine_epsilon,
    machine_largest,
    mask_of,
    maximum,
    minimum,
    packet,
    packet_width,
    power_of_two,
    select,
    splat,
    splat_int,
    store,
)  # fmt: skip
from raytrace.accel.layout import NODE_SIZE
from raytrace.accel.packet import any_packet, closest_packet
from raytrace.accel.vectors import scaled
from raytrace.jit import inlined, kernel

ORDINARY = 2.0**10  # directions whose largest component lies within 1 / this .. this are taken as they are
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
    return pick(columns, select(rows < np.int32(n), rows, np.int32(n - 1)), axis)


@inlined
def read_vectors(columns, i, n, like):
    """x, y, z of rays i, i + 1, ...; past the last ray, those again."""
    if columns.row == 3 and columns.axis == 1 and i + packet_width(columns.data) <= n:
        return load_rows(columns.data, columns.start + 3 * i, like)
    return read(columns, i, 0, n, like), read(columns, i, 1, n, like), read(columns, i, 2, n, like)


@inlined
def pick(columns, rows, axis):
    """Component ``axis`` of rays of any numbers."""
    return gather(columns.data, rows * np.int32(columns.row) + np.int32(columns.start + axis * columns.axis))


@inlined
def read_rays(rays, i, n, like):
    """Origins, directions, their scale, tmin and tmax in units of the scaled directions.

    Packets with extreme directions have all of theirs scaled to a largest component in [1, 2), by powers of two, which
    is exact. Rays that can't hit (not finite, no length, an empty range, past the last) get tmax = -inf.
    """
    o, d = read_vectors(rays.o, i, n, like), read_vectors(rays.d, i, n, like)
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
def write(a, i, n, x):
    """Write a register to elements i, i + 1, ... of an array of length n."""
    if i + packet_width(a) <= n:
        store(a, i, x)
    else:
        compress(a, i, lane_numbers(x) < np.int32(n - i), x)


@inlined
def beam_of(tree, o, slabs, tmin, mask, eps):
    """Beam of the rays of a packet that go through a tree."""
    if len(tree.nodes.bounds) == NODE_SIZE:
        return wide_beam(tmin)
    return make_beam(o, slabs, tmin, mask, eps)


@inlined
def collect(rays, i, n, count, work):
    """Write packets to scratch memory; dominant axis and sense (1 or -1) of all rays alive, or -1 and 0 where mixed."""
    like = packet(work.lanes)
    nowhere = like != like
    x, y, z, back, forth, before = nowhere, nowhere, nowhere, nowhere, nowhere, nowhere
    for r in range(count):
        o, d, scale, tmin, tmax = read_rays(rays, i + r * packet_width(work.lanes), n, like)
        alive = tmin < tmax
        put(work, slot(r) + RAW, (o[0], o[1], o[2], d[0], d[1], d[2], scale))
        put(work, slot(r) + TMIN, (tmin, tmax, splat(0.0, like), splat(0.0, like)))
        store(work.prim_id, hits_row(work, r), splat_int(-1, like))
        ax, ay, az = absolute(d[0]), absolute(d[1]), absolute(d[2])
        on_x = (ax >= ay) & (ax >= az)
        on_y = ~on_x & (ay >= az)
        x, y, z = x | (alive & on_x), y | (alive & on_y), z | (alive & ~on_x & ~on_y)
        along = select(on_x, d[0], select(on_y, d[1], d[2]))
        back, forth = back | (alive & (along < 0.0)), forth | (alive & (along > 0.0))
        before = before | (alive & (tmin < 0.0))
    axes = (bits(x) != 0) + 2 * (bits(y) != 0) + 4 * (bits(z) != 0)
    one_axis = axes == 1 or axes == 2 or axes == 4
    one_way = (bits(forth) != 0) != (bits(back) != 0)
    if not one_axis or not one_way or bits(before) != 0:
        return -1, 0.0
    return axes // 2, (1.0 if bits(forth) != 0 else -1.0)


@inlined
def raw(work, r, like):
    """Origins, directions, scale, tmin and tmax of packet r of a bundle."""
    at = slot(r) + RAW
    o = row(work, at, like), row(work, at + 1, like), row(work, at + 2, like)
    d = row(work, at + 3, like), row(work, at + 4, like), row(work, at + 5, like)
    return o, d, row(work, at + 6, like), row(work, slot(r) + TMIN, like), row(work, slot(r) + HIT, like)


@inlined
def packets_from(i, n, work):
    """How many packets the bundle has that begins with ray i."""
    width = packet_width(work.lanes)
    return min(group_size(work.lanes), (n - i + width - 1) // width)


@inlined
def went_together(tree, rays, i, n, test, work):
    """Write packets to scratch memory; where they run close together, take them through the tree as a bundle."""
    count = packets_from(i, n, work)
    dominant, sense = collect(rays, i, n, count, work)
    if dominant < 0:
        return False
    for r in range(count):
        o, d, scale, _, _ = raw(work, r, packet(work.lanes))
        put(work, slot(r) + FRAME, make_frame(dominant, o, d, scale))
    whole, groups, narrow = make_frusta(tree.extent, dominant, sense, count, work)
    if narrow:
        axes = Axes(0, 0, 0, 8 * ((dominant + 1) % 3), 8 * ((dominant + 2) % 3), 8 * dominant)
        trace_bundle(tree, Bundle(whole, groups, axes, count), test, work)
    return narrow


@inlined
def closest_of_packet(tree, r, work, like):
    """Nearest hits of packet r of a bundle, kind by kind."""
    eps = machine_epsilon(tree.nodes.bounds)
    o, d, scale, tmin, tmax = raw(work, r, like)
    slabs, kinds = make_slabs(o, d, eps), kinds_of(d)
    t, u, v, prim = tmax, splat(0.0, like), splat(0.0, like), splat_int(-1, like)
    left = bits(tmin < tmax)
    while left != 0:
        k = first_bit(left)
        same = left & same_kind(kinds, k)
        left &= ~same
        dominant, axes = kind_of(kinds, k)
        alike = RayPacket(slabs, make_frame(dominant, o, d, scale), axes, tmin)
        mask = mask_of(same, like)
        hit = closest_packet(tree, alike, beam_of(tree, o, slabs, tmin, mask, eps), same, tmax, work)
        t, u, v = select(mask, hit[0], t), select(mask, hit[1], u), select(mask, hit[2], v)
        prim = select(mask, hit[3], prim)
    put(work, slot(r) + HIT, (t, u, v))
    store(work.prim_id, hits_row(work, r), prim)


@inlined
def any_of_packet(tree, r, work, like):
    """Bits of the rays of packet r of a bundle that hit anything, kind by kind."""
    eps = machine_epsilon(tree.nodes.bounds)
    o, d, scale, tmin, tmax = raw(work, r, like)
    slabs, kinds = make_slabs(o, d, eps), kinds_of(d)
    left, hit = bits(tmin < tmax), 0
    while left != 0:
        k = first_bit(left)
        same = left & same_kind(kinds, k)
        left &= ~same
        dominant, axes = kind_of(kinds, k)
        alike = RayPacket(slabs, make_frame(dominant, o, d, scale), axes, tmin)
        hit |= any_packet(tree, alike, beam_of(tree, o, slabs, tmin, mask_of(same, like), eps), same, tmax, work)
    return hit


@kernel
def closest_hit(tree, rays, hits, n, work):
    """Nearest hits of n rays."""
    like, width = packet(tree.nodes.bounds), packet_width(tree.nodes.bounds)
    for i in range(0, n, group_size(work.lanes) * width):
        together = went_together(tree, rays, i, n, closest_in_packet, work)
        for r in range(packets_from(i, n, work)):
            if not together:
                closest_of_packet(tree, r, work, like)
            at, prim = i + r * width, load(work.prim_id, hits_row(work, r), like)
            found, scale = prim >= 0, row(work, slot(r) + RAW + 6, like)
            write(hits.t, at, n, select(found, row(work, slot(r) + HIT, like) / scale, np.inf))
            write(hits.prim_id, at, n, prim)
            write(hits.u, at, n, select(found, row(work, slot(r) + HIT + 1, like), 0.0))
            write(hits.v, at, n, select(found, row(work, slot(r) + HIT + 2, like), 0.0))


@kernel
def any_hit(tree, rays, occluded, n, work):
    """Whether n rays hit anything."""
    like, width = packet(tree.nodes.bounds), packet_width(tree.nodes.bounds)
    for i in range(0, n, group_size(work.lanes) * width):
        together = went_together(tree, rays, i, n, any_in_packet, work)
        for r in range(packets_from(i, n, work)):
            if together:
                hit = row(work, slot(r) + HIT + 1, like) > 0.0
            else:
                hit = mask_of(any_of_packet(tree, r, work, like), like)
            if i + (r + 1) * width <= n:
                store(occluded, i + r * width, hit)
                continue
            left = bits(hit)
            for k in range(n - i - r * width):
                occluded[i + r * width + k] = left >> k & 1
