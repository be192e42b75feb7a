"""Rays through the tree: packets of rays against one box where rays run alike, one ray against eight boxes elsewhere.

Both ways do the same arithmetic on the same numbers and break ties alike, so they give the same bits.
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.box import slab_test
from raytrace.accel.lanes import NODE, bits, first_bit, lane_max, lane_min, load, select, splat, splat_int
from raytrace.accel.triangle import intersect
from raytrace.jit import inlined, subroutine

PLANES = 6 * NODE  # numbers of a node: low and high planes of three axes
ROWS = 12 * NODE  # numbers of a leaf: three vertices and a normal


class Axes(NamedTuple):
    """Where the planes and vertices of rays of one kind stand in a node and a leaf."""

    near_x: int  # first of the eight planes that face the rays; the far ones are the others
    near_y: int
    near_z: int
    x: int  # first of the eight x, y, z of a vertex, the dominant axis of the rays last
    y: int
    z: int


@inlined
def start(work):
    """Put the root on the stack."""
    work.t[0] = -np.inf
    work.child[0] = 0
    return 1


@inlined
def push(work, base, top, t, child):
    """Put a child on the stack, which above ``base`` is sorted with the nearest on top."""
    k = top
    while k > base and work.t[k - 1] < t:
        work.t[k] = work.t[k - 1]
        work.child[k] = work.child[k - 1]
        k -= 1
    work.t[k] = t
    work.child[k] = child
    return top + 1


@inlined
def planes_of(bounds, at, axes):
    """Near and far x, y, z planes of one box: numbers."""
    near = bounds[at + axes.near_x], bounds[at + axes.near_y], bounds[at + axes.near_z]
    far = bounds[at + 24 - axes.near_x], bounds[at + 40 - axes.near_y], bounds[at + 56 - axes.near_z]
    return near, far


@inlined
def planes_of_node(bounds, at, axes):
    """Near and far x, y, z planes of eight boxes: lanes."""
    near = load(bounds, at + axes.near_x, 8), load(bounds, at + axes.near_y, 8), load(bounds, at + axes.near_z, 8)
    far = (
        load(bounds, at + 24 - axes.near_x, 8),
        load(bounds, at + 40 - axes.near_y, 8),
        load(bounds, at + 56 - axes.near_z, 8),
    )
    return near, far


@inlined
def corner(rows, at, axes):
    """x, y, z of one triangle's vertex or normal, in the axes of the rays."""
    return rows[at + axes.x], rows[at + axes.y], rows[at + axes.z]


@inlined
def corners(rows, at, axes):
    """x, y, z of eight triangles' vertices or normals, in the axes of the rays."""
    return load(rows, at + axes.x, 8), load(rows, at + axes.y, 8), load(rows, at + axes.z, 8)


@inlined
def enter_packet(nodes, node, slabs, axes, tmin, tmax, top, work):
    """Push the children of a node that any ray of a packet enters."""
    base = top
    for k in range(NODE):
        child = nodes.child[node * NODE + k]
        if child == 0:
            break
        near, far = planes_of(nodes.bounds, node * PLANES + k, axes)
        t, entered = slab_test(slabs, near, far, tmin, tmax)
        if bits(entered) != 0:
            top = push(work, base, top, lane_min(select(entered, t, np.inf)), child)
    work.counts[0] += 1
    return top


@inlined
def enter_single(nodes, node, slabs, axes, tmin, tmax, top, work):
    """Push the children of a node that a ray enters."""
    near, far = planes_of_node(nodes.bounds, node * PLANES, axes)
    t, entered = slab_test(slabs, near, far, tmin, tmax)
    left = bits(entered)
    base = top
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        top = push(work, base, top, t[k], nodes.child[node * NODE + k])
    work.counts[0] += 1
    return top


@subroutine
def closest_packet(tree, slabs, frame, axes, tmin, tmax, work):
    """Nearest hits of a packet of one kind: t (tmax where none), prim_id, u, v. Lanes with tmax = -inf are dead."""
    nodes, leaves = tree.nodes, tree.leaves
    t, u, v, prim = tmax, splat(0.0, tmax), splat(0.0, tmax), splat_int(-1, tmax)
    farthest = lane_max(t)
    top = start(work)
    while top > 0:
        top -= 1
        if work.t[top] > farthest:
            continue
        child = work.child[top]
        if child >= 0:
            top = enter_packet(nodes, child, slabs, axes, tmin, t, top, work)
            continue
        at = ~child * ROWS
        for k in range(NODE):
            number = leaves.prim_id[~child * NODE + k]
            if number < 0:
                break
            work.counts[1] += 1
            inside, t_new, u_new, v_new = intersect(
                leaves, frame, corner(leaves.rows, at + k, axes), corner(leaves.rows, at + 24 + k, axes),
                corner(leaves.rows, at + 48 + k, axes), corner(leaves.rows, at + 72 + k, axes),
            )  # fmt: skip
            inside = inside & (t_new > tmin) & ((t_new < t) | ((t_new == t) & (number < prim)))
            if bits(inside) != 0:
                t = select(inside, t_new, t)
                u = select(inside, u_new, u)
                v = select(inside, v_new, v)
                prim = select(inside, number, prim)
        farthest = lane_max(t)
    return t, prim, u, v


@subroutine
def closest_single(tree, slabs, frame, axes, tmin, tmax, work):
    """Nearest hit of one ray: t (tmax where none), prim_id, u, v."""
    nodes, leaves = tree.nodes, tree.leaves
    t, u, v, prim = tmax, tmin, tmin, np.int32(-1)
    top = start(work)
    while top > 0:
        top -= 1
        if work.t[top] > t:
            continue
        child = work.child[top]
        if child >= 0:
            top = enter_single(nodes, child, slabs, axes, tmin, t, top, work)
            continue
        at = ~child * ROWS
        work.counts[1] += NODE
        inside, t_new, u_new, v_new = intersect(
            leaves, frame, corners(leaves.rows, at, axes), corners(leaves.rows, at + 24, axes),
            corners(leaves.rows, at + 48, axes), corners(leaves.rows, at + 72, axes),
        )  # fmt: skip
        left = bits(inside & (t_new > tmin) & (t_new <= t))
        while left != 0:
            k = first_bit(left)
            left &= left - 1
            number = leaves.prim_id[~child * NODE + k]
            if t_new[k] < t or (t_new[k] == t and number < prim):
                t, u, v, prim = t_new[k], u_new[k], v_new[k], number
    return t, prim, u, v


@subroutine
def any_packet(tree, slabs, frame, axes, tmin, tmax, work):
    """Bits of the rays of a packet of one kind that hit anything. Lanes with tmax = -inf are dead."""
    nodes, leaves = tree.nodes, tree.leaves
    occluded = 0
    alive = bits(tmin < tmax)
    top = start(work)
    while top > 0:
        top -= 1
        child = work.child[top]
        if child >= 0:
            top = enter_packet(nodes, child, slabs, axes, tmin, tmax, top, work)
            continue
        at = ~child * ROWS
        for k in range(NODE):
            if leaves.prim_id[~child * NODE + k] < 0:
                break
            work.counts[1] += 1
            inside, t, _, _ = intersect(
                leaves, frame, corner(leaves.rows, at + k, axes), corner(leaves.rows, at + 24 + k, axes),
                corner(leaves.rows, at + 48 + k, axes), corner(leaves.rows, at + 72 + k, axes),
            )  # fmt: skip
            inside = inside & (t > tmin) & (t < tmax)
            if bits(inside) != 0:
                occluded |= bits(inside)
                tmax = select(inside, -np.inf, tmax)
        if occluded == alive:
            break
    return occluded


@subroutine
def any_single(tree, slabs, frame, axes, tmin, tmax, work):
    """Whether one ray hits anything."""
    nodes, leaves = tree.nodes, tree.leaves
    top = start(work)
    while top > 0:
        top -= 1
        child = work.child[top]
        if child >= 0:
            top = enter_single(nodes, child, slabs, axes, tmin, tmax, top, work)
            continue
        at = ~child * ROWS
        work.counts[1] += NODE
        inside, t, _, _ = intersect(
            leaves, frame, corners(leaves.rows, at, axes), corners(leaves.rows, at + 24, axes),
            corners(leaves.rows, at + 48, axes), corners(leaves.rows, at + 72, axes),
        )  # fmt: skip
        if bits(inside & (t > tmin) & (t < tmax)) != 0:
            return True
    return False
