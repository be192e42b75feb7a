"""The binary tree: triangles split from the top down, by binned SAH or by medians."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.boxes import clear, half_area, include
from raytrace.jit import inlined, kernel, subroutine

SPLITS = {"sah": 0, "median": 1}
BINS = 16  # of the binned SAH [Wald2007]
MAX_DEPTH = 64  # below, every split halves the count, so that no input makes a deep tree


class Binary(NamedTuple):
    """A binary tree; the right child of a node follows the left one."""

    bounds: np.ndarray  # (2n, 6) f, world units: low x y z, high x y z
    left: np.ndarray  # (2n,) i4: left child; 0 for a leaf
    first: np.ndarray  # (2n,) i4: first of its triangles in `order`
    count: np.ndarray  # (2n,) i4: how many they are
    order: np.ndarray  # (n,) i4: triangles
    boxes: np.ndarray  # (n, 6) f, world units: bounds of each triangle


def make_binary(order, boxes):
    """Room for the tree of some triangles."""
    room = 2 * max(len(order), 1)
    bounds = np.empty((room, 6), boxes.dtype)
    return Binary(bounds, *(np.zeros(room, np.int32) for _ in range(3)), order, boxes)


class Scratch(NamedTuple):
    """Memory for one thread of ``grow``."""

    middles: np.ndarray  # (6,) f, world units: bounds of doubled centres
    bins: np.ndarray  # (BINS, 6) f, world units: bounds of each bin's triangles
    counts: np.ndarray  # (BINS,) i8: triangles in each bin
    grown: np.ndarray  # (2, 6) f, world units: bounds of the bins from the right, and from the left
    right: np.ndarray  # (BINS,) f8: SAH cost of the bins from this one on
    stack: np.ndarray  # (s, 2) i8: node, depth


def make_scratch(dtype):
    """Scratch memory for boxes of that type."""
    floats = (np.empty(shape, dtype) for shape in (6, (BINS, 6), (2, 6)))
    middles, bins, grown = floats
    return Scratch(
        middles, bins, np.empty(BINS, np.int64), grown, np.empty(BINS), np.empty((MAX_DEPTH + 64, 2), np.int64)
    )


@inlined
def centre(box, axis):
    """Twice the middle of a box along an axis."""
    return box[axis] + box[axis + 3]


@subroutine
def bound(tree, begin, end, box, middles):
    """Bounds of triangles of `order`, and of their (doubled) centres."""
    clear(box)
    clear(middles)
    for k in range(begin, end):
        other = tree.boxes[tree.order[k]]
        include(box, other)
        for axis in range(3):
            middle = centre(other, axis)
            middles[axis] = middle if middle < middles[axis] else middles[axis]
            middles[axis + 3] = middle if middle > middles[axis + 3] else middles[axis + 3]


@inlined
def bin_of(box, axis, low, scale):
    """The bin that a triangle's centre falls into."""
    number = int((centre(box, axis) - low) * scale)
    return number if number < BINS else BINS - 1


@subroutine
def best_plane(tree, begin, end, scratch):
    """Axis, bin and cost of the cheapest of all planes between bins: sum of area times count [Wald 2007]; -1: none."""
    best_axis, best_bin, best_cost = -1, 0, np.inf
    middles, bins, counts, grown, right = scratch.middles, scratch.bins, scratch.counts, scratch.grown, scratch.right
    for axis in range(3):
        extent = middles[axis + 3] - middles[axis]
        if not (extent > 0.0 and BINS / extent < np.inf):
            continue
        scale = BINS / extent
        for k in range(BINS):
            clear(bins[k])
            counts[k] = 0
        for k in range(begin, end):
            other = tree.boxes[tree.order[k]]
            b = bin_of(other, axis, middles[axis], scale)
            include(bins[b], other)
            counts[b] += 1
        clear(grown[0])
        clear(grown[1])
        number = 0
        for k in range(BINS - 1, 0, -1):
            include(grown[0], bins[k])
            number += counts[k]
            right[k] = half_area(grown[0]) * number if number > 0 else np.inf
        number = 0
        for k in range(BINS - 1):
            include(grown[1], bins[k])
            number += counts[k]
            if number > 0:
                cost = half_area(grown[1]) * number + right[k + 1]
                if cost < best_cost:
                    best_axis, best_bin, best_cost = axis, k, cost
    return best_axis, best_bin, best_cost


@inlined
def partition(tree, begin, end, plane):
    """Bring triangles of bins up to ``last`` to the front; where the others begin."""
    axis, low, scale, last = plane
    i, j = begin, end - 1
    while i <= j:
        triangle = tree.order[i]
        if bin_of(tree.boxes[triangle], axis, low, scale) <= last:
            i += 1
        else:
            tree.order[i] = tree.order[j]
            tree.order[j] = triangle
            j -= 1
    return i


@subroutine
def split_median(tree, begin, end, middles):
    """Bring the lower half of the triangles to the front, by centre along the axis of widest spread [Hoare 1961]."""
    axis = 0
    for k in range(1, 3):
        if middles[k + 3] - middles[k] > middles[axis + 3] - middles[axis]:
            axis = k
    order, boxes = tree.order, tree.boxes
    middle, low, high = (begin + end) // 2, begin, end - 1
    while low < high:
        pivot = centre(boxes[order[(low + high) // 2]], axis)
        i, j = low, high
        while i <= j:
            while centre(boxes[order[i]], axis) < pivot:
                i += 1
            while centre(boxes[order[j]], axis) > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    return middle


@kernel
def grow(tree, split, leaf_size, scratch):
    """Split nodes from the root (node 0: all of `order`) down; the number of nodes."""
    middles, stack = scratch.middles, scratch.stack
    stack[0, 0] = stack[0, 1] = 0
    tree.first[0], tree.count[0] = 0, len(tree.order)
    nodes, top = 1, 1
    while top > 0:
        top -= 1
        node, depth = stack[top, 0], stack[top, 1]
        begin, end = tree.first[node], tree.first[node] + tree.count[node]
        bound(tree, begin, end, tree.bounds[node], middles)
        if end - begin <= leaf_size:
            tree.left[node] = 0
            continue
        axis = -1
        if split == 0 and depth < MAX_DEPTH:
            axis, last, _ = best_plane(tree, begin, end, scratch)
        if axis >= 0:
            scale = BINS / (middles[axis + 3] - middles[axis])
            middle = partition(tree, begin, end, (axis, middles[axis], scale, last))
        else:
            middle = split_median(tree, begin, end, middles)
        tree.left[node] = nodes
        tree.first[nodes], tree.count[nodes] = begin, middle - begin
        tree.first[nodes + 1], tree.count[nodes + 1] = middle, end - middle
        for child in range(nodes, nodes + 2):
            stack[top, 0], stack[top, 1] = child, depth + 1
            top += 1
        nodes += 2
    return nodes
