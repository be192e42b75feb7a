"""The two queries, nearest hits and occlusion, of any number of rays, bundle by bundle.

Packets whose rays run close together go through the tree as one bundle. Otherwise each packet is split by octant and
dominant axis, and the rays that share both go through the tree side by side. ``batches`` says which rays a packet has.
"""

import numpy as np

from raytrace.accel.batches import after, in_batch, left, read, read_vectors
from raytrace.accel.box import PacketBounds, Slabs, endless_packet_bounds, make_packet_bounds, make_slabs
from raytrace.accel.bundle import Bundle, any_in_packet, closest_in_packet, nearest_first, trace_bundle
from raytrace.accel.frustum import make_frusta
from raytrace.accel.lanes import (
    absolute,
    bits,
    first_bit,
    group_size,
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
)  # fmt: skip
from raytrace.accel.layout import NODE_SIZE
from raytrace.accel.octants import Axes, RayPacket, axes_of, make_ray_frame, octants_of, same_octant_and_axis
from raytrace.accel.packet import any_packet, closest_packet
from raytrace.accel.pool import any_in_leaf, closest_in_leaf, trace_scattered
from raytrace.accel.results import write_hits, write_occluded
from raytrace.accel.scratch import (
    FRAME,
    HIT_T,
    OCCLUDED,
    ORIGIN,
    SCALE,
    TMIN,
    BundleRays,
    read_bundle_rays,
    write_prim_id,
    write_rows,
)
from raytrace.accel.vectors import scaled
from raytrace.jit import c_kernel, inlined
from raytrace.records import Hits, Rays, Tree
from raytrace.work_records import Work

ORDINARY = 2.0**10  # directions whose largest component lies in 1 / ORDINARY .. ORDINARY are not scaled
LIFT = 2.0**64  # scales the shortest directions to where their exponent is normal


@inlined
def read_rays(rays: Rays, i: int, n, like) -> BundleRays:
    """Rays of the packet that begins at place i of a batch.

    Where a packet has an extreme direction, all its directions are scaled by powers of two, so that the largest
    component lies in [1, 2). That is exact. Rays that cannot hit get tmax = -inf: those that are not finite, have no
    direction or an empty range, or come after the last.
    """
    o, d = read_vectors(rays.o, i, n, like), read_vectors(rays.d, i, n, like)
    tmin, tmax = read(rays.tmin, i, 0, n, like), read(rays.tmax, i, 0, n, like)
    zero = ((o[0] - o[0]) + (o[1] - o[1]) + (o[2] - o[2])) + ((d[0] - d[0]) + (d[1] - d[1]) + (d[2] - d[2]))
    longest = maximum(maximum(absolute(d[0]), absolute(d[1])), absolute(d[2]))
    alive = (zero == 0.0) & (longest > 0.0) & (tmin < tmax) & in_batch(i, n, like)
    scale = splat(1.0, like)
    if bits(alive & ((longest < 1.0 / ORDINARY) | (longest > ORDINARY))) != 0:
        lift = select(longest < 1.0 / LIFT, LIFT, scale)
        scale = power_of_two(longest * lift)
        d = scaled(scaled(d, lift), 1.0 / scale)
        scale = scale / lift
        tmin, tmax = tmin * scale, minimum(tmax, machine_largest(rays.d.data)) * scale
    return BundleRays(o, d, scale, select(alive, tmin, np.inf), select(alive, tmax, -np.inf))


@inlined
def packet_bounds(tree: Tree, o, slabs: Slabs, tmin, mask, eps) -> PacketBounds:
    """Bounds of the rays of a packet; endless for a tree of one node, whose boxes are all tested one by one."""
    if len(tree.nodes.bounds) == NODE_SIZE:
        return endless_packet_bounds(tmin)
    return make_packet_bounds(o, slabs, tmin, mask, eps)


@inlined
def collect(rays: Rays, i: int, n, count: int, work: Work):
    """Write the packets of a bundle to scratch memory; return the dominant axis and the sense of all rays alive.

    The sense is 1 or -1: along the axis or against it. Where rays differ in either, or where any tmin is negative, axis
    and sense are -1 and 0.
    """
    like = packet(work.lanes)
    nowhere = like != like
    x, y, z, back, forth, before = nowhere, nowhere, nowhere, nowhere, nowhere, nowhere
    for r in range(count):
        o, d, scale, tmin, tmax = read_rays(rays, i + r * packet_width(work.lanes), n, like)
        alive = tmin < tmax
        write_rows(work, r, ORIGIN, (o[0], o[1], o[2], d[0], d[1], d[2]))
        write_rows(work, r, SCALE, (scale,))
        write_rows(work, r, TMIN, (tmin, tmax, splat(0.0, like), splat(0.0, like)))
        write_prim_id(work, r, splat_int(-1, like))
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
def packets_from(i: int, n, work: Work) -> int:
    """Number of packets in the bundle that begins at place i."""
    width = packet_width(work.lanes)
    return min(group_size(work.lanes), (left(i, n) + width - 1) // width)


@inlined
def trace_together(tree: Tree, rays: Rays, i: int, n, test, work: Work) -> bool:
    """Write packets to scratch memory; trace them as a bundle if they run close together; return whether they do."""
    count = packets_from(i, n, work)
    dominant, sense = collect(rays, i, n, count, work)
    return trace_collected(tree, (dominant, sense), count, test, work)


@inlined
def trace_collected(tree: Tree, axis, count: int, test, work: Work) -> bool:
    """Trace packets in scratch memory as a bundle if they run close together; ``axis``: as ``collect`` returns it."""
    dominant, sense = axis
    if dominant < 0:
        return False
    for r in range(count):
        o, d, scale, _, _ = read_bundle_rays(work, r, packet(work.lanes))
        write_rows(work, r, FRAME, make_ray_frame(dominant, o, d, scale))
    whole, groups, narrow = make_frusta(tree.extent, dominant, sense, count, nearest_first(test), work)
    if narrow:
        axes = Axes(0, 0, 0, 8 * ((dominant + 1) % 3), 8 * ((dominant + 2) % 3), 8 * dominant)
        trace_bundle(tree, Bundle(whole, groups, axes, count, nearest_first(test)), test, work)
    return narrow


@inlined
def closest_of_packet(tree: Tree, r: int, work: Work, like):
    """Find the nearest hits of packet r of a bundle, for each octant and dominant axis on its own."""
    eps = machine_epsilon(tree.nodes.bounds)
    o, d, scale, tmin, tmax = read_bundle_rays(work, r, like)
    slabs, octants = make_slabs(o, d, eps), octants_of(d)
    t, u, v, prim = tmax, splat(0.0, like), splat(0.0, like), splat_int(-1, like)
    left = bits(tmin < tmax)
    while left != 0:
        k = first_bit(left)
        same = left & same_octant_and_axis(octants, k)
        left &= ~same
        dominant, axes = axes_of(octants, k)
        alike = RayPacket(slabs, make_ray_frame(dominant, o, d, scale), axes, tmin)
        mask = mask_of(same, like)
        hits = closest_packet(tree, alike, packet_bounds(tree, o, slabs, tmin, mask, eps), same, tmax, work)
        t, u, v = select(mask, hits.t, t), select(mask, hits.u, u), select(mask, hits.v, v)
        prim = select(mask, hits.prim_id, prim)
    write_rows(work, r, HIT_T, (t, u, v))
    write_prim_id(work, r, prim)


@inlined
def any_of_packet(tree: Tree, r: int, work: Work, like) -> int:
    """Bits of the rays of packet r of a bundle that hit anything, for each octant and dominant axis on its own."""
    eps = machine_epsilon(tree.nodes.bounds)
    o, d, scale, tmin, tmax = read_bundle_rays(work, r, like)
    slabs, octants = make_slabs(o, d, eps), octants_of(d)
    left, occluded = bits(tmin < tmax), 0
    while left != 0:
        k = first_bit(left)
        same = left & same_octant_and_axis(octants, k)
        left &= ~same
        dominant, axes = axes_of(octants, k)
        alike = RayPacket(slabs, make_ray_frame(dominant, o, d, scale), axes, tmin)
        bounds = packet_bounds(tree, o, slabs, tmin, mask_of(same, like), eps)
        occluded |= any_packet(tree, alike, bounds, same, tmax, work)
    return occluded


@c_kernel
def closest_hit(tree: Tree, rays: Rays, hits: Hits, n, work: Work):
    """Find the nearest hits of the rays of a batch."""
    like, step, i = packet(tree.nodes.bounds), group_size(work.lanes) * packet_width(tree.nodes.bounds), 0
    while left(i, n) > 0:
        count = packets_from(i, n, work)
        traced = trace_together(tree, rays, i, n, closest_in_packet, work)
        if not traced and not trace_scattered(tree, count, closest_in_leaf, work):
            for r in range(count):
                closest_of_packet(tree, r, work, like)
        write_hits(hits, i, n, count, work)
        i = after(i, step, n)


@c_kernel
def any_hit(tree: Tree, rays: Rays, occluded, n, work: Work):
    """Find which rays of a batch hit anything."""
    like, step, i = packet(tree.nodes.bounds), group_size(work.lanes) * packet_width(tree.nodes.bounds), 0
    while left(i, n) > 0:
        count = packets_from(i, n, work)
        traced = trace_together(tree, rays, i, n, any_in_packet, work)
        if not traced and not trace_scattered(tree, count, any_in_leaf, work):
            for r in range(count):
                hit = mask_of(any_of_packet(tree, r, work, like), like)
                write_rows(work, r, OCCLUDED, (select(hit, splat(1.0, like), 0.0),))
        write_occluded(occluded, i, n, count, work)
        i = after(i, step, n)
