"""A bundle: packets whose rays run close together go through the tree as one, behind a frustum.

Boxes and triangles outside of the frustum are left out, eight at a time; what is left is tested against the rays as in
a packet, with the same bits. Groups of neighbouring rays have frusta of their own, all in one register: they tell which
packets of the bundle a box concerns.
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.frustum import Frustum, boxes_in, groups_at, triangles_in
from raytrace.accel.kinds import FRAME, HIT, TMIN, Axes, frame_of, hits_row, put, row, slot
from raytrace.accel.lanes import (
    bits,
    first_bit,
    fma,
    group_max,
    group_size,
    lane_max,
    lane_numbers,
    load,
    packet,
    peek,
    select,
    splat,
    store,
)
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, PRESENT, PRIM_ID
from raytrace.accel.packet import one_triangle
from raytrace.accel.stack import ROOT, push
from raytrace.accel.triangle import intersect
from raytrace.jit import inlined

BUNDLE = 4  # packets, at most: as many as a group has rays, so that all groups fill a register
GROUPS = 0x1111  # bits of the groups of a bundle's first packet; shifted by r, of packet r


class Bundle(NamedTuple):
    """Rays that go through the tree together; their frames and hits are in scratch memory."""

    whole: Frustum  # numbers
    groups: Frustum  # lanes
    axes: Axes
    count: int  # packets


def unbundled(tree):
    """The same tree, through which rays go in packets or alone: no bundle is narrow enough."""
    return tree._replace(extent=np.append(tree.extent[:6], tree.extent.dtype.type(-1)))


@inlined
def enter_bundle(tree, node, bundle, ends, top, work):
    """Push the children of a node that groups of a bundle meet."""
    base, at = top, node * NODE_SIZE
    inside, first = boxes_in(tree.nodes.bounds, at, bundle.whole, bundle.axes, ends[0])
    left = bits(inside) & np.int64(peek(tree.nodes.child, at + PRESENT))
    work.counts[0] += 1
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        met = bits(groups_at(tree.nodes.bounds, at + k, bundle.groups, bundle.axes, ends[1]))
        if met != 0:
            top = push(work, base, top, first[k], peek(tree.nodes.child, at + CHILD + k), met)
    return top


@inlined
def ends_of(bundle, work):
    """The largest sense * z that a bundle still reaches, and that each of its groups does."""
    like = packet(work.lanes)
    ends = splat(-np.inf, like)
    member = lane_numbers(like) & np.int32(group_size(work.lanes) - 1)
    for r in range(bundle.count):
        t, dz = row(work, slot(r) + HIT, like), row(work, slot(r) + FRAME + 5, like)
        end = fma(t, dz * bundle.whole.sense, row(work, slot(r) + FRAME + 2, like) * bundle.whole.sense)
        end = select(row(work, slot(r) + TMIN, like) < t, end, -np.inf)
        ends = select(member == np.int32(r), group_max(end), ends)
    ends = ends + bundle.whole.margin
    return lane_max(ends), ends


@inlined
def closest_in_packet(tree, at, r, axes, work):
    """Test the triangle of lane ``at`` of the leaves against packet r of a bundle; whether any ray hits it first."""
    like, prims = packet(work.lanes), hits_row(work, r)
    triangle = one_triangle(tree.leaves.rows, at, axes)
    inside, t_new, u_new, v_new = intersect(tree.leaves, frame_of(work, r, like), triangle)
    if bits(inside) == 0:
        return False
    number = np.int32(peek(tree.leaves.prim_id, at + PRIM_ID))
    t, prim = row(work, slot(r) + HIT, like), load(work.prim_id, prims, like)
    inside = inside & (t_new > row(work, slot(r) + TMIN, like))
    inside = inside & ((t_new < t) | ((t_new == t) & (number < prim)))
    if bits(inside) == 0:
        return False
    u, v = row(work, slot(r) + HIT + 1, like), row(work, slot(r) + HIT + 2, like)
    put(work, slot(r) + HIT, (select(inside, t_new, t), select(inside, u_new, u), select(inside, v_new, v)))
    store(work.prim_id, prims, select(inside, number, prim))
    return True


@inlined
def any_in_packet(tree, at, r, axes, work):
    """End the rays of packet r of a bundle that hit the triangle of lane ``at`` of the leaves; whether any does.

    Their tmax becomes -inf, and u 1.
    """
    like = packet(work.lanes)
    triangle = one_triangle(tree.leaves.rows, at, axes)
    inside, t, _, _ = intersect(tree.leaves, frame_of(work, r, like), triangle)
    if bits(inside) == 0:
        return False
    tmax, hit = row(work, slot(r) + HIT, like), row(work, slot(r) + HIT + 1, like)
    inside = inside & (t > row(work, slot(r) + TMIN, like)) & (t < tmax)
    put(work, slot(r) + HIT, (select(inside, splat(-np.inf, like), tmax), select(inside, splat(1.0, like), hit)))
    return bits(inside) != 0


@inlined
def visit_leaf(tree, at, bundle, met, test, work):
    """Test the triangles of a leaf that a frustum meets against the packets of some groups; whether any is hit."""
    found = False
    left = bits(triangles_in(tree.leaves.rows, at, bundle.whole, bundle.axes))
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        if peek(tree.leaves.prim_id, at + PRIM_ID + k) < 0:
            break
        for r in range(bundle.count):
            if met & (GROUPS << r) != 0:
                work.counts[1] += 1
                if test(tree, at + k, r, bundle.axes, work):
                    found = True
    return found


@inlined
def trace_bundle(tree, bundle, test, work):
    """Take a bundle through the tree: the nearest hits of its rays, or the end of those that hit anything."""
    ends = ends_of(bundle, work)
    top = push(work, 0, 0, -np.inf, ROOT, 1)
    while top > 0:
        top -= 1
        if peek(work.t, top) > ends[0]:
            continue
        child = np.int64(peek(work.child, top))
        if child >= 0:
            top = enter_bundle(tree, child, bundle, ends, top, work)
            continue
        met = np.int64(peek(work.alive, top)) & bits(ends[1] >= peek(work.t, top))
        if met != 0 and visit_leaf(tree, ~child * LEAF_SIZE, bundle, met, test, work):
            ends = ends_of(bundle, work)
