"""A packet of rays through the tree: it is tested against one box, or one triangle, after the other.

Its rays share an octant and a dominant axis. Where few of them enter a node or leaf, those are traced one by one from
there. Both ways do the same arithmetic on the same numbers and break ties alike, so the results are bit-identical.
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.box import PacketBounds, bounds_test, slab_test
from raytrace.accel.lanes import (
    NODE,
    bits,
    first_bit,
    lane_max,
    lane_min,
    mask_of,
    packet_width,
    peek,
    select,
    splat,
    splat_int,
)
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, NORMAL, PRESENT, PRIM_ID, V0, V1, V2, Leaves
from raytrace.accel.octants import Axes, RayPacket
from raytrace.accel.scratch import (
    ALONE,
    HIT_T,
    HIT_U,
    HIT_V,
    TMAX,
    read_lane,
    read_prim_id,
    read_ray,
    read_row,
    write_packet,
    write_prim_id,
    write_rows,
)
from raytrace.accel.single import any_single, closest_single, planes_of_node
from raytrace.accel.stack import ROOT, push, put
from raytrace.accel.triangle import Triangle, intersect
from raytrace.jit import inlined
from raytrace.records import Nodes, Tree
from raytrace.work_records import Work

MAX_ALONE = 4  # so many rays of a packet, or half of it if that is less, are traced one by one: that is faster


class PacketHits(NamedTuple):
    """Nearest hits so far of the rays of a packet: lanes."""

    t: float  # tmax before the first hit; -inf for rays that are not traced
    u: float
    v: float
    prim_id: int  # -1 before the first hit


class Reach(NamedTuple):
    """Region that a packet can still reach."""

    bounds: PacketBounds
    tmax: float  # of each ray: lanes
    farthest: float  # the largest tmax


class Visit(NamedTuple):
    """A node or leaf taken from the stack."""

    child: int  # number of a node, or ~number of a leaf
    top: int  # height of the stack below it


@inlined
def planes_of(bounds, at: int, axes: Axes):
    """Near planes (x, y, z) and far planes of one box: numbers."""
    near = peek(bounds, at + axes.near_x), peek(bounds, at + axes.near_y), peek(bounds, at + axes.near_z)
    far = peek(bounds, at + 24 - axes.near_x), peek(bounds, at + 40 - axes.near_y), peek(bounds, at + 56 - axes.near_z)
    return near, far


@inlined
def corner(rows, at: int, axes: Axes):
    """x, y, z of a vertex, or of the normal, of one triangle; the dominant axis of the rays comes last."""
    return peek(rows, at + axes.x), peek(rows, at + axes.y), peek(rows, at + axes.z)


@inlined
def one_triangle(rows, at: int, axes: Axes) -> Triangle:
    """One triangle of a leaf."""
    return Triangle(
        corner(rows, at + V0, axes), corner(rows, at + V1, axes), corner(rows, at + V2, axes),
        corner(rows, at + NORMAL, axes),
    )  # fmt: skip


@inlined
def met_boxes(nodes: Nodes, at: int, packet: RayPacket, reach: Reach) -> int:
    """Bits of the children of a node that the bounds of a packet meet; in a tree of one node, of all children."""
    left = np.int64(peek(nodes.child, at + PRESENT))  # an empty slot can be entered where a quotient is NaN
    if len(nodes.bounds) > NODE_SIZE:
        near, far = planes_of_node(nodes.bounds, at, packet.axes)
        left &= bits(bounds_test(reach.bounds, near, far, reach.farthest))
    return left


@inlined
def enter_packet(nodes: Nodes, node: int, packet: RayPacket, reach: Reach, top: int, work: Work):
    """Push the children of a node that any ray of a packet enters, nearest on top; return the height of the stack."""
    base, at = top, node * NODE_SIZE
    left = met_boxes(nodes, at, packet, reach)
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        child = peek(nodes.child, at + CHILD + k)
        near, far = planes_of(nodes.bounds, at + k, packet.axes)
        t, entered = slab_test(packet.slabs, near, far, packet.tmin, reach.tmax)
        lanes = bits(entered)
        if lanes != 0:
            top = push(work, base, top, lane_min(select(entered, t, np.inf)), child, lanes)
    work.counts[0] += 1
    return top


@inlined
def enter_packet_unsorted(nodes: Nodes, node: int, packet: RayPacket, reach: Reach, top: int, work: Work):
    """Push the children of a node that any ray of a packet enters; return the new height of the stack."""
    at = node * NODE_SIZE
    left = met_boxes(nodes, at, packet, reach)
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        near, far = planes_of(nodes.bounds, at + k, packet.axes)
        _, entered = slab_test(packet.slabs, near, far, packet.tmin, reach.tmax)
        lanes = bits(entered)
        if lanes != 0:
            top = put(work, top, peek(nodes.child, at + CHILD + k), lanes)
    work.counts[0] += 1
    return top


@inlined
def few(lanes: int, work: Work):
    """Whether at most MAX_ALONE bits are set, and at most half of a packet's."""
    for _ in range(min(MAX_ALONE, packet_width(work.lanes) // 2)):
        lanes &= lanes - 1
    return lanes == 0


@inlined
def closest_alone(tree: Tree, axes: Axes, left: int, visit: Visit, hits: PacketHits, work: Work) -> PacketHits:
    """Trace the rays ``left`` (bits) one by one from a node or leaf on; return the hits of the whole packet."""
    write_rows(work, ALONE, HIT_T, (hits.t, hits.u, hits.v))
    write_prim_id(work, ALONE, hits.prim_id)
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        closest_single(tree, read_ray(work, axes, k), visit.child, visit.top, k, work)
    t, u = read_row(work, ALONE, HIT_T, hits.t), read_row(work, ALONE, HIT_U, hits.t)
    return PacketHits(t, u, read_row(work, ALONE, HIT_V, hits.t), read_prim_id(work, ALONE, hits.prim_id))


@inlined
def closest_in_leaf(leaves: Leaves, at: int, packet: RayPacket, hits: PacketHits, work: Work) -> PacketHits:
    """Nearest hits of a packet after it was tested against the triangles of a leaf."""
    t, u, v, prim = hits
    for k in range(NODE):
        number = peek(leaves.prim_id, at + PRIM_ID + k)
        if number < 0:
            break
        work.counts[1] += 1
        inside, t_new, u_new, v_new = intersect(leaves, packet.frame, one_triangle(leaves.rows, at + k, packet.axes))
        inside = inside & (t_new > packet.tmin) & ((t_new < t) | ((t_new == t) & (number < prim)))
        if bits(inside) != 0:
            t, u, v = select(inside, t_new, t), select(inside, u_new, u), select(inside, v_new, v)
            prim = select(inside, number, prim)
    return PacketHits(t, u, v, prim)


@inlined
def closest_packet(tree: Tree, packet: RayPacket, bounds: PacketBounds, alive: int, tmax, work: Work) -> PacketHits:
    """Nearest hits of the rays ``alive`` (bits) of a packet.

    Where few of them enter a node or a leaf, those are traced one by one from there.
    """
    zero = splat(0.0, tmax)
    hits = PacketHits(select(mask_of(alive, tmax), tmax, -np.inf), zero, zero, splat_int(-1, tmax))
    farthest = lane_max(hits.t)
    top, written = push(work, 0, 0, -np.inf, ROOT, alive), False
    while top > 0:
        top -= 1
        if peek(work.t, top) > farthest:
            continue
        child, left = np.int64(peek(work.child, top)), np.int64(peek(work.alive, top))
        if few(left, work):
            if not written:
                write_packet(work, packet)
                written = True
            hits = closest_alone(tree, packet.axes, left, Visit(child, top), hits, work)
        elif child >= 0:
            top = enter_packet(tree.nodes, child, packet, Reach(bounds, hits.t, farthest), top, work)
            continue
        else:
            hits = closest_in_leaf(tree.leaves, ~child * LEAF_SIZE, packet, hits, work)
        farthest = lane_max(hits.t)
    return hits


@inlined
def any_alone(tree: Tree, axes: Axes, left: int, visit: Visit, work: Work) -> int:
    """Trace the rays ``left`` (bits) one by one from a node or leaf on; bits of those that hit anything."""
    occluded = 0
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        tmax = read_lane(work, TMAX, k)
        occluded |= any_single(tree, read_ray(work, axes, k), tmax, visit.child, visit.top, work) << k
    return occluded


@inlined
def any_in_leaf(leaves: Leaves, at: int, packet: RayPacket, tmax, work: Work) -> int:
    """Bits of the rays of a packet that hit anything in a leaf."""
    occluded = 0
    for k in range(NODE):
        if peek(leaves.prim_id, at + PRIM_ID + k) < 0:
            break
        work.counts[1] += 1
        inside, t, _, _ = intersect(leaves, packet.frame, one_triangle(leaves.rows, at + k, packet.axes))
        occluded |= bits(inside & (t > packet.tmin) & (t < tmax))
    return occluded


@inlined
def any_packet(tree: Tree, packet: RayPacket, bounds: PacketBounds, alive: int, tmax, work: Work) -> int:
    """Bits of the rays ``alive`` (bits) of a packet that hit anything; few rays are traced one by one."""
    tmax = select(mask_of(alive, tmax), tmax, -np.inf)
    farthest = lane_max(tmax)
    top, occluded, written = put(work, 0, ROOT, alive), 0, False
    while top > 0 and occluded != alive:
        top -= 1
        child, left = np.int64(peek(work.child, top)), peek(work.alive, top) & ~occluded
        if few(left, work):
            if not written:
                write_packet(work, packet)
                write_rows(work, ALONE, TMAX, (tmax,))
                written = True
            occluded |= any_alone(tree, packet.axes, left, Visit(child, top), work)
        elif child >= 0:
            top = enter_packet_unsorted(tree.nodes, child, packet, Reach(bounds, tmax, farthest), top, work)
            continue
        else:
            occluded |= any_in_leaf(tree.leaves, ~child * LEAF_SIZE, packet, tmax, work)
        tmax = select(mask_of(occluded, tmax), -np.inf, tmax)
    return occluded
