"""Trees of boxes: a binary one by binned SAH or by medians, flattened to eight children a node, eight triangles a leaf."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import NODE, machine_epsilon
from raytrace.jit import inlined, kernel, subroutine
from raytrace.records import MollerTrumboreLeaves, Nodes, Tree, WatertightLeaves

SPLITS = {"sah": 0, "median": 1}
LEAVES = {"watertight": WatertightLeaves, "moller-trumbore": MollerTrumboreLeaves}
BINS = 16  # of the binned SAH [Wald 2007]
NODE_COST = 1.0  # of the SAH, in tests of one leaf's triangles
MAX_DEPTH = 64  # below, every split halves the count, so that no input makes a deep tree
WIDEN = 8.0  # machine epsilons of a leaf's largest coordinate: the rounding of the triangle test stays inside its box


class Binary(NamedTuple):
    """A binary tree; the right child of a node follows the left one."""

    bounds: np.ndarray  # (2n, 6) f, world units: low x y z, high x y z
    left: np.ndarray  # (2n,) i4: left child; 0 for a leaf
    first: np.ndarray  # (2n,) i4: first of its triangles in `order`
    count: np.ndarray  # (2n,) i4: how many they are
    order: np.ndarray  # (n,) i4: triangles
    boxes: np.ndarray  # (n, 6) f, world units: bounds of each triangle


@inlined
def clear(box):
    """Make a box empty: low inf, high -inf."""
    for k in range(3):
        box[k] = np.inf
        box[k + 3] = -np.inf


@inlined
def include(box, other):
    """Grow a box by another."""
    for k in range(3):
        box[k] = min(box[k], other[k])
        box[k + 3] = max(box[k + 3], other[k + 3])


@inlined
def half_area(box):
    """Half the surface of a box."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x


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
            middles[axis] = min(middles[axis], middle)
            middles[axis + 3] = max(middles[axis + 3], middle)


@inlined
def bin_of(box, axis, low, scale):
    """The bin that a triangle's centre falls into."""
    return min(int((centre(box, axis) - low) * scale), BINS - 1)


@subroutine
def best_plane(tree, begin, end, middles, bins, counts):
    """Axis, bin and cost of the cheapest of all planes between bins: sum of area times count [Wald 2007]; -1: none."""
    best_axis, best_bin, best_cost = -1, 0, np.inf
    grown = np.empty((2, 6), bins.dtype)
    right = np.empty(BINS)
    for axis in range(3):
        extent = middles[axis + 3] - middles[axis]
        if not extent > 0.0:
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
def partition(tree, begin, end, axis, low, scale, last):
    """Bring triangles of bins up to ``last`` to the front; where the others begin."""
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
def grow(tree, split, leaf_size):
    """Split nodes from the root (node 0: all of `order`) down; the number of nodes."""
    middles, bins, counts = (
        np.empty(6, tree.boxes.dtype),
        np.empty((BINS, 6), tree.boxes.dtype),
        np.empty(BINS, np.int64),
    )
    stack = np.empty((2 * MAX_DEPTH + 64, 2), np.int64)  # node, depth
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
            axis, last, _ = best_plane(tree, begin, end, middles, bins, counts)
        if axis >= 0:
            middle = partition(tree, begin, end, axis, middles[axis], BINS / (middles[axis + 3] - middles[axis]), last)
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


@inlined
def open_widest(tree, kids, number):
    """Replace the inner child of largest area by its two children; False where all are leaves."""
    widest, largest = -1, -1.0
    for k in range(number):
        if tree.left[kids[k]] > 0 and half_area(tree.bounds[kids[k]]) > largest:
            widest, largest = k, half_area(tree.bounds[kids[k]])
    if widest < 0:
        return False
    left = tree.left[kids[widest]]
    kids[widest], kids[number] = left, left + 1
    return True


@inlined
def fill_leaf(tree, node, leaves, leaf, triangles):
    """Copy the triangles of a binary leaf into the lanes of a leaf."""
    begin, count = tree.first[node], tree.count[node]
    for k in range(NODE):
        number = tree.order[begin + k] if k < count else -1
        leaves.prim_id[leaf * NODE + k] = number
        for row in range(12):
            leaves.rows[(leaf * 12 + row) * NODE + k] = triangles[number, row] if k < count else 0.0


@inlined
def fill_box(nodes, node, k, box, eps):
    """Write a child's bounds, widened by the rounding of what is tested inside."""
    largest = 0.0
    for axis in range(6):
        largest = max(largest, abs(box[axis]))
    for axis in range(3):
        nodes.bounds[(node * 6 + axis) * NODE + k] = box[axis] - largest * (WIDEN * eps)
        nodes.bounds[(node * 6 + axis + 3) * NODE + k] = box[axis + 3] + largest * (WIDEN * eps)


@kernel
def flatten(tree, nodes, leaves, triangles):
    """Collapse a binary tree into nodes of eight, opening the widest child first; numbers of nodes, leaves, levels."""
    eps = machine_epsilon(nodes.bounds)
    stack = np.empty((NODE * (2 * MAX_DEPTH + 64), 3), np.int64)  # binary node, node, level
    stack[0, :] = 0
    kids = np.empty(NODE, np.int64)
    number_of_nodes, number_of_leaves, levels, top = 1, 0, 1, 1
    while top > 0:
        top -= 1
        source, node, level = stack[top, 0], stack[top, 1], stack[top, 2]
        levels = max(levels, level + 1)
        kids[0], number = source, 1
        while number < NODE and open_widest(tree, kids, number):
            number += 1
        for k in range(NODE):
            nodes.child[node * NODE + k] = 0
            if k >= number:
                for row in range(6):
                    nodes.bounds[(node * 6 + row) * NODE + k] = np.inf if row < 3 else -np.inf
                continue
            fill_box(nodes, node, k, tree.bounds[kids[k]], eps)
            if tree.left[kids[k]] == 0:
                fill_leaf(tree, kids[k], leaves, number_of_leaves, triangles)
                nodes.child[node * NODE + k] = ~number_of_leaves
                number_of_leaves += 1
                continue
            nodes.child[node * NODE + k] = number_of_nodes
            stack[top, 0], stack[top, 1], stack[top, 2] = kids[k], number_of_nodes, level + 1
            number_of_nodes += 1
            top += 1
    return number_of_nodes, number_of_leaves, levels


@inlined
def product_error(a, b, p):
    """A b - p exactly, for p = a b rounded, by splitting both into halves [Dekker 1971]."""
    ca, cb = 134217729.0 * a, 134217729.0 * b
    a_high, b_high = ca - (ca - a), cb - (cb - b)
    a_low, b_low = a - a_high, b - b_high
    return ((a_high * b_high - p) + a_high * b_low + a_low * b_high) + a_low * b_low


@inlined
def minor(a, b, c, d):
    """A d - b c to nearly full precision, and zero only if it is."""
    p, q = a * d, b * c
    return (p - q) + (product_error(a, d, p) - product_error(b, c, q))


@kernel
def measure(vertices, faces, triangles, boxes, order):
    """Rows of vertices and unit normal, bounds, and the numbers of the triangles that have an area; how many have."""
    number = 0
    corner = np.empty(9, np.float64)
    for k in range(len(faces)):
        clear(boxes[k])
        for j in range(3):
            for axis in range(3):
                x = vertices[faces[k, j], axis]
                triangles[k, 3 * j + axis] = x
                boxes[k, axis] = min(boxes[k, axis], x)
                boxes[k, axis + 3] = max(boxes[k, axis + 3], x)
                corner[3 * j + axis] = x
        ax, ay, az = corner[3] - corner[0], corner[4] - corner[1], corner[5] - corner[2]
        bx, by, bz = corner[6] - corner[0], corner[7] - corner[1], corner[8] - corner[2]
        nx, ny, nz = minor(ay, az, by, bz), minor(az, ax, bz, bx), minor(ax, ay, bx, by)
        largest = max(abs(nx), abs(ny), abs(nz))
        if largest > 0.0:
            order[number] = k
            number += 1
            nx, ny, nz = nx / largest, ny / largest, nz / largest
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        triangles[k, 9], triangles[k, 10], triangles[k, 11] = nx / length, ny / length, nz / length
    return number


def build(vertices, faces, split, triangle):
    """Tree of a mesh.

    Parameters
    ----------
    vertices : (v, 3) float array, world units, in the precision of the tree
    faces : (m, 3) int array
    split, triangle : str
        Keys of ``SPLITS`` and ``LEAVES``.

    Returns
    -------
    tree : Tree
    triangles : (m, 12) float array
        v0, v1, v2 and the unit normal of each face; NaN normals where a face has no area, which no ray hits.
    levels : int
    """
    m, dtype = len(faces), vertices.dtype
    triangles, boxes, order = np.empty((m, 12), dtype), np.empty((m, 6), dtype), np.empty(m, np.int32)
    n = measure(vertices, faces, triangles, boxes, order)
    room = 2 * max(n, 1)
    binary = Binary(
        np.empty((room, 6), dtype), *(np.zeros(room, np.int32) for _ in range(3)), order[:n].copy(), boxes
    )  # fmt: skip
    used = grow(binary, SPLITS[split], NODE)
    inner = max((used - 1) // 2, 1)
    leaf_count = (used + 1) // 2
    nodes = Nodes(np.empty(inner * 6 * NODE, dtype), np.empty(inner * NODE, np.int32))
    leaves = LEAVES[triangle](np.empty(leaf_count * 12 * NODE, dtype), np.empty(leaf_count * NODE, np.int32))
    node_count, leaf_count, levels = flatten(binary, nodes, leaves, triangles)
    nodes = Nodes(nodes.bounds[: node_count * 6 * NODE].copy(), nodes.child[: node_count * NODE].copy())
    return Tree(nodes, leaves), triangles, levels
