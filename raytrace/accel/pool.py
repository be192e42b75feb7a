"""A pool: the rays of a bundle go through the tree each on its own, but in turn, one step at a time.

A step has no branch that depends on the ray: where a ray goes next only decides to which of two queues its number is
appended, of rays before a node or of rays before a leaf. So the steps of different rays overlap in the processor,
where a ray that is traced alone would wait for each of its steps. The rays of a pool need share nothing.
"""

import numpy as np

from raytrace.accel.box import make_slabs, slab_test
from raytrace.accel.lanes import (
    BITS,
    NODE,
    absolute,
    bits,
    count,
    first_bit,
    lane_max,
    lane_min,
    lane_numbers,
    least_lane,
    load,
    machine_epsilon,
    mask_of,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    peek_either,
    poke,
    prefetch,
    select,
    splat,
    splat_int,
    store,
    store_packed,
)  # fmt: skip
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, NORMAL, PRESENT, PRIM_ID
from raytrace.accel.pool_scratch import (
    BOTTOM,
    NEXT,
    PLACE,
    QUEUE,
    RAYS,
    TOP,
    axes_of_ray,
    frame_of_ray,
    read_number,
    read_state,
    slabs_of_ray,
    write_number,
    write_state,
)
from raytrace.accel.scratch import (
    FRAME,
    HIT_T,
    HIT_U,
    HIT_V,
    OCCLUDED,
    ROWS,
    SLABS,
    TMIN,
    read_bundle_rays,
    write_rows,
)  # fmt: skip
from raytrace.accel.single import eight_triangles, planes_of_node
from raytrace.accel.stack import NOTHING, ROOT
from raytrace.accel.triangle import Triangle, intersect
from raytrace.jit import inlined, specialised
from raytrace.records import Tree
from raytrace.work_records import PoolWork, Work

POOL_NODES = 16  # least nodes of a tree: in smaller ones, packets are faster
SCATTERED = 0.5  # least spread of the directions of a bundle: where they differ less, packets are faster


@inlined
def suits_pool(tree: Tree) -> bool:
    """Whether a pool can be faster in a tree: with registers of 512 bits, which can be packed, and enough nodes."""
    return BITS == 512 and len(tree.nodes.bounds) >= POOL_NODES * NODE_SIZE


@inlined
def spread(packets: int, work: PoolWork):
    """Sum of the extents along x, y and z of the directions of a bundle, whose largest components are scaled to 1."""
    like = packet(work.lanes)
    low_x, low_y, low_z = splat(np.inf, like), splat(np.inf, like), splat(np.inf, like)
    high_x, high_y, high_z = splat(-np.inf, like), splat(-np.inf, like), splat(-np.inf, like)
    for r in range(packets):
        _, d, _, tmin, tmax = read_bundle_rays(work, r, like)
        scale, alive = 1.0 / maximum(maximum(absolute(d[0]), absolute(d[1])), absolute(d[2])), tmin < tmax
        x, y, z = d[0] * scale, d[1] * scale, d[2] * scale
        low_x, high_x = minimum(low_x, select(alive, x, np.inf)), maximum(high_x, select(alive, x, -np.inf))
        low_y, high_y = minimum(low_y, select(alive, y, np.inf)), maximum(high_y, select(alive, y, -np.inf))
        low_z, high_z = minimum(low_z, select(alive, z, np.inf)), maximum(high_z, select(alive, z, -np.inf))
    return (
        (lane_max(high_x) - lane_min(low_x))
        + (lane_max(high_y) - lane_min(low_y))
        + (lane_max(high_z) - lane_min(low_z))
    )


@inlined
def own_axes(on_x, on_y, a):
    """Components of vectors in cyclic order, with the dominant one of each lane last."""
    return (
        select(on_x, a[1], select(on_y, a[2], a[0])), select(on_x, a[2], select(on_y, a[0], a[1])),
        select(on_x, a[0], select(on_y, a[1], a[2])),
    )  # fmt: skip


@inlined
def either(mask, x, y, like):
    """The integer x where the mask holds, else y: lanes."""
    return select(mask, splat_int(np.int32(x), like), splat_int(np.int32(y), like))


@inlined
def enter_pool(tree: Tree, r: int, work: PoolWork) -> int:
    """Write what each ray of packet r needs on its own; return the bits of the rays that are traced."""
    like, width = packet(work.lanes), packet_width(work.lanes)
    o, d, scale, tmin, tmax = read_bundle_rays(work, r, like)
    ax, ay, az = absolute(d[0]), absolute(d[1]), absolute(d[2])
    on_x = (ax >= ay) & (ax >= az)
    on_y = ~on_x & (ay >= az)
    p, q = own_axes(on_x, on_y, o), own_axes(on_x, on_y, d)
    write_rows(work, r, FRAME, (p[0], p[1], p[2], q[0], q[1], q[2], -(q[0] / q[2]), -(q[1] / q[2]), scale))
    write_rows(work, r, SLABS, make_slabs(o, d, machine_epsilon(work.lanes)))
    room = np.int32(len(work.pool_t) // RAYS)
    bottom = (lane_numbers(like) + np.int32(width * r)) * room + np.int32(1)
    at = (r + 1) * ROWS * width
    for x in (
        either(d[0] < 0.0, 24, 0, like), either(d[1] < 0.0, 32, 8, like), either(d[2] < 0.0, 40, 16, like),
        select(on_x, np.int32(8), either(on_y, 16, 0, like)), select(on_x, np.int32(16), either(on_y, 0, 8, like)),
        select(on_x, np.int32(0), either(on_y, 8, 16, like)), splat_int(ROOT, like), bottom, bottom,
        lane_numbers(like) + np.int32(width * (r + 1)),
    ):  # fmt: skip
        store(work.pool_state, at, x)
        at += width
    return bits(tmin < tmax)


@inlined
def triangles_of_ray(tree: Tree, f: int, at: int, work: PoolWork) -> Triangle:
    """The eight triangles of a leaf, in the axes of ray f."""
    return eight_triangles(tree.leaves.rows, at, axes_of_ray(work, f))


@inlined
def enqueue(work: PoolWork, f: int, child: int, top: int, nodes: int, leaves: int):
    """Append ray f to the queue that its next child belongs to, or to none; return the lengths of both."""
    write_state(work, f, NEXT, child)
    write_state(work, f, TOP, top)
    poke(work.pool_queue, nodes, np.int32(f))
    poke(work.pool_queue, QUEUE + leaves, np.int32(f))
    return nodes + np.int64(child >= 0), leaves + np.int64((child < 0) & (child != NOTHING))


@inlined
def step_through_node(tree: Tree, f: int, nodes: int, leaves: int, work: PoolWork):
    """Take ray f through a node: on to the nearest child, or to what is on its stack; the other children go there."""
    at, top = read_state(work, f, NEXT) * NODE_SIZE, read_state(work, f, TOP)
    near, far = planes_of_node(tree.nodes.bounds, at, axes_of_ray(work, f))
    t, entered = slab_test(slabs_of_ray(work, f), near, far, read_number(work, f, TMIN), read_number(work, f, HIT_T))
    work.counts[0] += 1
    # an empty child slot can be entered where an operand is NaN, so the bits of the present children are needed
    entered = entered & mask_of(np.int64(peek(tree.nodes.child, at + PRESENT)), t)
    n, nearest = count(entered), least_lane(entered, t)
    others = entered & (lane_numbers(t) != np.int32(nearest))
    store_packed(work.pool_t, top, others, t)
    store_packed(work.pool_child, top, others, load(tree.nodes.child, at + CHILD, NODE))
    child = peek_either(n == 0, work.pool_child, top - 1, tree.nodes.child, at + CHILD + nearest)
    return enqueue(work, f, np.int64(child), top + n - 1, nodes, leaves)


@inlined
def cull(work: PoolWork, bottom: int, top: int, tmax) -> int:
    """Remove from a stack what lies beyond tmax; return its height. So nothing is tested when it is popped."""
    kept = bottom
    for i in range(bottom, top, NODE):
        t, child = load(work.pool_t, i, NODE), load(work.pool_child, i, NODE)
        keep = (t <= tmax) & (lane_numbers(t) < np.int32(top - i))
        store_packed(work.pool_t, kept, keep, t)
        store_packed(work.pool_child, kept, keep, child)
        kept += count(keep)
    return kept


@inlined
def closest_in_leaf(tree: Tree, f: int, top: int, work: PoolWork) -> int:
    """Find the nearest hit of ray f in a leaf; return the height of its stack without what lies beyond."""
    at, t = ~read_state(work, f, NEXT) * LEAF_SIZE, read_number(work, f, HIT_T)
    inside, t_new, u_new, v_new = intersect(tree.leaves, frame_of_ray(work, f), triangles_of_ray(tree, f, at, work))
    left = bits(inside & (t_new > read_number(work, f, TMIN)) & (t_new <= t))
    if left == 0:
        return top
    place = read_state(work, f, PLACE)
    prim, u, v = peek(work.prim_id, place), read_number(work, f, HIT_U), read_number(work, f, HIT_V)
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        number = np.int32(peek(tree.leaves.prim_id, at + PRIM_ID + k))
        if t_new[k] < t or (t_new[k] == t and number < prim):
            t, u, v, prim = t_new[k], u_new[k], v_new[k], number
    write_number(work, f, HIT_T, t)
    write_number(work, f, HIT_U, u)
    write_number(work, f, HIT_V, v)
    poke(work.prim_id, place, prim)
    return cull(work, read_state(work, f, BOTTOM), top, t)


@inlined
def any_in_leaf(tree: Tree, f: int, top: int, work: PoolWork) -> int:
    """Note whether ray f hits anything in a leaf; return the height of its stack, or -1 if it does."""
    at = ~read_state(work, f, NEXT) * LEAF_SIZE
    inside, t, _, _ = intersect(tree.leaves, frame_of_ray(work, f), triangles_of_ray(tree, f, at, work))
    if bits(inside & (t > read_number(work, f, TMIN)) & (t < read_number(work, f, HIT_T))) == 0:
        return top
    write_number(work, f, OCCLUDED, 1.0)
    return -1


@inlined
def step_through_leaf(tree: Tree, f: int, visit, nodes: int, leaves: int, work: PoolWork):
    """Take ray f through a leaf, and on to what is on its stack."""
    work.counts[1] += NODE
    top = visit(tree, f, read_state(work, f, TOP), work)
    if top < 0:
        return nodes, leaves
    return enqueue(work, f, np.int64(peek(work.pool_child, top - 1)), top - 1, nodes, leaves)


@inlined
def trace_pool(tree: Tree, packets: int, visit, work: PoolWork):
    """Trace the rays of a bundle; ``visit`` tests one against the triangles of a leaf."""
    nodes, leaves = 0, 0
    for r in range(packets):
        alive = enter_pool(tree, r, work)
        while alive != 0:
            place = (r + 1) * ROWS * packet_width(work.lanes) + first_bit(alive)
            poke(work.pool_queue, nodes, np.int32(place))
            alive &= alive - 1
            nodes += 1
    while nodes + leaves != 0:
        turns, nodes = nodes, 0
        for j in range(turns):
            f = np.int64(peek(work.pool_queue, j))
            nodes, leaves = step_through_node(tree, f, nodes, leaves, work)
        for j in range(leaves):
            leaf = ~read_state(work, np.int64(peek(work.pool_queue, QUEUE + j)), NEXT)
            for line in range(0, NORMAL, 16):
                prefetch(tree.leaves.rows, leaf * LEAF_SIZE + line)
        turns, leaves = leaves, 0
        for j in range(turns):
            f = np.int64(peek(work.pool_queue, QUEUE + j))
            nodes, leaves = step_through_leaf(tree, f, visit, nodes, leaves, work)


def trace_scattered(tree: Tree, packets: int, visit, work: Work | PoolWork) -> bool:
    """Trace the rays of a bundle in a pool if there is one, and it is faster; return whether they are traced."""
    return hasattr(work, "pool_t") and trace_if_scattered(tree, packets, visit, work)


@inlined
def trace_if_scattered(tree: Tree, packets: int, visit, work: PoolWork) -> bool:
    """Trace the rays of a bundle in a pool if that is faster; return whether they are traced."""
    if not suits_pool(tree) or not spread(packets, work) > SCATTERED:
        return False
    trace_pool(tree, packets, visit, work)
    return True


@specialised(trace_scattered)
def _trace_scattered(tree, packets, visit, work):
    if BITS == 512 and "pool_t" in work.instance_class._fields:
        return lambda tree, packets, visit, work: trace_if_scattered(tree, packets, visit, work)
    return lambda tree, packets, visit, work: False
