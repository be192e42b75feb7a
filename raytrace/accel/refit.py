"""Refit a tree to moved vertices: the same nodes and leaves, with new triangles and boxes, from the bottom up.

Only boxes and triangles change, so the answers of all queries are those of a new tree. Rays meet more boxes, the more
the mesh has changed. Everything is written to new arrays.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace import parallel
from raytrace.accel.boxes import BOX, clear, include, low
from raytrace.accel.build import extent_of, measure, minor
from raytrace.accel.flatten import fill_box
from raytrace.accel.lanes import (
    NODE,
    absolute,
    bits,
    compress,
    convert,
    gather,
    lane_max,
    lane_min,
    load,
    machine_epsilon,
    maximum,
    minimum,
    select,
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

STRETCH = 1024  # leaves that a thread refits at a time


class Built(NamedTuple):
    """What is kept of a tree as it was built, to refit it any number of times."""

    slots: NDArray[np.int32]  # (8l,): number of the triangle in each lane of a leaf; -1: none
    outside: NDArray[np.intp]  # numbers of the triangles that had no area, so that no leaf has them
    sah_cost: float


class MovedMesh(NamedTuple):
    """A mesh whose vertices have moved, and the triangles and the box of each leaf, which are to be written."""

    vertices: NDArray[np.floating]  # (3v,) f, world units
    faces: NDArray[np.int32]  # (3m,)
    triangles: NDArray[np.floating]  # (12m,) f: v0, v1, v2, unit normal
    boxes: NDArray[np.floating]  # (8l,) f, world units: see accel/boxes.py


class Part(NamedTuple):
    """The leaves that a call refits, and its scratch memory."""

    begin: int
    end: int
    lanes: NDArray[np.floating]  # (96,) f
    wide: NDArray[np.float64]  # (8,): zeros


def built(tree: Tree, count: int) -> Built:
    """Return what is to be kept of a new tree of a mesh with so many triangles."""
    slots = triangles_of(tree.leaves).astype(np.int32).ravel()
    inside = np.zeros(count, bool)
    inside[slots[slots >= 0]] = True
    return Built(slots, np.flatnonzero(~inside), sah_cost(tree.nodes))


def refit(
    tree: Tree, as_built: Built, vertices: NDArray[np.floating], faces: NDArray[np.int32]
) -> tuple[Tree, NDArray[np.floating]] | None:
    """Return the tree and the (m, 12) triangles of a moved mesh, or None where the tree has to be built anew.

    That is where a triangle has an area that had none when the tree was built: no leaf has it.
    """
    dtype, leaf_count = vertices.dtype, len(as_built.slots) // NODE
    node_count = len(tree.nodes.bounds) // NODE_SIZE
    nodes, leaves = make_nodes(node_count, dtype), make_leaves(type(tree.leaves), leaf_count, dtype)
    triangles, boxes = np.empty(12 * len(faces), dtype), np.empty(BOX * (leaf_count + node_count), dtype)
    if len(as_built.outside):
        if (rows := _flat_triangles(vertices, faces[as_built.outside])) is None:
            return None
        triangles.reshape(-1, 12)[as_built.outside] = rows
    mesh = MovedMesh(vertices.reshape(-1), faces.reshape(-1), triangles, boxes)

    def stretch(begin: int) -> None:
        part = Part(begin, min(begin + STRETCH, leaf_count), np.empty(12 * NODE, dtype), np.zeros(NODE))
        refit_leaves(mesh, as_built.slots, part, leaves)

    parts = range(0, leaf_count, STRETCH)
    if len(parts) > 1:
        parallel.together(stretch, parts, None)
    else:
        stretch(0)
    refit_nodes(tree.nodes, nodes, boxes, leaf_count)
    return Tree(nodes, leaves, extent_of(nodes)), triangles.reshape(-1, 12)


@inlined
def box_of_lanes(boxes, at: int, mask, corners):
    """Write the box of the triangles of a leaf for which the mask holds: empty where there is none."""
    boxes[at + 3] = boxes[at + 7] = 0.0
    for axis in range(3):
        a, b, c = corners[axis], corners[3 + axis], corners[6 + axis]
        boxes[at + axis] = lane_min(select(mask, minimum(minimum(a, b), c), np.inf))
        boxes[at + 4 + axis] = -lane_max(select(mask, maximum(maximum(a, b), c), -np.inf))


@inlined
def normals_of_lanes(corners, wide):
    """Normals of eight triangles, not yet of unit length, and their largest components; the arithmetic of ``measure``.

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
    return nx / scale, ny / scale, nz / scale, largest


@inlined
def corners_of_lanes(mesh: MovedMesh, first):
    """Coordinates of the vertices of triangles, of which ``first`` is the place in the faces: nine registers."""
    a = gather(mesh.faces, first) * np.int32(3)
    b = gather(mesh.faces, first + np.int32(1)) * np.int32(3)
    c = gather(mesh.faces, first + np.int32(2)) * np.int32(3)
    points = mesh.vertices
    return (
        gather(points, a), gather(points, a + np.int32(1)), gather(points, a + np.int32(2)),
        gather(points, b), gather(points, b + np.int32(1)), gather(points, b + np.int32(2)),
        gather(points, c), gather(points, c + np.int32(1)), gather(points, c + np.int32(2)),
    )  # fmt: skip


@inlined
def write_leaf(leaves: Leaves, leaf: int, mask, rows, slots):
    """Write the triangles for which the mask holds to a leaf; the lanes behind them are empty."""
    at, whole = leaf * LEAF_SIZE, bits(mask) == bits(load(slots, NODE * leaf, NODE) >= np.int32(0))
    place = at
    for row in rows:
        if whole:
            store(leaves.rows, place, select(mask, row, 0.0))
        else:
            store(leaves.rows, place, select(mask, 0.0 * row, 0.0))
            compress(leaves.rows, place, mask, row)
        place += NODE if place != at + PRIM_ID - NODE else 2 * NODE
    left, count = bits(mask), 0
    for k in range(NODE):
        leaves.prim_id[at + PRIM_ID + k] = -1
        if left >> k & 1:
            leaves.prim_id[at + PRIM_ID + count] = slots[NODE * leaf + k]
            count += 1


@inlined
def write_triangles(triangles, slots, first: int, rows, lanes):
    """Write the vertices and normals of the triangles in eight slots; ``lanes``: scratch memory."""
    place = 0
    for row in rows:
        store(lanes, place, row)
        place += NODE
    for k in range(NODE):
        at = 12 * np.int64(slots[first + k])
        if at >= 0:
            for row in range(12):
                triangles[at + row] = lanes[row * NODE + k]


@kernel
def refit_leaves(mesh: MovedMesh, slots, part: Part, leaves: Leaves):
    """Write the leaves of a range, their boxes, and the vertices and unit normals of their triangles.

    A triangle that has lost its area leaves an empty lane behind those of the others.
    """
    for leaf in range(part.begin, part.end):
        number = load(slots, NODE * leaf, NODE)
        held = number >= np.int32(0)
        corners = corners_of_lanes(mesh, select(held, number, np.int32(0)) * np.int32(3))
        nx, ny, nz, largest = normals_of_lanes(corners, load(part.wide, 0, NODE))
        length, like = sqrt(nx * nx + ny * ny + nz * nz), corners[0]
        rows = corners + (convert(nx / length, like), convert(ny / length, like), convert(nz / length, like))
        mask = held & (largest > 0.0)
        box_of_lanes(mesh.boxes, BOX * leaf, mask, corners)
        write_leaf(leaves, leaf, mask, rows, slots)
        write_triangles(mesh.triangles, slots, NODE * leaf, rows, part.lanes)


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


def _flat_triangles(vertices: NDArray[np.floating], faces: NDArray[np.int32]) -> NDArray[np.floating] | None:
    """Return the rows of triangles without area, or None if one of them has an area."""
    rows, boxes = np.empty((len(faces), 12), vertices.dtype), np.empty(BOX * (len(faces) + 1), vertices.dtype)
    with np.errstate(all="ignore"):
        count = measure(vertices, faces, rows, boxes, np.empty(len(faces), np.int32), np.empty(9))
    return None if count else rows
