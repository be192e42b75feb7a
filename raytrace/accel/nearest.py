"""The closest point of a mesh to a point: branch and bound over the tree, eight boxes or triangles at a time.

Boxes and leaves give bounds on squared distances, in the precision of the tree. Triangles whose lower bound is not
above the lowest upper bound so far become candidates. Those that are left in the end are computed in pairs of float64.
docs/numerics.md derives the bounds.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.closest_exact import ANSWER, CORNERS, ROWS, closest_on_triangles
from raytrace.accel.lanes import (
    NODE,
    bits,
    compress,
    count,
    first_bit,
    fma,
    lane_min,
    lane_numbers,
    load,
    machine_epsilon,
    machine_largest,
    maximum,
    minimum,
    peek,
    poke,
    select,
)
from raytrace.accel.layout import CHILD, LEAF_SIZE, NODE_SIZE, NORMAL, PRESENT, PRIM_ID, V0, V1, V2
from raytrace.accel.single import fetch
from raytrace.accel.stack import NOTHING, ROOT, pop, push
from raytrace.jit import inlined, kernel, subroutine
from raytrace.point_records import ClosestPoint
from raytrace.records import Tree
from raytrace.work_records import Work

CANDIDATES = 128  # triangles that wait to be computed
ROUNDINGS = 16.0  # machine epsilons: error of a squared distance, relative to the squared distance of a corner
MARGIN = 16.0  # machine epsilons: more than the rounding of the distances to boxes, and of the final distances
UNDERFLOW = 16.0  # smallest normal numbers, divided by epsilon: error of a squared distance where products underflow
NONE = np.int32(2**31 - 1)  # number of no triangle


class PointWork(NamedTuple):
    """Scratch memory of one thread."""

    stack: Work
    lower: NDArray[np.floating]  # (CANDIDATES + 8,) f: lower bounds of the squared distances of candidates
    place: NDArray[np.int32]  # the candidates: 8 leaf + lane
    counts: NDArray[np.int64]  # (1,): number of candidates
    rows: NDArray[np.float64]  # (8 ROWS,): eight candidates and their closest points
    trial: NDArray[np.floating]  # (1,) f: a distance
    best: NDArray[np.floating]  # (6,) f: p x y z, distance, u, v of the closest triangle so far
    owner: NDArray[np.int32]  # (2,): its number, and its place


@inlined
def box_distances(bounds, at: int, p):
    """Squared distances of p to the eight boxes of a node, with a relative error of at most 8 roundings."""
    x = maximum(maximum(load(bounds, at, 8) - p[0], p[0] - load(bounds, at + 24, 8)), 0.0)
    y = maximum(maximum(load(bounds, at + 8, 8) - p[1], p[1] - load(bounds, at + 32, 8)), 0.0)
    z = maximum(maximum(load(bounds, at + 16, 8) - p[2], p[2] - load(bounds, at + 40, 8)), 0.0)
    return fma(x, x, fma(y, y, z * z))


@inlined
def enter_nearest(tree: Tree, node: int, p, limit, top: int, work: Work):
    """Nearest child of a node within the limit, or NOTHING; push the others, and return the new stack height too."""
    t = box_distances(tree.nodes.bounds, node * NODE_SIZE, p)
    left = bits(t <= limit) & np.int64(peek(tree.nodes.child, node * NODE_SIZE + PRESENT))
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
        if t_child < t_nearest:
            fetch(tree, child)
            nearest, child = child, nearest
            t_nearest, t_child = t_child, t_nearest
        top = push(work, base, top, t_child, child, 1)
    return nearest, top


@inlined
def corners(rows, at: int):
    """x, y, z of a vertex, or of the normal, of eight triangles."""
    return load(rows, at, 8), load(rows, at + NODE, 8), load(rows, at + 2 * NODE, 8)


@inlined
def minus(a, b):
    """Difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def inner(a, b):
    """Scalar product of two vectors."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


@inlined
def edge_distance(a, e):
    """Squared distance to an edge, its squared length, and the weight of its end; a: from its start to the point."""
    square = inner(e, e)
    t = minimum(maximum(inner(a, e) / square, 0.0), 1.0)
    x, y, z = fma(-t, e[0], a[0]), fma(-t, e[1], a[1]), fma(-t, e[2], a[2])
    return fma(x, x, fma(y, y, z * z)), square, t


@inlined
def left_of(e, a, n):
    """N . (e x a), which is positive where the foot of the perpendicular from p lies on the inner side of an edge."""
    x, y, z = fma(e[1], a[2], -(e[2] * a[1])), fma(e[2], a[0], -(e[0] * a[2])), fma(e[0], a[1], -(e[1] * a[0]))
    return inner(n, (x, y, z))


@inlined
def leaf_distances(rows, at: int, p):
    """Squared distances of p to the eight triangles of a leaf, and bounds on their errors.

    The distance to the plane counts where p lies on the inner side of all edges, and not beyond a corner.
    """
    v0, v1, v2, n = corners(rows, at + V0), corners(rows, at + V1), corners(rows, at + V2), corners(rows, at + NORMAL)
    a, b, c = minus(p, v0), minus(p, v1), minus(p, v2)
    e, f, g = minus(v1, v0), minus(v2, v1), minus(v0, v2)
    d0, l0, t0 = edge_distance(a, e)
    d1, l1, t1 = edge_distance(b, f)
    d2, l2, t2 = edge_distance(c, g)
    inside = (left_of(e, a, n) >= 0.0) & (left_of(f, b, n) >= 0.0) & (left_of(g, c, n) >= 0.0)
    inside = inside & ((t0 > 0.0) | (t2 < 1.0)) & ((t1 > 0.0) | (t0 < 1.0)) & ((t2 > 0.0) | (t1 < 1.0))
    height = inner(n, a)
    distance, longest = minimum(minimum(d0, d1), d2), maximum(maximum(l0, l1), l2)
    eps = machine_epsilon(rows)
    error = (distance + longest) * (2.0 * ROUNDINGS * eps) + UNDERFLOW / eps * (4.0 / machine_largest(rows))
    return select(inside, height * height, distance), error


@inlined
def visit_leaf(tree: Tree, leaf: int, p, limit, work: PointWork):
    """Make the triangles of a leaf candidates that may be the closest one; return the new limit."""
    at = leaf * LEAF_SIZE
    square, error = leaf_distances(tree.leaves.rows, at, p)
    exists = load(tree.leaves.prim_id, at + PRIM_ID, 8) >= np.int32(0)
    upper = lane_min(select(exists & (square < np.inf), square + error, np.inf))
    limit = lower_limit(limit, upper, machine_epsilon(tree.nodes.bounds))
    lower = square - error
    keep = exists & ~(lower > limit)  # NaN, where something overflows, is kept
    n = peek(work.counts, 0)
    compress(work.lower, n, keep, lower)
    compress(work.place, n, keep, lane_numbers(lower) + np.int32(leaf * NODE))
    work.counts[0] = n + count(keep)
    return limit


@inlined
def lower_limit(limit, square, eps):
    """The limit of squared distances, given an upper bound on that of one triangle."""
    square = square + square * (MARGIN * eps)
    return square if square < limit else limit


@inlined
def load_candidate(tree: Tree, place: int, rows, k: int):
    """Write the corners of a triangle to column k of the rows."""
    at = place // NODE * LEAF_SIZE + place % NODE
    for row in range(9):
        poke(rows, (CORNERS + row) * NODE + k, np.float64(peek(tree.leaves.rows, at + row * NODE)))


@inlined
def keep_closest(tree: Tree, place: int, work: PointWork, k: int):
    """Keep the point in column k if it is closer than the closest one so far, or as close and of a lower number."""
    work.trial[0] = work.rows[(ANSWER + 3) * NODE + k]  # rounds it to the precision of the tree
    number = np.int32(peek(tree.leaves.prim_id, place // NODE * LEAF_SIZE + PRIM_ID + place % NODE))
    if work.trial[0] < work.best[3] or (work.trial[0] == work.best[3] and number < work.owner[0]):
        for row in range(ROWS - ANSWER):
            work.best[row] = work.rows[(ANSWER + row) * NODE + k]
        work.owner[0], work.owner[1] = number, place


@subroutine
def compute_candidates(tree: Tree, p, limit, work: PointWork):
    """Compute the candidates within the limit, eight at a time; keep the closest one, and return the new limit."""
    i, n = 0, work.counts[0]
    while i < n:
        m = 0
        while i < n and m < NODE:
            if not peek(work.lower, i) > limit:
                load_candidate(tree, peek(work.place, i), work.rows, m)
                work.place[m] = work.place[i]
                m += 1
            i += 1
        if m > 0:
            closest_on_triangles(np.float64(p[0]), np.float64(p[1]), np.float64(p[2]), work.rows, m)
        for k in range(m):
            keep_closest(tree, work.place[k], work, k)
        eps = machine_epsilon(tree.nodes.bounds)
        square = work.best[3] * work.best[3] + UNDERFLOW / eps * (4.0 / machine_largest(tree.nodes.bounds))
        limit = lower_limit(limit, square, eps)
    work.counts[0] = 0
    return limit


@inlined
def leaf_limit(tree: Tree, leaf: int, p):
    """An upper bound on the squared distance of the closest triangle of a leaf."""
    at = leaf * LEAF_SIZE
    square, error = leaf_distances(tree.leaves.rows, at, p)
    exists = load(tree.leaves.prim_id, at + PRIM_ID, 8) >= np.int32(0)
    upper = lane_min(select(exists & (square < np.inf), square + error, np.inf))
    return lower_limit(upper, upper, machine_epsilon(tree.nodes.bounds))


@subroutine
def search(tree: Tree, p, limit, work: PointWork):
    """Find the closest triangle to one point; write it to ``work.best`` and ``work.owner``."""
    work.best[3], work.owner[0], work.owner[1] = np.inf, NONE, -1
    child, top = ROOT, 0
    while child != NOTHING:
        if child >= 0:
            child, top = enter_nearest(tree, child, p, limit, top, work.stack)
            if child == NOTHING:
                child, top = pop(work.stack, 0, top, limit)
            continue
        limit = visit_leaf(tree, ~child, p, limit, work)
        if peek(work.counts, 0) > CANDIDATES - NODE:
            limit = compute_candidates(tree, p, limit, work)
        child, top = pop(work.stack, 0, top, limit)
    compute_candidates(tree, p, limit, work)


@kernel
def closest_points(tree: Tree, points, numbers, out: ClosestPoint, n: int, work: PointWork):
    """Find the closest triangles to n points, in the order of ``numbers``; each search begins at the last triangle."""
    place = np.int32(-1)
    for k in range(n):
        i = peek(numbers, k)
        p = peek(points, 3 * i), peek(points, 3 * i + 1), peek(points, 3 * i + 2)
        zero = (p[0] - p[0]) + ((p[1] - p[1]) + (p[2] - p[2]))
        work.owner[0], work.best[3] = NONE, np.inf + zero
        if zero == 0.0:
            limit = leaf_limit(tree, place // NODE, p) if place >= 0 else lower_limit(np.inf, np.inf, 1.0)
            search(tree, p, limit, work)
        found = work.owner[0] != NONE
        for axis in range(3):
            out.p[3 * i + axis] = work.best[axis] if found else np.nan
        out.distance[i] = work.best[3]
        out.prim_id[i] = work.owner[0] if found else -1
        out.u[i], out.v[i] = work.best[4] if found else np.nan, work.best[5] if found else np.nan
        place = work.owner[1] if found else place
