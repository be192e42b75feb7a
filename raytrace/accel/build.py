"""From a mesh to a tree: normals and bounds of triangles, a binary tree, and its flattening."""

import numpy as np

from raytrace.accel.boxes import clear
from raytrace.accel.flatten import flatten
from raytrace.accel.grow import MAX_DEPTH, SPLITS, grow, make_binary, make_scratch
from raytrace.accel.lanes import NODE
from raytrace.jit import inlined, interpreted, kernel
from raytrace.records import MollerTrumboreLeaves, Nodes, Tree, WatertightLeaves

FEW = 64  # triangles: up to so many the interpreter builds their tree, in less time than the first run would compile
LEAVES = {"watertight": WatertightLeaves, "moller-trumbore": MollerTrumboreLeaves}


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
def measure(vertices, faces, triangles, boxes, order, corner):
    """Rows of vertices and unit normal, bounds, and the numbers of the triangles that have an area; how many have."""
    number = 0
    for k in range(len(faces)):
        clear(boxes[k])
        for j in range(3):
            for axis in range(3):
                x = vertices[faces[k, j], axis]
                triangles[k, 3 * j + axis] = x
                boxes[k, axis] = x if x < boxes[k, axis] else boxes[k, axis]
                boxes[k, axis + 3] = x if x > boxes[k, axis + 3] else boxes[k, axis + 3]
                corner[3 * j + axis] = x
        ax, ay, az = corner[3] - corner[0], corner[4] - corner[1], corner[5] - corner[2]
        bx, by, bz = corner[6] - corner[0], corner[7] - corner[1], corner[8] - corner[2]
        nx, ny, nz = minor(ay, az, by, bz), minor(az, ax, bz, bx), minor(ax, ay, bx, by)
        largest = abs(nx) if abs(nx) > abs(ny) else abs(ny)
        largest = abs(nz) if abs(nz) > largest else largest
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
    measure_, grow_, flatten_ = (interpreted(kernel) if m <= FEW else kernel for kernel in (measure, grow, flatten))
    triangles, boxes, order = np.empty((m, 12), dtype), np.empty((m, 6), dtype), np.empty(m, np.int32)
    with np.errstate(all="ignore"):
        n = measure_(vertices, faces, triangles, boxes, order, np.empty(9))
        binary = make_binary(order[:n].copy(), boxes)
        used = grow_(binary, SPLITS[split], NODE, make_scratch(dtype))
        inner, leaf_count = max((used - 1) // 2, 1), (used + 1) // 2
        nodes = Nodes(np.empty(inner * 6 * NODE, dtype), np.empty(inner * NODE, np.int32))
        leaves = LEAVES[triangle](np.empty(leaf_count * 12 * NODE, dtype), np.empty(leaf_count * NODE, np.int32))
        stack = np.empty((NODE * (MAX_DEPTH + 64), 3), np.int64)
        node_count, _, levels = flatten_(binary, nodes, leaves, triangles, stack, np.empty(NODE, np.int64))
    nodes = Nodes(nodes.bounds[: node_count * 6 * NODE].copy(), nodes.child[: node_count * NODE].copy())
    return Tree(nodes, leaves), triangles, levels
