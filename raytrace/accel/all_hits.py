"""All hits of rays: the traversals of ``query`` without an end at the first hit.

``meet`` is the test of rays and triangles: ``meet_watertight`` reports every triangle that holds a point of the ray,
``meet_crossing`` every crossing of a closed surface once. Both return t in the user's units, and a mask of the pairs
of ray and triangle that ``exact_crossing`` must decide.
"""

import numpy as np

from raytrace.accel.box import PacketBounds, make_slabs
from raytrace.accel.crossing import meet_crossing
from raytrace.accel.hit_work import (
    FIRST,
    PAIRS,
    REACH,
    USED,
    USER_TMAX,
    USER_TMIN,
    HitWork,
    Interval,
    keep_of_packet,
    keep_of_ray,
    note_packet,
    note_ray,
    within,
    write_user_rows,
)
from raytrace.accel.lanes import (
    NODE,
    bits,
    first_bit,
    group_size,
    lane_max,
    machine_epsilon,
    mask_of,
    packet,
    packet_width,
    peek,
    select,
)
from raytrace.accel.layout import LEAF_SIZE, PRIM_ID
from raytrace.accel.octants import Axes, RayPacket, axes_of, make_ray_frame, octants_of, same_octant_and_axis
from raytrace.accel.packet import Reach, enter_packet, few, one_triangle
from raytrace.accel.pool import SCATTERED, spread, suits_pool, trace_pool, triangles_of_ray
from raytrace.accel.pool_scratch import NEXT, PLACE, frame_of_ray, read_number, read_state
from raytrace.accel.query import collect, packet_bounds, packets_from, trace_collected
from raytrace.accel.results import write
from raytrace.accel.scratch import (
    ROWS,
    TMAX,
    read_bundle_rays,
    read_frame,
    read_prim_id,
    read_ray,
    read_row,
    write_packet,
)
from raytrace.accel.single import eight_triangles, enter_single
from raytrace.accel.stack import NOTHING, ROOT, pop, push
from raytrace.accel.triangle import Crossing, RayFrame, Triangle, intersect
from raytrace.jit import inlined, kernel
from raytrace.records import Rays, Tree


@inlined
def meet_watertight(tree: Tree, frame: RayFrame, triangle: Triangle, reach, work: HitWork):
    """Where rays meet triangles by the test of the tree, which leaves none undecided."""
    inside, t, u, v = intersect(tree.leaves, frame, triangle)
    return Crossing(inside, t / frame.scale, u, v), inside & ~inside


@inlined
def interval_of(work: HitWork, r: int, like) -> Interval:
    """Intervals of the rays of packet r."""
    return Interval(read_row(work, r, USER_TMIN, like), read_row(work, r, USER_TMAX, like))


@inlined
def test_packet(tree: Tree, at: int, r: int, frame: RayFrame, axes: Axes, alive, meet, work: HitWork):
    """Test packet r against the triangle in lane ``at`` of the leaves, and keep its hits."""
    like = packet(work.lanes)
    triangle, number = one_triangle(tree.leaves.rows, at, axes), peek(tree.leaves.prim_id, at + PRIM_ID)
    crossing, undecided = meet(tree, frame, triangle, read_row(work, r, REACH, like), work)
    if bits(crossing.inside | undecided) != 0:
        interval = interval_of(work, r, like)
        found, undecided = within(crossing, interval) & alive, undecided & alive & (interval.tmin < interval.tmax)
        if bits(found) != 0:
            keep_of_packet(found, crossing, number, r, work)
        if bits(undecided) != 0:
            note_packet(undecided, number, r, work)


@inlined
def all_in_packet(tree: Tree, at: int, r: int, axes: Axes, work: HitWork):
    """Test packet r of a bundle against a triangle; False, because the hits do not end any ray."""
    like = packet(work.lanes)
    test_packet(tree, at, r, read_frame(work, r, like), axes, like == like, meet_watertight, work)
    return False


@inlined
def crossings_in_packet(tree: Tree, at: int, r: int, axes: Axes, work: HitWork):
    """The same for crossings."""
    like = packet(work.lanes)
    test_packet(tree, at, r, read_frame(work, r, like), axes, like == like, meet_crossing, work)
    return False


@inlined
def all_single(tree: Tree, ray: RayPacket, child: int, base: int, r: int, k: int, meet, work: HitWork):
    """Find all hits of one ray below a child: of lane k of packet r."""
    width, top = packet_width(work.lanes), base
    at_ray, place = (r + 1) * ROWS * width + k, (r + 1) * width + k
    tmax = peek(work.lanes, at_ray + TMAX * width)
    interval = Interval(peek(work.lanes, at_ray + USER_TMIN * width), peek(work.lanes, at_ray + USER_TMAX * width))
    while child != NOTHING:
        if child >= 0:
            child, top = enter_single(tree, child, ray, tmax, top, work)
            if child == NOTHING:
                child, top = pop(work, base, top, tmax)
            continue
        at = ~child * LEAF_SIZE
        work.counts[1] += NODE
        triangles = eight_triangles(tree.leaves.rows, at, ray.axes)
        crossing, undecided = meet(tree, ray.frame, triangles, peek(work.lanes, at_ray + REACH * width), work)
        keep_of_ray(bits(within(crossing, interval)), crossing, tree.leaves.prim_id, at + PRIM_ID, place, work)
        note_ray(bits(undecided), tree.leaves.prim_id, at + PRIM_ID, place, work)
        child, top = pop(work, base, top, tmax)


@inlined
def all_of_rays(tree: Tree, packet: RayPacket, bounds: PacketBounds, alive: int, tmax, r: int, meet, work: HitWork):
    """Find all hits of the rays ``alive`` (bits) of packet r; few rays are traced one by one."""
    living = mask_of(alive, tmax)
    tmax = select(living, tmax, -np.inf)
    farthest = lane_max(tmax)
    top, written = push(work, 0, 0, -np.inf, ROOT, alive), False
    while top > 0:
        top -= 1
        child, left = np.int64(peek(work.child, top)), np.int64(peek(work.alive, top))
        if few(left, work):
            if not written:
                write_packet(work, packet)
                written = True
            while left != 0:
                k = first_bit(left)
                left &= left - 1
                all_single(tree, read_ray(work, packet.axes, k), child, top, r, k, meet, work)
        elif child >= 0:
            top = enter_packet(tree.nodes, child, packet, Reach(bounds, tmax, farthest), top, work)
        else:
            for k in range(NODE):
                at = ~child * LEAF_SIZE + k
                if peek(tree.leaves.prim_id, at + PRIM_ID) < 0:
                    break
                work.counts[1] += 1
                test_packet(tree, at, r, packet.frame, packet.axes, living, meet, work)


@inlined
def all_of_packet(tree: Tree, r: int, meet, work: HitWork, like):
    """Find all hits of packet r, for each octant and dominant axis on its own."""
    eps = machine_epsilon(tree.nodes.bounds)
    o, d, scale, tmin, tmax = read_bundle_rays(work, r, like)
    slabs, octants = make_slabs(o, d, eps), octants_of(d)
    left = bits(tmin < tmax)
    while left != 0:
        k = first_bit(left)
        same = left & same_octant_and_axis(octants, k)
        left &= ~same
        dominant, axes = axes_of(octants, k)
        alike = RayPacket(slabs, make_ray_frame(dominant, o, d, scale), axes, tmin)
        bounds = packet_bounds(tree, o, slabs, tmin, mask_of(same, like), eps)
        all_of_rays(tree, alike, bounds, same, tmax, r, meet, work)


@inlined
def all_in_leaf(tree: Tree, f: int, top: int, meet, work: HitWork) -> int:
    """Find all hits of ray f of a pool in a leaf; return the height of its stack."""
    at, place = ~read_state(work, f, NEXT) * LEAF_SIZE, read_state(work, f, PLACE)
    interval = Interval(read_number(work, f, USER_TMIN), read_number(work, f, USER_TMAX))
    triangles, reach = triangles_of_ray(tree, f, at, work), read_number(work, f, REACH)
    crossing, undecided = meet(tree, frame_of_ray(work, f), triangles, reach, work)
    keep_of_ray(bits(within(crossing, interval)), crossing, tree.leaves.prim_id, at + PRIM_ID, place, work)
    note_ray(bits(undecided), tree.leaves.prim_id, at + PRIM_ID, place, work)
    return top


@inlined
def hits_in_leaf(tree: Tree, f: int, top: int, work: HitWork) -> int:
    """The same for hits."""
    return all_in_leaf(tree, f, top, meet_watertight, work)


@inlined
def crossings_in_leaf(tree: Tree, f: int, top: int, work: HitWork) -> int:
    """The same for crossings."""
    return all_in_leaf(tree, f, top, meet_crossing, work)


@inlined
def trace_all(tree: Tree, rays: Rays, counts, n: int, meet, in_packet, in_leaf, work: HitWork):
    """Find all hits of n rays; write how many each has."""
    like, width = packet(tree.nodes.bounds), packet_width(tree.nodes.bounds)
    work.state[USED] = work.state[PAIRS] = 0
    for i in range(0, n, group_size(work.lanes) * width):
        packets = packets_from(i, n, work)
        axis = collect(rays, i, n, packets, work)
        write_user_rows(tree, rays, i, n, packets, work)
        work.state[FIRST] = i
        if not trace_collected(tree, axis, packets, in_packet, work):
            if suits_pool(tree, work) and spread(packets, work) > SCATTERED:
                trace_pool(tree, packets, in_leaf, work)
            else:
                for r in range(packets):
                    all_of_packet(tree, r, meet, work, like)
        for r in range(packets):
            write(counts, i + r * width, n, read_prim_id(work, r, like))


@kernel
def all_hits(tree: Tree, rays: Rays, counts, n: int, work: HitWork):
    """Find all hits of n rays."""
    trace_all(tree, rays, counts, n, meet_watertight, all_in_packet, hits_in_leaf, work)


@kernel
def all_crossings(tree: Tree, rays: Rays, counts, n: int, work: HitWork):
    """Find all crossings of n rays and a closed surface."""
    trace_all(tree, rays, counts, n, meet_crossing, crossings_in_packet, crossings_in_leaf, work)
