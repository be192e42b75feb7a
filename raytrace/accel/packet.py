"""A packet of rays of one kind through the tree: against one box or one triangle after the other.

Where few of them are left, they go on one by one. Both ways do the same arithmetic on the same numbers and break ties
alike, so they give the same bits.
"""

import numpy as np

from raytrace.accel.box import beam_test, slab_test
from raytrace.accel.kinds import HIT, number_of, put, put_rays, ray_of, row
from raytrace.accel.lanes import (
    NODE,
    bits,
    first_bit,
    lane_max,
    lane_min,
    load,
    mask_of,
    packet_width,
    peek,
    select,
    splat,
    splat_int,
    store,
)
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, NORMAL, PRESENT, PRIM_ID, V0, V1, V2
from raytrace.accel.single import any_single, closest_single, planes_of_node
from raytrace.accel.stack import ROOT, push
from raytrace.accel.triangle import intersect
from raytrace.jit import inlined

FEW = 4  # rays of a packet that are better off alone, and never more than half of it


@inlined
def planes_of(bounds, at, axes):
    """Near and far x, y, z planes of one box: numbers."""
    near = peek(bounds, at + axes.near_x), peek(bounds, at + axes.near_y), peek(bounds, at + axes.near_z)
    far = peek(bounds, at + 24 - axes.near_x), peek(bounds, at + 40 - axes.near_y), peek(bounds, at + 56 - axes.near_z)
    return near, far


@inlined
def corner(rows, at, axes):
    """x, y, z of one triangle's vertex or normal, in the axes of the rays."""
    return peek(rows, at + axes.x), peek(rows, at + axes.y), peek(rows, at + axes.z)


@inlined
def one_triangle(rows, at, axes):
    """Vertices and normal of one triangle of a leaf."""
    return (
        corner(rows, at + V0, axes), corner(rows, at + V1, axes), corner(rows, at + V2, axes),
        corner(rows, at + NORMAL, axes),
    )  # fmt: skip


@inlined
def enter_packet(nodes, node, rays, limits, top, work):
    """Push the children of a node that any ray of a packet enters.

    ``limits`` are the beam of the packet, tmax of its rays, and the largest of them. All eight boxes are tested against
    the beam first; a tree of one node has no use for that.
    """
    beam, tmax, farthest = limits
    base, at = top, node * NODE_SIZE
    left = np.int64(peek(nodes.child, at + PRESENT))  # where quotients overflow, a NaN enters what is absent
    if len(nodes.bounds) > NODE_SIZE:
        near, far = planes_of_node(nodes.bounds, at, rays.axes)
        left &= bits(beam_test(beam, near, far, farthest))
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        child = peek(nodes.child, at + CHILD + k)
        near, far = planes_of(nodes.bounds, at + k, rays.axes)
        t, entered = slab_test(rays.slabs, near, far, rays.tmin, tmax)
        lanes = bits(entered)
        if lanes != 0:
            top = push(work, base, top, lane_min(select(entered, t, np.inf)), child, lanes)
    work.counts[0] += 1
    return top


@inlined
def few(lanes, work):
    """At most FEW bits are set, or half of a packet's if it has fewer than 2 FEW."""
    for _ in range(min(FEW, packet_width(work.lanes) // 2)):
        lanes &= lanes - 1
    return lanes == 0


@inlined
def closest_alone(tree, rays, left, start, hit, work):
    """Send the rays ``left`` (bits) on one by one, from (child, height of the stack) on; what all have hit then."""
    child, top = start
    put(work, HIT, hit[:3])
    store(work.prim_id, 0, hit[3])
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        closest_single(tree, ray_of(work, rays.axes, k), child, top, k, work)
    t, u, v = row(work, HIT, hit[0]), row(work, HIT + 1, hit[0]), row(work, HIT + 2, hit[0])
    return t, u, v, load(work.prim_id, 0, hit[3])


@inlined
def closest_in_leaf(leaves, at, rays, work, hit):
    """What a packet has hit after a leaf."""
    t, u, v, prim = hit
    for k in range(NODE):
        number = peek(leaves.prim_id, at + PRIM_ID + k)
        if number < 0:
            break
        work.counts[1] += 1
        inside, t_new, u_new, v_new = intersect(leaves, rays.frame, one_triangle(leaves.rows, at + k, rays.axes))
        inside = inside & (t_new > rays.tmin) & ((t_new < t) | ((t_new == t) & (number < prim)))
        if bits(inside) != 0:
            t, u, v = select(inside, t_new, t), select(inside, u_new, u), select(inside, v_new, v)
            prim = select(inside, number, prim)
    return t, u, v, prim


@inlined
def closest_packet(tree, rays, beam, alive, tmax, work):
    """Nearest hits of the rays ``alive`` (bits) of a packet, all of one kind: t (tmax where none), u, v, prim_id.

    Where few of them enter a node or a leaf, they go on from there one by one.
    """
    zero = splat(0.0, tmax)
    hit = select(mask_of(alive, tmax), tmax, -np.inf), zero, zero, splat_int(-1, tmax)
    farthest = lane_max(hit[0])
    top, written = push(work, 0, 0, -np.inf, ROOT, alive), False
    while top > 0:
        top -= 1
        if peek(work.t, top) > farthest:
            continue
        child, left = np.int64(peek(work.child, top)), np.int64(peek(work.alive, top))
        if few(left, work):
            if not written:
                put_rays(work, rays)
                written = True
            hit = closest_alone(tree, rays, left, (child, top), hit, work)
        elif child >= 0:
            top = enter_packet(tree.nodes, child, rays, (beam, hit[0], farthest), top, work)
            continue
        else:
            hit = closest_in_leaf(tree.leaves, ~child * LEAF_SIZE, rays, work, hit)
        farthest = lane_max(hit[0])
    return hit


@inlined
def any_alone(tree, rays, left, child, top, work):
    """Bits of the rays ``left`` that hit anything, sent on one by one from a child on."""
    occluded = 0
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        occluded |= any_single(tree, ray_of(work, rays.axes, k), number_of(work, HIT, k), child, top, work) << k
    return occluded


@inlined
def any_in_leaf(leaves, at, rays, tmax, work):
    """Bits of the rays of a packet that hit anything in a leaf."""
    occluded = 0
    for k in range(NODE):
        if peek(leaves.prim_id, at + PRIM_ID + k) < 0:
            break
        work.counts[1] += 1
        inside, t, _, _ = intersect(leaves, rays.frame, one_triangle(leaves.rows, at + k, rays.axes))
        occluded |= bits(inside & (t > rays.tmin) & (t < tmax))
    return occluded


@inlined
def any_packet(tree, rays, beam, alive, tmax, work):
    """Bits of the rays ``alive`` of a packet, all of one kind, that hit anything; few rays go on one by one."""
    tmax = select(mask_of(alive, tmax), tmax, -np.inf)
    farthest = lane_max(tmax)
    top, occluded, written = push(work, 0, 0, -np.inf, ROOT, alive), 0, False
    while top > 0 and occluded != alive:
        top -= 1
        child, left = np.int64(peek(work.child, top)), peek(work.alive, top) & ~occluded
        if few(left, work):
            if not written:
                put_rays(work, rays)
                put(work, HIT, (tmax,))
                written = True
            occluded |= any_alone(tree, rays, left, child, top, work)
        elif child >= 0:
            top = enter_packet(tree.nodes, child, rays, (beam, tmax, farthest), top, work)
            continue
        else:
            occluded |= any_in_leaf(tree.leaves, ~child * LEAF_SIZE, rays, tmax, work)
        tmax = select(mask_of(occluded, tmax), -np.inf, tmax)
    return occluded
