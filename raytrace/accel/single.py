"""One ray through the tree: against the eight boxes of a node, or the eight triangles of a leaf, at once."""

import numpy as np

from raytrace.accel.box import slab_test
from raytrace.accel.kinds import HIT, number_of, put_number
from raytrace.accel.lanes import NODE, bits, first_bit, load, peek, poke, prefetch
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, NORMAL, PRESENT, PRIM_ID, V0, V1, V2
from raytrace.accel.stack import NOTHING, pop, push
from raytrace.accel.triangle import intersect
from raytrace.jit import inlined


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
def corners(rows, at, axes):
    """x, y, z of eight triangles' vertices or normals, in the axes of the rays."""
    return load(rows, at + axes.x, 8), load(rows, at + axes.y, 8), load(rows, at + axes.z, 8)


@inlined
def eight_triangles(rows, at, axes):
    """Vertices and normals of the eight triangles of a leaf."""
    return (
        corners(rows, at + V0, axes), corners(rows, at + V1, axes), corners(rows, at + V2, axes),
        corners(rows, at + NORMAL, axes),
    )  # fmt: skip


@inlined
def fetch(tree, child):
    """Ask for a node or leaf before it is its turn."""
    if child >= 0:
        for line in range(0, NODE_SIZE, 16):
            prefetch(tree.nodes.bounds, child * NODE_SIZE + line)
    else:
        for line in range(0, NORMAL, 16):
            prefetch(tree.leaves.rows, ~child * LEAF_SIZE + line)


@inlined
def enter_single(tree, node, rays, tmax, top, work):
    """Nearest child of a node that a ray enters, or NOTHING; the others go on the stack, whose height it returns."""
    near, far = planes_of_node(tree.nodes.bounds, node * NODE_SIZE, rays.axes)
    t, entered = slab_test(rays.slabs, near, far, rays.tmin, tmax)
    work.counts[0] += 1
    left = bits(entered) & np.int64(peek(tree.nodes.child, node * NODE_SIZE + PRESENT))  # a NaN enters what is absent
    if left == 0:
        return NOTHING, top
    k = first_bit(left)
    left &= left - 1
    nearest, t_nearest = peek(tree.nodes.child, node * NODE_SIZE + CHILD + k), t[k]
    fetch(tree, nearest)
    base = top
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        child, t_child = peek(tree.nodes.child, node * NODE_SIZE + CHILD + k), t[k]
        fetch(tree, child)
        if t_child < t_nearest:
            nearest, child = child, nearest
            t_nearest, t_child = t_child, t_nearest
        top = push(work, base, top, t_child, child, 1)
    return nearest, top


@inlined
def closest_single(tree, rays, child, base, lane, work):
    """Nearest hit of one ray below a child; t, u, v, prim_id of its lane in scratch memory are read and written."""
    leaves = tree.leaves
    t, u, v = number_of(work, HIT, lane), number_of(work, HIT + 1, lane), number_of(work, HIT + 2, lane)
    prim, top = peek(work.prim_id, lane), base
    while child != NOTHING:
        if child >= 0:
            child, top = enter_single(tree, child, rays, t, top, work)
            if child == NOTHING:
                child, top = pop(work, base, top, t)
            continue
        at = ~child * LEAF_SIZE
        work.counts[1] += NODE
        inside, t_new, u_new, v_new = intersect(leaves, rays.frame, eight_triangles(leaves.rows, at, rays.axes))
        left = bits(inside & (t_new > rays.tmin) & (t_new <= t))
        while left != 0:
            k = first_bit(left)
            left &= left - 1
            number = np.int32(peek(leaves.prim_id, at + PRIM_ID + k))
            if t_new[k] < t or (t_new[k] == t and number < prim):
                t, u, v, prim = t_new[k], u_new[k], v_new[k], number
        child, top = pop(work, base, top, t)
    put_number(work, HIT, lane, t)
    put_number(work, HIT + 1, lane, u)
    put_number(work, HIT + 2, lane, v)
    poke(work.prim_id, lane, prim)


@inlined
def any_single(tree, rays, tmax, child, base, work):
    """Whether one ray hits anything below a child: 1 or 0."""
    leaves, top = tree.leaves, base
    while child != NOTHING:
        if child >= 0:
            child, top = enter_single(tree, child, rays, tmax, top, work)
            if child == NOTHING:
                child, top = pop(work, base, top, tmax)
            continue
        work.counts[1] += NODE
        triangles = eight_triangles(leaves.rows, ~child * LEAF_SIZE, rays.axes)
        inside, t, _, _ = intersect(leaves, rays.frame, triangles)
        if bits(inside & (t > rays.tmin) & (t < tmax)) != 0:
            return 1
        child, top = pop(work, base, top, tmax)
    return 0
