"""The two queries: nearest hits and occlusion of a batch of rays, packet by packet.

A register full of rays is split by kind; rays of one kind go through the tree side by side.
"""

import numpy as np

from raytrace.accel.box import make_beam, make_slabs, wide_beam
from raytrace.accel.kinds import Alike, kind_of, kinds_of, make_frame, same_kind
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
def pick(columns, rows, axis):
    """Component ``axis`` of rays of any numbers."""
    return gather(columns.data, rows * np.int32(columns.row) + np.int32(columns.start + axis * columns.axis))


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


@kernel
def closest_hit(tree, rays, hits, n, work):
    """Nearest hits of n rays."""
    like = packet(tree.nodes.bounds)
    eps = machine_epsilon(tree.nodes.bounds)
    for i in range(0, n, packet_width(tree.nodes.bounds)):
        o, d, scale, tmin, tmax = read_rays(rays, i, n, like)
        slabs, kinds = make_slabs(o, d, eps), kinds_of(d)
        t, u, v, prim = tmax, splat(0.0, like), splat(0.0, like), splat_int(-1, like)
        left = bits(tmin < tmax)
        while left != 0:
            k = first_bit(left)
            same = left & same_kind(kinds, k)
            left &= ~same
            dominant, axes = kind_of(kinds, k)
            alike = Alike(slabs, make_frame(dominant, o, d, scale), axes, tmin)
            mask = mask_of(same, like)
            hit = closest_packet(tree, alike, beam_of(tree, o, slabs, tmin, mask, eps), same, tmax, work)
            t, u, v = select(mask, hit[0], t), select(mask, hit[1], u), select(mask, hit[2], v)
            prim = select(mask, hit[3], prim)
        found = prim >= 0
        write(hits.t, i, n, select(found, t / scale, np.inf))
        write(hits.prim_id, i, n, prim)
        write(hits.u, i, n, select(found, u, 0.0))
        write(hits.v, i, n, select(found, v, 0.0))


@kernel
def any_hit(tree, rays, occluded, n, work):
    """Whether n rays hit anything."""
    like = packet(tree.nodes.bounds)
    eps = machine_epsilon(tree.nodes.bounds)
    width = packet_width(tree.nodes.bounds)
    for i in range(0, n, width):
        o, d, scale, tmin, tmax = read_rays(rays, i, n, like)
        slabs, kinds = make_slabs(o, d, eps), kinds_of(d)
        left, hit = bits(tmin < tmax), 0
        while left != 0:
            k = first_bit(left)
            same = left & same_kind(kinds, k)
            left &= ~same
            dominant, axes = kind_of(kinds, k)
            alike = Alike(slabs, make_frame(dominant, o, d, scale), axes, tmin)
            hit |= any_packet(tree, alike, beam_of(tree, o, slabs, tmin, mask_of(same, like), eps), same, tmax, work)
        if i + width <= n:
            store(occluded, i, mask_of(hit, like))
            continue
        for k in range(n - i):
            occluded[i + k] = hit >> k & 1
