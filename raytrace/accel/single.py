"""One ray through the tree: it is tested against the eight boxes of a node, or eight triangles of a leaf, at once."""

import numpy as np

from raytrace.accel.box import slab_test
from raytrace.accel.lanes import NODE, bits, first_bit, load, peek, poke, prefetch
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, NORMAL, PRESENT, PRIM_ID, V0, V1, V2
from raytrace.accel.octants import Axes, RayPacket
from raytrace.accel.scratch import HIT_T, HIT_U, HIT_V, read_lane, write_lane
from raytrace.accel.stack import NOTHING, pop, push, put
from raytrace.accel.triangle import Triangle, intersect
from raytrace.jit import inlined
from raytrace.records import Tree
from raytrace.work_records import Work


@inlined
def planes_of_node(bounds, at: int, axes: Axes):
    """Near planes (x, y, z) and far planes of the eight boxes of a node: lanes."""
    near = load(bounds, at + axes.near_x, 8), load(bounds, at + axes.near_y, 8), load(bounds, at + axes.near_z, 8)
    far = (
        load(bounds, at + 24 - axes.near_x, 8),
        load(bounds, at + 40 - axes.near_y, 8),
        load(bounds, at + 56 - axes.near_z, 8),
    )
    return near, far


@inlined
def corners(rows, at: int, axes: Axes):
    """x, y, z of a vertex, or of the normal, of eight triangles; the dominant axis of the ray comes last."""
    return load(rows, at + axes.x, 8), load(rows, at + axes.y, 8), load(rows, at + axes.z, 8)


@inlined
def eight_triangles(rows, at: int, axes: Axes) -> Triangle:
    """The eight triangles of a leaf."""
    return Triangle(
        corners(rows, at + V0, axes), corners(rows, at + V1, axes), corners(rows, at + V2, axes),
        corners(rows, at + NORMAL, axes),
    )  # fmt: skip


@inlined
def fetch(tree: Tree, child: int):
    """Prefetch a node or leaf that will be visited soon."""
    if child >= 0:
        for line in range(0, NODE_SIZE, 16):
            prefetch(tree.nodes.bounds, child * NODE_SIZE + line)
    else:
        for line in range(0, NORMAL, 16):
            prefetch(tree.leaves.rows, ~child * LEAF_SIZE + line)


@inlined
def enter_single(tree: Tree, node: int, ray: RayPacket, tmax, top: int, work: Work):
    """Nearest child of a node that a ray enters, or NOTHING; push the others, and return the new stack height too."""
    near, far = planes_of_node(tree.nodes.bounds, node * NODE_SIZE, ray.axes)
    t, entered = slab_test(ray.slabs, near, far, ray.tmin, tmax)
    work.counts[0] += 1
    # an empty child slot can be entered where an operand is NaN, so the bits of the present children are needed
    left = bits(entered) & np.int64(peek(tree.nodes.child, node * NODE_SIZE + PRESENT))
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
def enter_single_unsorted(tree: Tree, node: int, ray: RayPacket, tmax, top: int, work: Work):
    """Push the children of a node that a ray enters; return the new height of the stack."""
    near, far = planes_of_node(tree.nodes.bounds, node * NODE_SIZE, ray.axes)
    _, entered = slab_test(ray.slabs, near, far, ray.tmin, tmax)
    work.counts[0] += 1
    left = bits(entered) & np.int64(peek(tree.nodes.child, node * NODE_SIZE + PRESENT))
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        child = peek(tree.nodes.child, node * NODE_SIZE + CHILD + k)
        fetch(tree, child)
        top = put(work, top, child, 1)
    return top


@inlined
def closest_single(tree: Tree, ray: RayPacket, child: int, base: int, lane: int, work: Work):
    """Find the nearest hit of one ray below a child; read and write t, u, v, prim_id of its lane in scratch memory."""
    leaves = tree.leaves
    t, u, v = read_lane(work, HIT_T, lane), read_lane(work, HIT_U, lane), read_lane(work, HIT_V, lane)
    prim, top = peek(work.prim_id, lane), base
    while child != NOTHING:
        if child >= 0:
            child, top = enter_single(tree, child, ray, t, top, work)
            if child == NOTHING:
                child, top = pop(work, base, top, t)
            continue
        at = ~child * LEAF_SIZE
        work.counts[1] += NODE
        inside, t_new, u_new, v_new = intersect(leaves, ray.frame, eight_triangles(leaves.rows, at, ray.axes))
        left = bits(inside & (t_new > ray.tmin) & (t_new <= t))
        while left != 0:
            k = first_bit(left)
            left &= left - 1
            number = np.int32(peek(leaves.prim_id, at + PRIM_ID + k))
            if t_new[k] < t or (t_new[k] == t and number < prim):
                t, u, v, prim = t_new[k], u_new[k], v_new[k], number
        child, top = pop(work, base, top, t)
    write_lane(work, HIT_T, lane, t)
    write_lane(work, HIT_U, lane, u)
    write_lane(work, HIT_V, lane, v)
    poke(work.prim_id, lane, prim)


@inlined
def any_single(tree: Tree, ray: RayPacket, tmax, child: int, base: int, work: Work):
    """Whether one ray hits anything below a child: 1 or 0."""
    leaves, top = tree.leaves, put(work, base, child, 1)
    while top > base:
        top -= 1
        child = np.int64(peek(work.child, top))
        if child >= 0:
            top = enter_single_unsorted(tree, child, ray, tmax, top, work)
            continue
        work.counts[1] += NODE
        triangles = eight_triangles(leaves.rows, ~child * LEAF_SIZE, ray.axes)
        inside, t, _, _ = intersect(leaves, ray.frame, triangles)
        if bits(inside & (t > ray.tmin) & (t < tmax)) != 0:
            return 1
    return 0
