"""A bundle: up to four packets whose rays run close together go through the tree as one, behind a frustum.

Boxes and triangles outside the frustum are skipped, eight at a time. What is left is tested against the rays as in a
packet, with bit-identical results. Each group of neighbouring rays has a frustum of its own, and the frusta of all
groups fill one register. They decide which packets of the bundle are tested.
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.frustum import Frustum, boxes_in, groups_at, triangles_in, triangles_on_the_way
from raytrace.accel.lanes import (
    bits,
    first_bit,
    fma,
    group_max,
    group_size,
    lane_max,
    lane_numbers,
    packet,
    peek,
    select,
    splat,
)
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, PRESENT, PRIM_ID
from raytrace.accel.octants import Axes
from raytrace.accel.packet import one_triangle
from raytrace.accel.scratch import (
    FRAME_DZ,
    FRAME_Z,
    HIT_T,
    HIT_U,
    HIT_V,
    OCCLUDED,
    TMAX,
    TMIN,
    read_frame,
    read_prim_id,
    read_row,
    write_prim_id,
    write_rows,
)
from raytrace.accel.stack import ROOT, push
from raytrace.accel.triangle import intersect
from raytrace.jit import inlined, specialised
from raytrace.records import Tree
from raytrace.work_records import Work

BUNDLE = 4  # most packets of a bundle: as many as a group has rays, so that all groups fill a register
GROUPS = 0x1111  # bits of the groups of a bundle's first packet; shifted by r, of packet r


class Bundle(NamedTuple):
    """Rays that go through the tree together; their frames and hits are in scratch memory."""

    whole: Frustum  # numbers
    groups: Frustum  # lanes
    axes: Axes
    count: int  # packets
    nearest_first: bool  # whether the stack is sorted


class Ends(NamedTuple):
    """Largest sense * z that the rays of a bundle can still reach; see ``Frustum.sense``."""

    whole: float  # number: of all rays
    groups: float  # lanes: of the rays of each group


class MetLeaf(NamedTuple):
    """A leaf that a bundle meets."""

    at: int  # its first triangle
    met: int  # bits: groups that meet it
    end: float  # largest sense * z that any ray can still reach


def unbundled(tree: Tree) -> Tree:
    """Return the same tree without bundles: its usual leaf has side -1, for which no bundle is narrow enough."""
    return tree._replace(extent=np.append(tree.extent[:6], tree.extent.dtype.type(-1)))


@inlined
def enter_bundle(tree: Tree, node: int, bundle: Bundle, ends: Ends, top: int, work: Work):
    """Push the children of a node that any group of a bundle meets; return the new height of the stack."""
    base, at = top, node * NODE_SIZE
    inside, first = boxes_in(tree.nodes.bounds, at, bundle.whole, bundle.axes, ends.whole)
    left = bits(inside) & np.int64(peek(tree.nodes.child, at + PRESENT))
    work.counts[0] += 1
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        met = bits(groups_at(tree.nodes.bounds, at + k, bundle.groups, bundle.axes, ends.groups))
        if met != 0:
            top = push(
                work, base if bundle.nearest_first else top, top, first[k], peek(tree.nodes.child, at + CHILD + k), met
            )
    return top


@inlined
def ends_of(bundle: Bundle, work: Work) -> Ends:
    """Where the rays of a bundle end, after the hits so far."""
    like = packet(work.lanes)
    ends = splat(-np.inf, like)
    member = lane_numbers(like) & np.int32(group_size(work.lanes) - 1)
    for r in range(bundle.count):
        t, dz = read_row(work, r, HIT_T, like), read_row(work, r, FRAME_DZ, like)
        end = fma(t, dz * bundle.whole.sense, read_row(work, r, FRAME_Z, like) * bundle.whole.sense)
        end = select(read_row(work, r, TMIN, like) < t, end, -np.inf)
        ends = select(member == np.int32(r), group_max(end), ends)
    ends = ends + bundle.whole.margin
    return Ends(lane_max(ends), ends)


@inlined
def closest_in_packet(tree: Tree, at: int, r: int, axes: Axes, work: Work):
    """Test packet r of a bundle against the triangle in lane ``at`` of the leaves; whether it is the nearest of any."""
    like = packet(work.lanes)
    triangle = one_triangle(tree.leaves.rows, at, axes)
    inside, t_new, u_new, v_new = intersect(tree.leaves, read_frame(work, r, like), triangle)
    if bits(inside) == 0:
        return False
    number = np.int32(peek(tree.leaves.prim_id, at + PRIM_ID))
    t, prim = read_row(work, r, HIT_T, like), read_prim_id(work, r, like)
    inside = inside & (t_new > read_row(work, r, TMIN, like))
    inside = inside & ((t_new < t) | ((t_new == t) & (number < prim)))
    if bits(inside) == 0:
        return False
    u, v = read_row(work, r, HIT_U, like), read_row(work, r, HIT_V, like)
    write_rows(work, r, HIT_T, (select(inside, t_new, t), select(inside, u_new, u), select(inside, v_new, v)))
    write_prim_id(work, r, select(inside, number, prim))
    return True


@inlined
def any_in_packet(tree: Tree, at: int, r: int, axes: Axes, work: Work):
    """Test packet r of a bundle against the triangle in lane ``at`` of the leaves; whether any ray hits it.

    For rays that hit it, tmax becomes -inf and the occluded flag 1.
    """
    like = packet(work.lanes)
    triangle = one_triangle(tree.leaves.rows, at, axes)
    inside, t, _, _ = intersect(tree.leaves, read_frame(work, r, like), triangle)
    if bits(inside) == 0:
        return False
    tmax, occluded = read_row(work, r, TMAX, like), read_row(work, r, OCCLUDED, like)
    inside = inside & (t > read_row(work, r, TMIN, like)) & (t < tmax)
    ended = select(inside, splat(-np.inf, like), tmax)
    write_rows(work, r, TMAX, (ended, select(inside, splat(1.0, like), occluded)))
    return bits(inside) != 0


def triangles_met(rows, at: int, bundle: Bundle, end, test):
    """Mask of the eight triangles of a leaf that the rays of a bundle may meet.

    Shadow rays begin on one surface and end before others, so these are left out. Nearest hits are seldom beyond.
    """
    if test is any_in_packet:
        return triangles_on_the_way(rows, at, bundle.whole, bundle.axes, end)
    return triangles_in(rows, at, bundle.whole, bundle.axes)


@specialised(triangles_met)
def _triangles_met(rows, at, bundle, end, test):
    if test.dispatcher.py_func is any_in_packet:
        return lambda rows, at, bundle, end, test: triangles_on_the_way(rows, at, bundle.whole, bundle.axes, end)
    return lambda rows, at, bundle, end, test: triangles_in(rows, at, bundle.whole, bundle.axes)


def nearest_first(test) -> bool:
    """Whether near boxes are visited before others: not by shadow rays, which end at any hit."""
    return test is not any_in_packet


@specialised(nearest_first)
def _nearest_first(test):
    if test.dispatcher.py_func is any_in_packet:
        return lambda test: False
    return lambda test: True


@inlined
def visit_leaf(tree: Tree, leaf: MetLeaf, bundle: Bundle, test, work: Work):
    """Test the triangles of a leaf that reach into the frustum against the packets of the groups that meet it.

    Returns whether ``test`` reports a hit of any ray.
    """
    found = False
    left = bits(triangles_met(tree.leaves.rows, leaf.at, bundle, leaf.end, test))
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        if peek(tree.leaves.prim_id, leaf.at + PRIM_ID + k) < 0:
            break
        for r in range(bundle.count):
            if leaf.met & (GROUPS << r) != 0:
                work.counts[1] += 1
                if test(tree, leaf.at + k, r, bundle.axes, work):
                    found = True
    return found


@inlined
def trace_bundle(tree: Tree, bundle: Bundle, test, work: Work):
    """Trace a bundle: nearest hits or occlusion, as ``test`` decides, are written to scratch memory."""
    ends = ends_of(bundle, work)
    top = push(work, 0, 0, -np.inf, ROOT, 1)
    while top > 0:
        top -= 1
        if peek(work.t, top) > ends.whole:
            continue
        child = np.int64(peek(work.child, top))
        if child >= 0:
            top = enter_bundle(tree, child, bundle, ends, top, work)
            continue
        met = np.int64(peek(work.alive, top)) & bits(ends.groups >= peek(work.t, top))
        leaf = MetLeaf(~child * LEAF_SIZE, met, ends.whole)
        if met != 0 and visit_leaf(tree, leaf, bundle, test, work) and top > 0:
            ends = ends_of(bundle, work)
