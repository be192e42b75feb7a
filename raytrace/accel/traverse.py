"""Rays through the tree: packets of rays against one box where rays run alike, one ray against eight boxes elsewhere.

Both ways do the same arithmetic on the same numbers and break ties alike, so they give the same bits.
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.box import Slabs, slab_test
from raytrace.accel.lanes import (
    NODE,
    bits,
    first_bit,
    lane_max,
    lane_min,
    load,
    peek,
    poke,
    prefetch,
    select,
    splat,
    splat_int,
)
from raytrace.accel.triangle import Frame, intersect
from raytrace.jit import inlined

PLANES = 6 * NODE  # numbers of a node: low and high planes of three axes
ROWS = 12 * NODE  # numbers of a leaf: three vertices and a normal
ROOT = np.int32(0)
NOTHING = np.int32(-(2**31))  # no child


class Axes(NamedTuple):
    """Where the planes and vertices of rays of one kind stand in a node and a leaf."""

    near_x: int  # first of the eight planes that face the rays; the far ones are the others
    near_y: int
    near_z: int
    x: int  # first of the eight x, y, z of a vertex, the dominant axis of the rays last
    y: int
    z: int


class Alike(NamedTuple):
    """Rays of one kind: lanes for a packet, numbers for a single ray."""

    slabs: Slabs
    frame: Frame
    axes: Axes
    tmin: float


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
    while k > base and peek(work.t, k - 1) < t:
        poke(work.t, k, peek(work.t, k - 1))
        poke(work.child, k, peek(work.child, k - 1))
        k -= 1
    poke(work.t, k, t)
    poke(work.child, k, child)
    return top + 1


@inlined
def planes_of(bounds, at, axes):
    """Near and far x, y, z planes of one box: numbers."""
    near = peek(bounds, at + axes.near_x), peek(bounds, at + axes.near_y), peek(bounds, at + axes.near_z)
    far = peek(bounds, at + 24 - axes.near_x), peek(bounds, at + 40 - axes.near_y), peek(bounds, at + 56 - axes.near_z)
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
    return peek(rows, at + axes.x), peek(rows, at + axes.y), peek(rows, at + axes.z)


@inlined
def corners(rows, at, axes):
    """x, y, z of eight triangles' vertices or normals, in the axes of the rays."""
    return load(rows, at + axes.x, 8), load(rows, at + axes.y, 8), load(rows, at + axes.z, 8)


@inlined
def enter_packet(nodes, node, rays, tmax, top, work):
    """Push the children of a node that any ray of a packet enters."""
    base = top
    for k in range(NODE):
        child = peek(nodes.child, node * NODE + k)
        if child == 0:
            break
        near, far = planes_of(nodes.bounds, node * PLANES + k, rays.axes)
        t, entered = slab_test(rays.slabs, near, far, rays.tmin, tmax)
        if bits(entered) != 0:
            top = push(work, base, top, lane_min(select(entered, t, np.inf)), child)
    work.counts[0] += 1
    return top


@inlined
def fetch(tree, child):
    """Ask for a node or leaf before it is its turn."""
    if child >= 0:
        for line in range(0, PLANES, 16):
            prefetch(tree.nodes.bounds, child * PLANES + line)
        prefetch(tree.nodes.child, child * NODE)
    else:
        for line in range(0, 72, 16):
            prefetch(tree.leaves.rows, ~child * ROWS + line)


@inlined
def enter_single(tree, node, rays, tmax, top, work):
    """Nearest child of a node that a ray enters, or NOTHING; the others go on the stack, whose height it returns."""
    near, far = planes_of_node(tree.nodes.bounds, node * PLANES, rays.axes)
    t, entered = slab_test(rays.slabs, near, far, rays.tmin, tmax)
    work.counts[0] += 1
    left = bits(entered)
    if left == 0:
        return NOTHING, top
    k = first_bit(left)
    left &= left - 1
    nearest, t_nearest = peek(tree.nodes.child, node * NODE + k), t[k]
    fetch(tree, nearest)
    base = top
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        child, t_child = peek(tree.nodes.child, node * NODE + k), t[k]
        fetch(tree, child)
        if t_child < t_nearest:
            nearest, child = child, nearest
            t_nearest, t_child = t_child, t_nearest
        top = push(work, base, top, t_child, child)
    return nearest, top


@inlined
def pop(work, top, tmax):
    """The nearest child on the stack that is not behind tmax, or NOTHING; and the height of the stack."""
    while top > 0:
        top -= 1
        if peek(work.t, top) <= tmax:
            return peek(work.child, top), top
    return NOTHING, top


@inlined
def closest_packet(tree, rays, tmax, work):
    """Nearest hits of a packet of one kind: t (tmax where none), prim_id, u, v. Lanes with tmax = -inf are dead."""
    nodes, leaves, axes, tmin = tree.nodes, tree.leaves, rays.axes, rays.tmin
    t, u, v, prim = tmax, splat(0.0, tmax), splat(0.0, tmax), splat_int(-1, tmax)
    farthest = lane_max(t)
    top, tested = start(work), 0
    while top > 0:
        top -= 1
        if peek(work.t, top) > farthest:
            continue
        child = peek(work.child, top)
        if child >= 0:
            top = enter_packet(nodes, child, rays, t, top, work)
            continue
        at = ~child * ROWS
        for k in range(NODE):
            number = peek(leaves.prim_id, ~child * NODE + k)
            if number < 0:
                break
            tested += 1
            inside, t_new, u_new, v_new = intersect(
                leaves, rays.frame, corner(leaves.rows, at + k, axes), corner(leaves.rows, at + 24 + k, axes),
                corner(leaves.rows, at + 48 + k, axes), corner(leaves.rows, at + 72 + k, axes),
            )  # fmt: skip
            inside = inside & (t_new > tmin) & ((t_new < t) | ((t_new == t) & (number < prim)))
            if bits(inside) != 0:
                t = select(inside, t_new, t)
                u = select(inside, u_new, u)
                v = select(inside, v_new, v)
                prim = select(inside, number, prim)
        farthest = lane_max(t)
    work.counts[1] += tested
    return t, prim, u, v


@inlined
def closest_single(tree, rays, tmax, work):
    """Nearest hit of one ray: t (tmax where none), prim_id, u, v."""
    leaves, axes, tmin = tree.leaves, rays.axes, rays.tmin
    t, u, v, prim = tmax, tmin, tmin, np.int32(-1)
    child, top, tested = ROOT, 0, 0
    while child != NOTHING:
        if child >= 0:
            child, top = enter_single(tree, child, rays, t, top, work)
            if child == NOTHING:
                child, top = pop(work, top, t)
            continue
        at = ~child * ROWS
        tested += NODE
        inside, t_new, u_new, v_new = intersect(
            leaves, rays.frame, corners(leaves.rows, at, axes), corners(leaves.rows, at + 24, axes),
            corners(leaves.rows, at + 48, axes), corners(leaves.rows, at + 72, axes),
        )  # fmt: skip
        left = bits(inside & (t_new > tmin) & (t_new <= t))
        while left != 0:
            k = first_bit(left)
            left &= left - 1
            number = peek(leaves.prim_id, ~child * NODE + k)
            if t_new[k] < t or (t_new[k] == t and number < prim):
                t, u, v, prim = t_new[k], u_new[k], v_new[k], number
        child, top = pop(work, top, t)
    work.counts[1] += tested
    return t, prim, u, v


@inlined
def any_packet(tree, rays, tmax, work):
    """Bits of the rays of a packet of one kind that hit anything. Lanes with tmax = -inf are dead."""
    nodes, leaves, axes, tmin = tree.nodes, tree.leaves, rays.axes, rays.tmin
    occluded = 0
    alive = bits(tmin < tmax)
    top, tested = start(work), 0
    while top > 0:
        top -= 1
        child = peek(work.child, top)
        if child >= 0:
            top = enter_packet(nodes, child, rays, tmax, top, work)
            continue
        at = ~child * ROWS
        for k in range(NODE):
            if peek(leaves.prim_id, ~child * NODE + k) < 0:
                break
            tested += 1
            inside, t, _, _ = intersect(
                leaves, rays.frame, corner(leaves.rows, at + k, axes), corner(leaves.rows, at + 24 + k, axes),
                corner(leaves.rows, at + 48 + k, axes), corner(leaves.rows, at + 72 + k, axes),
            )  # fmt: skip
            inside = inside & (t > tmin) & (t < tmax)
            if bits(inside) != 0:
                occluded |= bits(inside)
                tmax = select(inside, -np.inf, tmax)
        if occluded == alive:
            break
    work.counts[1] += tested
    return occluded


@inlined
def any_single(tree, rays, tmax, work):
    """Whether one ray hits anything."""
    leaves, axes, tmin = tree.leaves, rays.axes, rays.tmin
    child, top, tested = ROOT, 0, 0
    while child != NOTHING:
        if child >= 0:
            child, top = enter_single(tree, child, rays, tmax, top, work)
            if child == NOTHING:
                child, top = pop(work, top, tmax)
            continue
        at = ~child * ROWS
        tested += NODE
        inside, t, _, _ = intersect(
            leaves, rays.frame, corners(leaves.rows, at, axes), corners(leaves.rows, at + 24, axes),
            corners(leaves.rows, at + 48, axes), corners(leaves.rows, at + 72, axes),
        )  # fmt: skip
        if bits(inside & (t > tmin) & (t < tmax)) != 0:
            work.counts[1] += tested
            return True
        child, top = pop(work, top, tmax)
    work.counts[1] += tested
    return False
