"""Spatial splits [Stich2009]: triangles that cross a plane go to both sides, each with the part of its box there."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.boxes import BOX, empty_bin, half_area, high, low, merged, tally
from raytrace.accel.clip import BACK, BOTH, LEAST, Cut, References, corners_along, hull, section, side_of, with_corner
from raytrace.accel.grow import (
    HALF,
    MAX_DEPTH,
    SAH_BINS,
    Binary,
    GrowScratch,
    Plane,
    Subtree,
    best_plane,
    bound,
    fill_bins,
    make_grow_scratch,
    partition,
    sample_step,
    split_median,
    swap,
)
from raytrace.accel.lanes import NODE, bits, load, maximum, minimum, peek, splat, store, to_int
from raytrace.jit import inlined, kernel, subroutine

PARTS = 8  # bins of a spatial split along each axis


class SpatialScratch(NamedTuple):
    """Scratch memory of ``grow_spatial``, for one thread."""

    grow: GrowScratch
    planes: np.ndarray  # (3 * PARTS,) f, world units: where each bin ends
    sides: np.ndarray  # (2 * BOX,) f, world units: boxes on both sides of a plane


def make_spatial_scratch(dtype) -> SpatialScratch:
    """Allocate scratch memory for boxes of that type."""
    return SpatialScratch(make_grow_scratch(dtype), np.empty(3 * PARTS, dtype), np.empty(2 * BOX, dtype))


@subroutine
def bin_parts(refs: References, k: int, axis: int, first: int, last: int, scratch: SpatialScratch):
    """Grow the boxes of bins by the parts of a reference in them, from its first to its last bin along an axis."""
    bins = scratch.grow.bins
    triangles, box = refs.triangles, refs.tree.boxes
    corners = corners_along(triangles, 12 * np.int64(refs.tree.order[k]), axis)
    middle, end = peek(triangles, corners[1] + axis), high(box, BOX * k, axis)
    x = low(box, BOX * k, axis)
    before = section(triangles, corners, axis, x)
    for b in range(first, last + 1):
        start = x
        x = max(min(peek(scratch.planes, axis * PARTS + b), end), start) if b < last else end
        after = section(triangles, corners, axis, x)
        part = hull(before, after)
        if start <= middle and middle <= x:
            part = with_corner(part, triangles, corners[1])
        at = BOX * (axis * PARTS + b)
        least = maximum(part[0], load(box, BOX * k, HALF))
        most = maximum(part[1], load(box, BOX * k + HALF, HALF))
        if bits(least + most > 0.0) & 7 != 0:  # this part of the triangle lies beside the box
            least = most = splat(np.inf, least)
        tally(bins, at, least, 1.0 if b == first else 0.0)
        tally(bins, at + HALF, most, 1.0 if b == last else 0.0)
        before = after


@subroutine
def fill_parts(refs: References, begin: int, end: int, node: int, scratch: SpatialScratch):
    """Count references that begin and end in the bins of all three axes, and grow the boxes of the bins."""
    tree, bins = refs.tree, scratch.grow.bins
    empty = empty_bin(load(bins, 0, BOX))
    for k in range(3 * PARTS):
        store(bins, BOX * k, empty)
    for axis in range(3):
        extent = high(tree.bounds, BOX * node, axis) - low(tree.bounds, BOX * node, axis)
        scratch.sides[axis] = PARTS / extent if extent > 0.0 and PARTS / extent < np.inf else 0.0
        start, width = np.float64(low(tree.bounds, BOX * node, axis)), np.float64(extent / PARTS)
        for k in range(PARTS):
            scratch.planes[axis * PARTS + k] = start + (k + 1) * width
    scratch.sides[3] = 0.0
    least, scale = load(tree.bounds, BOX * node, HALF), load(scratch.sides, 0, HALF)
    for k in range(begin, end, sample_step(end - begin)):
        first = to_int(minimum((load(tree.boxes, BOX * k, HALF) - least) * scale, PARTS - 1.0))
        last = to_int(minimum((-load(tree.boxes, BOX * k + HALF, HALF) - least) * scale, PARTS - 1.0))
        for axis in range(3):
            if first[axis] == last[axis]:
                at = BOX * (axis * PARTS + first[axis])
                tally(bins, at, load(tree.boxes, BOX * k, HALF), 1.0)  # by halves, as ``bin_parts`` does: to load a
                tally(bins, at + HALF, load(tree.boxes, BOX * k + HALF, HALF), 1.0)  # whole would wait for both
            else:
                bin_parts(refs, k, axis, first[axis], last[axis], scratch)


@subroutine
def shared_by(plane: Plane, scratch: SpatialScratch):
    """Half the surface of what the boxes on both sides of a plane share, where it divides no reference."""
    sides, bins = scratch.sides, scratch.grow.bins
    front = empty_bin(load(bins, 0, BOX))
    back = front
    for k in range(SAH_BINS):
        part = load(bins, BOX * (plane.axis * SAH_BINS + k), BOX)
        if k <= plane.last_bin:
            front = merged(front, part)
        else:
            back = merged(back, part)
    store(sides, 0, maximum(front, back))
    apart = high(sides, 0, 0) < low(sides, 0, 0) or high(sides, 0, 1) < low(sides, 0, 1)
    return 0.0 if apart or high(sides, 0, 2) < low(sides, 0, 2) else half_area(sides, 0)


@subroutine
def divide_all(refs: References, node: int, cut: Cut, scratch: SpatialScratch):
    """Move what lies in front of a plane to the front; return where the rest begins, and where it ends."""
    tree, sides = refs.tree, scratch.sides
    i, back = tree.first[node], tree.first[node] + tree.count[node]
    free, limit = back, refs.limit[node]
    while i < back:
        side = side_of(refs, i, free, limit, cut, sides)
        if side == BOTH:
            tree.order[free] = tree.order[i]
            store(tree.boxes, BOX * free, load(sides, BOX, BOX))
            store(tree.boxes, BOX * i, load(sides, 0, BOX))
            free += 1
        if side == BACK:
            back -= 1
            swap(tree, i, back)
        else:
            i += 1
    return i, free


@inlined
def sum_of_areas(tree: Binary, begin: int, end: int) -> float:
    """Half the surfaces of the boxes of some references, added."""
    total = 0.0
    for k in range(begin, end):
        total += np.float64(half_area(tree.boxes, BOX * k))
    return total


@subroutine
def share_places(refs: References, begin: int, middle: int, end: int, limit: int):
    """Share the free places behind two halves in proportion to their areas; return where the second half begins now."""
    tree = refs.tree
    before, after = sum_of_areas(tree, begin, middle), sum_of_areas(tree, middle, end)
    gap = int((limit - end) * (before / (before + after))) if before + after > 0.0 else 0
    for k in range(min(gap, end - middle)):
        source, target = middle + k, max(middle + gap, end) + k
        tree.order[target] = tree.order[source]
        store(tree.boxes, BOX * target, load(tree.boxes, BOX * source, BOX))
    return middle + gap


@subroutine
def split(refs: References, node: int, depth: int, scratch: SpatialScratch):
    """Split the references of a node, and divide some of them if that is cheaper.

    Returns where the second half begins, and where it ends.
    """
    tree = refs.tree
    begin, end = tree.first[node], tree.first[node] + tree.count[node]
    middles = scratch.grow.middles
    if depth >= MAX_DEPTH:
        return split_median(tree, begin, end, middles), end
    fill_bins(tree, begin, end, scratch.grow)
    plane = best_plane(scratch.grow, SAH_BINS)
    if plane.axis < 0:
        return split_median(tree, begin, end, middles), end
    if end < refs.limit[node] and shared_by(plane, scratch) > peek(refs.margins, LEAST):
        fill_parts(refs, begin, end, node, scratch)
        best = best_plane(scratch.grow, PARTS)
        if best.axis >= 0 and best.cost < plane.cost:
            cut = Cut(best.axis, peek(scratch.planes, best.axis * PARTS + best.last_bin))
            middle, free = divide_all(refs, node, cut, scratch)
            if begin < middle and middle < free:
                return middle, free
            return split_median(tree, begin, end, middles), end
    return partition(tree, begin, end, plane, scratch.grow), end


@kernel
def grow_spatial(refs: References, subtree: Subtree, scratch: SpatialScratch):
    """Split a node down to leaves, or to nodes that are left to other calls; return the next free node."""
    tree, stack = refs.tree, scratch.grow.stack
    stack[0, 0], stack[0, 1] = subtree.node, subtree.depth
    free, top = subtree.free, 1
    while top > 0:
        top -= 1
        node, depth = stack[top, 0], stack[top, 1]
        begin, count, limit = tree.first[node], tree.count[node], refs.limit[node]
        if depth > subtree.depth and count <= subtree.small:
            tree.left[node] = ~depth
            continue
        bound(tree, begin, begin + count, node, scratch.grow.middles)
        if count <= NODE:
            tree.left[node] = 0
            continue
        middle, end = split(refs, node, depth, scratch)
        after = share_places(refs, begin, middle, end, limit) if end < limit else middle
        tree.left[node] = free
        tree.first[free], tree.count[free], refs.limit[free] = begin, middle - begin, after
        tree.first[free + 1], tree.count[free + 1], refs.limit[free + 1] = after, end - middle, limit
        stack[top, 0], stack[top, 1] = free + 1, depth + 1
        stack[top + 1, 0], stack[top + 1, 1] = free, depth + 1
        top += 2
        free += 2
    return free
