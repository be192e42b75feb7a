"""Refit a tree to moved vertices: the same nodes and leaves, with new triangles and boxes, from the bottom up.

Only boxes and triangles change, so the answers of all queries are those of a new tree. Rays meet more boxes, the more
the mesh has changed. Everything is written to new arrays.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace import parallel
from raytrace.accel.boxes import BOX, clear, include, low
from raytrace.accel.build import MeasuredMesh, _measure_all, build, extent_of, measure, minor
from raytrace.accel.flatten import fill_box
from raytrace.accel.grow import HALF
from raytrace.accel.lanes import (
    NODE,
    absolute,
    convert,
    count,
    gather,
    load,
    load_rows,
    machine_epsilon,
    maximum,
    minimum,
    peek,
    poke,
    prefetch,
    select,
    splat,
    sqrt,
    store,
)
from raytrace.accel.layout import (
    CHILD,
    LEAF_SIZE,
    NODE_SIZE,
    PRESENT,
    PRIM_ID,
    Leaves,
    make_leaves,
    make_nodes,
    triangles_of,
)
from raytrace.accel.validate import sah_cost
from raytrace.jit import inlined, kernel
from raytrace.records import Nodes, Tree

FACES, LEAVES = 32768, 8192  # triangles that a thread measures at a time, and leaves that it fills
AHEAD = 4  # leaves whose triangles are brought into the cache in advance


class Built(NamedTuple):
    """What is kept of a tree as it was built, to refit it any number of times."""

    slots: NDArray[np.int32]  # (8l,): number of the triangle in each lane of a leaf; -1: none
    outside: NDArray[np.intp]  # numbers of the triangles that had no area, so that no leaf has them
    sah_cost: float


class MovedMesh(NamedTuple):
    """A mesh whose vertices have moved."""

    vertices: NDArray[np.floating]  # (3v,) f, world units
    faces: NDArray[np.int32]  # (3m,)
    triangles: NDArray[np.floating]  # (12m,) f: v0, v1, v2, unit normal; to be written
    lanes: NDArray[np.floating]  # (96,) f: scratch memory
    wide: NDArray[np.float64]  # (8,): zeros


def built(tree: Tree, number: int) -> Built:
    """Return what is to be kept of a new tree of a mesh with so many triangles."""
    slots = triangles_of(tree.leaves).astype(np.int32).ravel()
    inside = np.zeros(number, bool)
    inside[slots[slots >= 0]] = True
    return Built(slots, np.flatnonzero(~inside), sah_cost(tree.nodes))


def built_whole(
    tree: Tree, vertices: NDArray[np.floating], faces: NDArray[np.int32]
) -> tuple[Tree, NDArray[np.floating], int, Built]:
    """Return a new tree in place of one with divided triangles: each lies in one leaf, so it can be refitted later.

    Returns its triangles, levels and what to keep of it, too. Its growth counts from the tree that it replaces.
    """
    whole, triangles, levels, _ = build(vertices, faces, "sah", "watertight", divide=False)
    return whole, triangles, levels, built(whole, len(faces))._replace(sah_cost=sah_cost(tree.nodes))


def refit(
    tree: Tree, as_built: Built, vertices: NDArray[np.floating], faces: NDArray[np.int32]
) -> tuple[Tree, NDArray[np.floating]] | None:
    """Return the tree and the (m, 12) triangles of a moved mesh, or None where the tree has to be built anew.

    That is where a triangle has an area that had none when the tree was built: no leaf has it.
    """
    dtype, leaf_count = vertices.dtype, len(as_built.slots) // NODE
    node_count = len(tree.nodes.bounds) // NODE_SIZE
    nodes, leaves = make_nodes(node_count, dtype), make_leaves(type(tree.leaves), leaf_count, dtype)
    triangles, boxes = np.empty((len(faces), 12), dtype), np.empty(BOX * (leaf_count + node_count), dtype)

    flat: list[int] = []

    def measure_part(begin: int, end: int) -> None:
        lanes = np.empty(12 * NODE, dtype), np.zeros(NODE)
        mesh = MovedMesh(vertices.reshape(-1), faces.reshape(-1), triangles.reshape(-1), *lanes)
        flat.append(measure_moved(mesh, begin, end))

    def fill(begin: int, end: int) -> None:
        fill_leaves(triangles.reshape(-1), as_built.slots, leaves, boxes, begin, end)

    _share(measure_part, len(faces), FACES)
    if sum(flat):
        _measure_flat(vertices, faces, triangles)
    if np.isfinite(triangles[as_built.outside, 9]).any():
        return None
    _share(fill, leaf_count, LEAVES)
    refit_nodes(tree.nodes, nodes, boxes, leaf_count)
    return Tree(nodes, leaves, extent_of(nodes)), triangles


def _measure_flat(vertices: NDArray[np.floating], faces: NDArray[np.int32], triangles: NDArray[np.floating]) -> None:
    """Measure those triangles again that seem to have no area, by the kernel that decides it when a tree is built."""
    flat = np.flatnonzero(~np.isfinite(triangles[:, 9]))
    number, dtype = len(flat), vertices.dtype
    rows, boxes = np.empty((number, 12), dtype), np.empty(BOX * (number + 1), dtype)
    with np.errstate(all="ignore"):
        _measure_all(MeasuredMesh(vertices, faces[flat], rows, boxes, np.empty(number, np.int32)), measure)
    triangles[flat] = rows


def _share(task: Callable[[int, int], None], n: int, stretch: int) -> None:
    """Call ``task`` with ranges that cover 0 to n, on all threads if there are several."""
    if n <= stretch:
        task(0, n)
    else:
        parallel.together(lambda begin: task(begin, min(begin + stretch, n)), range(0, n, stretch), None)


@inlined
def normals_of_lanes(corners, wide):
    """Normals of eight triangles, not yet of unit length, by the arithmetic of ``measure``.

    Numbers are float64, as those of ``wide``.
    """
    v0 = convert(corners[0], wide), convert(corners[1], wide), convert(corners[2], wide)
    v1 = convert(corners[3], wide), convert(corners[4], wide), convert(corners[5], wide)
    v2 = convert(corners[6], wide), convert(corners[7], wide), convert(corners[8], wide)
    ax, ay, az = v1[0] - v0[0], v1[1] - v0[1], v1[2] - v0[2]
    bx, by, bz = v2[0] - v0[0], v2[1] - v0[1], v2[2] - v0[2]
    nx, ny, nz = minor(ay, az, by, bz), minor(az, ax, bz, bx), minor(ax, ay, bx, by)
    largest = maximum(absolute(nz), maximum(absolute(nx), absolute(ny)))
    scale = select(largest > 0.0, largest, 1.0)
    return nx / scale, ny / scale, nz / scale


@kernel
def measure_moved(mesh: MovedMesh, begin: int, end: int):
    """Write the vertices and unit normals of triangles, eight at a time; return how many seem to have no area."""
    points, last, flat = mesh.vertices, len(mesh.faces) // 3 - NODE, 0
    for i in range(begin, end, NODE):
        first = min(i, last)
        like = load(points, 0, NODE)
        a, b, c = load_rows(mesh.faces, 3 * first, like)
        a, b, c = a * np.int32(3), b * np.int32(3), c * np.int32(3)
        corners = (
            gather(points, a), gather(points, a + np.int32(1)), gather(points, a + np.int32(2)),
            gather(points, b), gather(points, b + np.int32(1)), gather(points, b + np.int32(2)),
            gather(points, c), gather(points, c + np.int32(1)), gather(points, c + np.int32(2)),
        )  # fmt: skip
        nx, ny, nz = normals_of_lanes(corners, load(mesh.wide, 0, NODE))
        length = sqrt(nx * nx + ny * ny + nz * nz)
        place = 0
        for x in corners:
            store(mesh.lanes, place, x)
            place += NODE
        for n in (nx, ny, nz):
            store(mesh.lanes, place, convert(n / length, like))
            place += NODE
        for k in range(NODE):
            for row in range(12):
                poke(mesh.triangles, 12 * (first + k) + row, peek(mesh.lanes, NODE * row + k))
        flat += count(~(length > 0.0))
    return flat


@kernel
def fill_leaves(triangles, slots, leaves: Leaves, boxes, begin: int, end: int):
    """Write leaves ``begin`` to ``end``, and their boxes.

    A triangle that has lost its area is left out; the lanes behind the others are empty.
    """
    empty = splat(np.inf, load(boxes, 0, HALF))
    for leaf in range(begin, end):
        at, kept, least, most = leaf * LEAF_SIZE, 0, empty, empty
        for k in range(NODE):
            number = np.int64(peek(slots, NODE * leaf + k))
            coming = 12 * np.int64(peek(slots, min(NODE * (leaf + AHEAD) + k, len(slots) - 1)))
            prefetch(triangles, max(coming, 0))
            prefetch(triangles, max(coming, 0) + 11)
            first = 12 * number
            if number < 0 or peek(triangles, first + 9) != peek(triangles, first + 9):
                continue
            for corner in range(3):
                point = load(triangles, first + 3 * corner, HALF)
                least, most = minimum(point, least), minimum(-point, most)
            for row in range(12):
                poke(leaves.rows, at + kept + NODE * (row if row < 9 else row + 1), peek(triangles, first + row))
            leaves.prim_id[at + PRIM_ID + kept] = number
            kept += 1
        for k in range(kept, NODE):
            leaves.prim_id[at + PRIM_ID + k] = -1  # the rest of new leaves is zero
        store(boxes, BOX * leaf, least)
        store(boxes, BOX * leaf + HALF, most)
        boxes[BOX * leaf + 3] = boxes[BOX * leaf + 7] = 0.0


@kernel
def refit_nodes(old: Nodes, nodes: Nodes, boxes, leaf_count: int):
    """Write the boxes of all nodes, children first: their numbers are larger. ``boxes`` has those of leaves first."""
    eps = machine_epsilon(nodes.bounds)
    for node in range(len(old.child) // NODE_SIZE - 1, -1, -1):
        first, own = node * NODE_SIZE, BOX * (leaf_count + node)
        clear(boxes, own)
        nodes.child[first + PRESENT] = old.child[first + PRESENT]
        for k in range(NODE):
            child = old.child[first + CHILD + k]
            nodes.child[first + CHILD + k] = child
            box = BOX * (~child if child < 0 else leaf_count + child)
            if child != 0 and low(boxes, box, 0) < np.inf:
                fill_box(nodes, first + k, boxes, box, eps)
                include(boxes, own, boxes, box)
                continue
            for row in range(6):
                nodes.bounds[first + row * NODE + k] = np.inf if row < 3 else -np.inf
