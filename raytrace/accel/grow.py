"""The binary tree: triangles split from the top down, by binned SAH or at medians; threads share the subtrees."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.boxes import BOX, area_of, centre, empty_bin, high, low, merged, tally
from raytrace.accel.lanes import load, minimum, splat, store, to_int
from raytrace.jit import inlined, kernel, subroutine

SPLITS = {"sah": 0, "median": 1}
SAH_BINS = 16  # of the binned SAH [Wald2007]
SAMPLES = 4096  # of n triangles, about sqrt(SAMPLES n) fill the bins if that is less: more give no better trees
HALF = BOX // 2
MAX_DEPTH = 64  # deeper nodes are split at medians, which halves their counts: so no input makes a deep tree


class Binary(NamedTuple):
    """A binary tree; the right child of a node follows the left one."""

    bounds: np.ndarray  # (8n,) f, world units: box of each node
    left: np.ndarray  # (n,) i4: left child; 0 for a leaf; ~depth for a node that is still to be split
    first: np.ndarray  # (n,) i4: place of its first triangle in `order`
    count: np.ndarray  # (n,) i4: number of its triangles
    order: np.ndarray  # (t,) i4: numbers of triangles
    boxes: np.ndarray  # (8t,) f, world units: their boxes, in the same order


class GrowScratch(NamedTuple):
    """Scratch memory of ``grow``, for one thread."""

    middles: np.ndarray  # (8,) f, world units: box of doubled centres
    scale: np.ndarray  # (4,) f: bins per world unit along each axis
    bins: np.ndarray  # (3 * SAH_BINS * 8,) f, world units: each bin's triangles, see ``boxes``
    right: np.ndarray  # (SAH_BINS,) f8: SAH cost of the bins from this one on
    stack: np.ndarray  # (s, 2) i8: node, depth


class Subtree(NamedTuple):
    """The subtree that a call of ``grow`` builds."""

    node: int  # its root
    depth: int
    free: int  # the first free node
    small: int  # nodes of at most so many triangles are left to other calls


class Plane(NamedTuple):
    """A plane between bins."""

    axis: int  # -1: there is no such plane
    last_bin: int  # the last bin in front of it
    cost: float  # sum over both sides of half the surface of the box, times the number of triangles


def make_binary(order, boxes) -> Binary:
    """Allocate the tree of some triangles, for any number of subtrees."""
    size = 4 * max(len(order), 1)
    return Binary(np.empty(BOX * size, boxes.dtype), *(np.zeros(size, np.int32) for _ in range(3)), order, boxes)


def make_grow_scratch(dtype):
    """GrowScratch memory for boxes of that type."""
    middles, scale, bins = (np.zeros(n, dtype) for n in (BOX, HALF, 3 * SAH_BINS * BOX))
    return GrowScratch(middles, scale, bins, np.empty(SAH_BINS), np.empty((MAX_DEPTH + 64, 2), np.int64))


@subroutine
def bound(tree: Binary, begin: int, end: int, node: int, middles):
    """Compute the box of the triangles of a node, and the box of their (doubled) centres."""
    box = splat(np.inf, load(tree.boxes, 0, BOX))
    low_middle = splat(np.inf, load(tree.boxes, 0, HALF))
    high_middle = low_middle
    for k in range(begin, end):
        middle = load(tree.boxes, BOX * k, HALF) - load(tree.boxes, BOX * k + HALF, HALF)
        box = minimum(box, load(tree.boxes, BOX * k, BOX))
        low_middle = minimum(low_middle, middle)
        high_middle = minimum(high_middle, -middle)
    store(tree.bounds, BOX * node, box)
    store(middles, 0, low_middle)
    store(middles, HALF, high_middle)


@inlined
def sah_bin(tree: Binary, k: int, axis: int, scratch: GrowScratch) -> int:
    """Bin along an axis that contains the centre of a triangle."""
    number = int((centre(tree.boxes, BOX * k, axis) - low(scratch.middles, 0, axis)) * scratch.scale[axis])
    return number if number < SAH_BINS else SAH_BINS - 1


@inlined
def sample_step(count: int) -> int:
    """Step between the triangles of a sample: odd, because triangles often come in pairs."""
    return int(np.sqrt(count / SAMPLES)) | 1


@subroutine
def fill_bins(tree: Binary, begin: int, end: int, scratch: GrowScratch):
    """Count triangles in the bins of all three axes, and grow the boxes of the bins; an axis without extent has one.

    Of many triangles, a sample is taken, in equal steps: it decides the plane, but not the boxes of the tree.
    """
    for axis in range(3):
        extent = high(scratch.middles, 0, axis) - low(scratch.middles, 0, axis)
        scratch.scale[axis] = SAH_BINS / extent if extent > 0.0 and SAH_BINS / extent < np.inf else 0.0
    empty = empty_bin(load(scratch.bins, 0, BOX))
    for k in range(3 * SAH_BINS):
        store(scratch.bins, BOX * k, empty)
    least, scale = load(scratch.middles, 0, HALF), load(scratch.scale, 0, HALF)
    for k in range(begin, end, sample_step(end - begin)):
        middle = load(tree.boxes, BOX * k, HALF) - load(tree.boxes, BOX * k + HALF, HALF)
        numbers = to_int(minimum((middle - least) * scale, SAH_BINS - 1.0))
        for axis in range(3):
            tally(scratch.bins, BOX * (axis * SAH_BINS + numbers[axis]), load(tree.boxes, BOX * k, BOX), 1.0)


@subroutine
def best_plane(scratch: GrowScratch, parts: int) -> Plane:
    """Cheapest of all planes between bins: that with the smallest sum of area times count [Wald2007].

    There are ``parts`` bins along each axis.
    """
    best_axis, best_bin, best_cost = -1, 0, np.inf
    bins, right = scratch.bins, scratch.right
    empty = empty_bin(load(bins, 0, BOX))
    for axis in range(3):
        first = axis * parts
        grown = empty
        for k in range(parts - 1, 0, -1):
            grown = merged(grown, load(bins, BOX * (first + k), BOX))
            right[k] = area_of(grown) * np.float64(grown[7]) if grown[7] > 0.0 else np.inf
        grown = empty
        for k in range(parts - 1):
            grown = merged(grown, load(bins, BOX * (first + k), BOX))
            if grown[3] > 0.0:
                cost = area_of(grown) * np.float64(grown[3]) + right[k + 1]
                if cost < best_cost:
                    best_axis, best_bin, best_cost = axis, k, cost
    return Plane(best_axis, best_bin, best_cost)


@inlined
def swap(tree: Binary, i: int, j: int):
    """Exchange two triangles and their boxes."""
    tree.order[i], tree.order[j] = tree.order[j], tree.order[i]
    box = load(tree.boxes, BOX * i, BOX)
    store(tree.boxes, BOX * i, load(tree.boxes, BOX * j, BOX))
    store(tree.boxes, BOX * j, box)


@inlined
def partition(tree: Binary, begin: int, end: int, plane: Plane, scratch: GrowScratch) -> int:
    """Move the triangles in front of a plane to the front; return where the others begin."""
    i, j = begin, end - 1
    while i <= j:
        if sah_bin(tree, i, plane.axis, scratch) <= plane.last_bin:
            i += 1
        else:
            swap(tree, i, j)
            j -= 1
    return i


@subroutine
def split_median(tree: Binary, begin: int, end: int, middles) -> int:
    """Move the lower half of the triangles to the front, by centre along the axis of widest spread [Hoare1961]."""
    axis, widest = 0, -1.0
    for k in range(3):
        if high(middles, 0, k) - low(middles, 0, k) > widest:
            axis, widest = k, high(middles, 0, k) - low(middles, 0, k)
    middle, lowest, highest = (begin + end) // 2, begin, end - 1
    while lowest < highest:
        pivot = centre(tree.boxes, BOX * ((lowest + highest) // 2), axis)
        i, j = lowest, highest
        while i <= j:
            while centre(tree.boxes, BOX * i, axis) < pivot:
                i += 1
            while centre(tree.boxes, BOX * j, axis) > pivot:
                j -= 1
            if i <= j:
                swap(tree, i, j)
                i += 1
                j -= 1
        if middle <= j:
            highest = j
        elif middle >= i:
            lowest = i
        else:
            break
    return middle


@kernel
def grow(tree: Binary, split: int, leaf_size: int, subtree: Subtree, scratch: GrowScratch):
    """Split a node down to leaves, or to nodes that are left to other calls; return the next free node."""
    stack = scratch.stack
    stack[0, 0], stack[0, 1] = subtree.node, subtree.depth
    free, top = subtree.free, 1
    while top > 0:
        top -= 1
        node, depth = stack[top, 0], stack[top, 1]
        begin, end = tree.first[node], tree.first[node] + tree.count[node]
        if depth > subtree.depth and end - begin <= subtree.small:
            tree.left[node] = ~depth
            continue
        bound(tree, begin, end, node, scratch.middles)
        if end - begin <= leaf_size:
            tree.left[node] = 0
            continue
        plane = Plane(-1, 0, np.inf)
        if split == 0 and depth < MAX_DEPTH:
            fill_bins(tree, begin, end, scratch)
            plane = best_plane(scratch, SAH_BINS)
        if plane.axis >= 0:
            middle = partition(tree, begin, end, plane, scratch)
        else:
            middle = split_median(tree, begin, end, scratch.middles)
        tree.left[node] = free
        tree.first[free], tree.count[free] = begin, middle - begin
        tree.first[free + 1], tree.count[free + 1] = middle, end - middle
        stack[top, 0], stack[top, 1] = free + 1, depth + 1
        stack[top + 1, 0], stack[top + 1, 1] = free, depth + 1
        top += 2
        free += 2
    return free
