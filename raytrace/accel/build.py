"""From a mesh to a tree: normals and bounds of triangles, a binary tree, and its flattening."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace import parallel
from raytrace.accel.boxes import BOX, clear
from raytrace.accel.expansions import TERMS, VECTOR, add_minor, product_error, value_of, write_difference
from raytrace.accel.flatten import fill_leaves, flatten
from raytrace.accel.grow import MAX_DEPTH, SPLITS, Subtree, grow, make_binary, make_grow_scratch
from raytrace.accel.lanes import NODE
from raytrace.accel.layout import boxes_of, children_of, make_leaves, make_nodes
from raytrace.jit import inlined, interpreted, kernel, subroutine
from raytrace.records import MollerTrumboreLeaves, Tree, WatertightLeaves

SMALL_MESH = 64  # triangles: up to so many, the interpreter builds the tree, which is faster than compilation
SUBTREES, MIN_SUBTREE = 32, 4096  # threads build subtrees of at most 1 / SUBTREES of the triangles, or MIN_SUBTREE
EDGE_1, EDGE_2, MINOR, ROOM = 9, 9 + VECTOR, 9 + 2 * VECTOR, 9 + 2 * VECTOR + TERMS  # places in scratch memory
DIVIDED = 1024  # triangles of the smallest mesh of which large ones are divided among leaves
SPARE = 0.3  # most references of a divided tree beyond one per triangle, in triangles
STRETCH = 32768  # triangles that a thread measures at a time
LEAVES_AT_ONCE = 4096  # leaves that a thread fills at a time
LEAVES = {"watertight": WatertightLeaves, "moller-trumbore": MollerTrumboreLeaves}


class MeasuredMesh(NamedTuple):
    """A mesh of m triangles, with their normals and bounds."""

    vertices: NDArray[np.floating]  # (v, 3) f
    faces: NDArray[np.int32]  # (m, 3)
    triangles: NDArray[np.floating]  # (m, 12) f: v0, v1, v2, unit normal
    boxes: NDArray[np.floating]  # (8 (m + 1),) f
    order: NDArray[np.int32]  # (m,): numbers of the triangles that have a box


class Steps(NamedTuple):
    """The kernels of a build, compiled or interpreted."""

    measure: Callable[..., int]
    grow: Callable[..., int]
    flatten: Callable[..., tuple[int, int, int]]
    fill_leaves: Callable[..., None]


@inlined
def minor(a, b, c, d):
    """A d - b c to nearly full precision; zero only if it is exactly zero."""
    p, q = a * d, b * c
    return (p - q) + (product_error(a, d, p) - product_error(b, c, q))


@subroutine
def exact_minors(corner):
    """Minors of the edges of a triangle, of which the rounded edges have none: from the exact differences."""
    v0, v1 = (corner[0], corner[1], corner[2]), (corner[3], corner[4], corner[5])
    write_difference(corner, EDGE_1, v1, v0)
    write_difference(corner, EDGE_2, (corner[6], corner[7], corner[8]), v0)
    x = value_of(corner, MINOR, add_minor(corner, MINOR, 0, (EDGE_1, 1, 2), (EDGE_2, 1, 2), 1.0))
    y = value_of(corner, MINOR, add_minor(corner, MINOR, 0, (EDGE_1, 2, 0), (EDGE_2, 2, 0), 1.0))
    return x, y, value_of(corner, MINOR, add_minor(corner, MINOR, 0, (EDGE_1, 0, 1), (EDGE_2, 0, 1), 1.0))


@kernel
def measure(vertices, faces, triangles, boxes, order, corner):
    """Write the vertices and unit normal of each triangle; return the number of triangles that have an area.

    Their bounds and numbers are written to ``boxes`` and ``order``.
    """
    number = 0
    for k in range(len(faces)):
        clear(boxes, BOX * number)
        boxes[BOX * number + 3] = boxes[BOX * number + 7] = 0.0
        for j in range(3):
            for axis in range(3):
                x = vertices[faces[k, j], axis]
                at = BOX * number + axis
                triangles[k, 3 * j + axis] = x
                boxes[at] = x if x < boxes[at] else boxes[at]
                boxes[at + 4] = -x if -x < boxes[at + 4] else boxes[at + 4]
                corner[3 * j + axis] = x
        ax, ay, az = corner[3] - corner[0], corner[4] - corner[1], corner[5] - corner[2]
        bx, by, bz = corner[6] - corner[0], corner[7] - corner[1], corner[8] - corner[2]
        nx, ny, nz = minor(ay, az, by, bz), minor(az, ax, bz, bx), minor(ax, ay, bx, by)
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            nx, ny, nz = exact_minors(corner)
        largest = abs(nx) if abs(nx) > abs(ny) else abs(ny)
        largest = abs(nz) if abs(nz) > largest else largest
        if largest > 0.0:
            order[number] = k
            number += 1
            nx, ny, nz = nx / largest, ny / largest, nz / largest
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        triangles[k, 9], triangles[k, 10], triangles[k, 11] = nx / length, ny / length, nz / length
    return number


STEPS = measure, grow, flatten, fill_leaves


def build(vertices, faces, split, triangle, divide=True):
    """Build the tree of a mesh.

    Parameters
    ----------
    vertices : (v, 3) float array, world units, in the precision of the tree
    faces : (m, 3) int array
    split, triangle : str
        Keys of ``SPLITS`` and ``LEAVES``.
    divide : bool
        Whether large triangles may lie in several leaves, if that pays. Only with "sah" and "watertight".

    Returns
    -------
    tree : Tree
    triangles : (m, 12) float array
        v0, v1, v2 and the unit normal of each face; NaN normals where a face has no area, which no ray hits.
    levels : int
    divided : bool
        Whether triangles lie in several leaves.
    """
    m, dtype = len(faces), vertices.dtype
    steps = Steps(*(interpreted(kernel) if m <= SMALL_MESH else kernel for kernel in STEPS))
    divide = divide and split == "sah" and triangle == "watertight" and m >= DIVIDED
    places = m + int(SPARE * m) * divide  # those that stay free are never touched
    triangles, boxes, order = np.empty((m, 12), dtype), np.empty(BOX * (places + 1), dtype), np.empty(places, np.int32)
    mesh = MeasuredMesh(vertices, faces, triangles, boxes, order)
    with np.errstate(all="ignore"):
        n = _measure_all(mesh, steps.measure)
        divided = _divided(mesh, n) if divide else None
        binary, count = divided or _grow_all(make_binary(order[:n].copy(), boxes), SPLITS[split], steps.grow)
        nodes, sources, levels = _flatten_nodes(binary, count, steps.flatten)
        leaves = make_leaves(LEAVES[triangle], len(sources), dtype)

        def fill(begin):
            end = min(begin + LEAVES_AT_ONCE, len(sources))
            steps.fill_leaves(binary, sources, begin, end, leaves, triangles)

        _share(fill, len(sources), LEAVES_AT_ONCE)
    return Tree(nodes, leaves, extent_of(nodes)), triangles, levels, divided is not None


def _share(task, n, stretch):
    """Call a task with 0, stretch, 2 stretch, ... below n, on all threads if there are several."""
    if n > stretch:
        parallel.together(task, range(0, n, stretch), None)
    else:
        task(0)


def _flatten_nodes(binary, count, flatten):
    """Collapse a binary tree of so many nodes; return the nodes, the numbers of the binary leaves, and the levels."""
    dtype = binary.boxes.dtype
    nodes, sources = make_nodes(max(count // 2, 1), dtype), np.empty((count + 1) // 2, np.int32)
    stack = np.empty((NODE * (MAX_DEPTH + 64), 3), np.int64)
    number, _, levels = flatten(binary, nodes, sources, stack, np.empty(NODE, np.int64))
    fitting = make_nodes(number, dtype)
    fitting.bounds[:] = nodes.bounds[: len(fitting.bounds)]
    return fitting, sources, levels


def _measure_all(mesh, measure):
    """Measure triangles on all threads; return how many have an area. Their boxes come first then."""
    m, counts = len(mesh.faces), {}

    def stretch(begin):
        part = slice(begin, min(begin + STRETCH, m))
        boxes, order = mesh.boxes[BOX * part.start : BOX * part.stop], mesh.order[part]
        counts[begin] = measure(mesh.vertices, mesh.faces[part], mesh.triangles[part], boxes, order, np.empty(ROOM))
        order += begin

    _share(stretch, m, STRETCH)
    n = 0
    for begin in range(0, m, STRETCH):
        end = begin + counts[begin]
        if n < begin:  # triangles before these had no area
            mesh.boxes[BOX * n : BOX * (n + end - begin)] = mesh.boxes[BOX * begin : BOX * end].copy()
            mesh.order[n : n + end - begin] = mesh.order[begin:end].copy()
        n += end - begin
    return n


def extent_of(nodes):
    """Low and high corner of a tree, and the side of a usual leaf: a cube whose surface is the mean of all leaves'."""
    boxes, leaf = boxes_of(nodes), children_of(nodes) < 0
    low, high = boxes[0, :3].min(axis=1), boxes[0, 3:].max(axis=1)
    x, y, z = (boxes[:, 3:] - boxes[:, :3]).transpose(1, 0, 2)
    side = np.sqrt(np.mean(x * y + y * z + z * x, where=leaf) / 3) if leaf.any() else 0
    return np.array([*low, *high, side], boxes.dtype)


def _divided(mesh, n):
    """Grow a tree with large triangles in several leaves; return it and its number of nodes, or None if none pay."""
    if n < DIVIDED:
        return None
    from raytrace.accel.dividing import divided_tree  # small meshes do not need it

    return divided_tree(mesh, n, n + int(SPARE * n), max(n // SUBTREES, MIN_SUBTREE))


def _grow_all(binary, split, grow):
    """Grow the top of a tree, then its subtrees on all threads; return the tree and its number of nodes.

    The roots of subtrees and the places of their nodes depend on the triangles alone, and so does the tree.
    """
    n, dtype = len(binary.order), binary.boxes.dtype
    binary.count[0] = n
    small = max(n // SUBTREES, MIN_SUBTREE)
    used = grow(binary, split, NODE, Subtree(0, 0, 1, small), make_grow_scratch(dtype))
    pending = np.flatnonzero(binary.left[:used] < 0)
    free = used + 2 * np.cumsum(binary.count[pending]) - 2 * binary.count[pending]
    roots = zip(pending, free, strict=True)
    subtrees = [Subtree(int(node), int(~binary.left[node]), int(first), 0) for node, first in roots]
    subtrees.sort(key=lambda subtree: -binary.count[subtree.node])  # so threads end together
    counts = [used]

    def finish(subtree):
        counts.append(grow(binary, split, NODE, subtree, make_grow_scratch(dtype)) - subtree.free)

    if n > MIN_SUBTREE:
        parallel.together(finish, subtrees, None)
    else:
        for subtree in subtrees:
            finish(subtree)
    return binary, sum(counts)
