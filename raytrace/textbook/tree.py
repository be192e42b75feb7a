"""A bounding volume hierarchy: built by median splits, flattened into arrays, traversed with a stack."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.record_display import displayed
from raytrace.records import Hits
from raytrace.textbook.box import slab
from raytrace.textbook.triangle import moller_trumbore

F8 = NDArray[np.floating]
LEAF = 8  # largest number of triangles in a leaf


@displayed
class Tree(NamedTuple):
    """Nodes in depth-first order [Pharr2023, 7.3.4]: the left child of node i is i + 1."""

    low: F8  # (n, 3) world units: corners of the node's box
    high: F8  # (n, 3)
    right: NDArray[np.int64]  # (n,) index of the right child; 0 marks a leaf
    axis: NDArray[np.int64]  # (n,) axis along which the node is split
    first: NDArray[np.int64]  # (n,) the triangles below a node are prim_id[first : first + length]
    length: NDArray[np.int64]  # (n,) number of triangles below a node
    prim_id: NDArray[np.int64]  # (m,) triangles in the order of the leaves
    corners: F8  # (3, m, 3) world units: v0, v1 and v2 of the triangles, in the order of the leaves


def median_split(vertices: F8, faces: NDArray[np.integer]) -> Tree:
    """Build a tree by splitting triangles at the median of their centroids, along the axis where these spread most.

    Parameters
    ----------
    vertices : (v, 3) array
    faces : (m, 3) array of int, m >= 1

    Returns
    -------
    Tree

    Examples
    --------
    >>> import numpy as np
    >>> faces = np.arange(30).reshape(10, 3)
    >>> tree = median_split(np.arange(90.0).reshape(30, 3), faces)
    >>> len(tree.low), tree.length.tolist()
    (3, [10, 5, 5])
    """
    triangles = np.asarray(vertices, np.float64)[faces]
    low, high, centroid = triangles.min(axis=1), triangles.max(axis=1), triangles.mean(axis=1)
    order = np.arange(len(triangles))
    nodes: list[list[int]] = []  # right, axis, first, count
    stack = [(0, len(order), -1)]  # first, count, and the node whose right child this is (-1: not a right child)
    while stack:
        first, count, parent = stack.pop()
        if parent >= 0:
            nodes[parent][0] = len(nodes)
        rows = order[first : first + count]
        axis = int(np.argmax(np.ptp(centroid[rows], axis=0)))
        nodes.append([0, axis, first, count])
        if count <= LEAF:
            order[first : first + count] = np.sort(rows)
        else:
            half = count // 2
            order[first : first + count] = rows[np.argpartition(centroid[rows, axis], half)]
            stack.append((first + half, count - half, len(nodes) - 1))
            stack.append((first, half, -1))
    right, axis, first, count = np.array(nodes).T
    boxes = [(low[order[f : f + n]].min(axis=0), high[order[f : f + n]].max(axis=0)) for _, _, f, n in nodes]
    lows, highs = np.moveaxis(np.array(boxes), 1, 0)
    return Tree(lows, highs, right, axis, first, count, order, np.moveaxis(triangles[order], 1, 0))


def traverse(tree: Tree, o: F8, d: F8, tmax: float = np.inf) -> Hits:
    """Return the nearest hits of rays with 0 < t < tmax.

    One stack serves the whole batch. An entry is a node and the rays that have to visit it. The child that is nearer
    for most rays is visited first: hits in it exclude boxes that lie behind them.

    Parameters
    ----------
    tree : Tree
    o, d : (n, 3) arrays
        Origins and directions.
    tmax : float

    Returns
    -------
    Hits
        t = inf and prim_id = -1 where a ray misses. Equal t: the lowest prim_id.

    Examples
    --------
    >>> import numpy as np
    >>> tree = median_split(np.eye(3), np.array([[0, 1, 2]]))
    >>> traverse(tree, np.zeros((2, 3)), np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])).prim_id
    array([ 0, -1], dtype=int32)
    """
    n = len(o)
    hits = Hits(np.full(n, tmax), np.full(n, -1, np.int32), np.zeros(n), np.zeros(n))
    with np.errstate(divide="ignore"):
        inverse_d = 1.0 / d
    stack = [(0, np.arange(n))]
    while stack:
        node, rows = stack.pop()
        enter, leave = slab(o[rows], inverse_d[rows], tree.low[node], tree.high[node])
        rows = rows[(enter <= leave) & (leave >= 0) & (enter <= hits.t[rows])]
        if not len(rows):
            continue
        if not tree.right[node]:
            _visit_leaf(tree, node, o, d, rows, hits)
            continue
        near, far = node + 1, tree.right[node]
        if np.sign(d[rows, tree.axis[node]]).sum() < 0:
            near, far = far, near
        stack += [(far, rows), (near, rows)]
    hits.t[hits.prim_id < 0] = np.inf
    return hits


def _visit_leaf(tree: Tree, node: int, o: F8, d: F8, rows: NDArray[np.int64], hits: Hits) -> None:
    """Test rays against all triangles of a leaf, and store hits that are nearer than those found before."""
    leaf = slice(tree.first[node], tree.first[node] + tree.length[node])
    t, u, v = moller_trumbore(o[rows, None], d[rows, None], *tree.corners[:, leaf])  # (rays, triangles) each
    t = np.where(t > 0, t, np.inf)
    nearest = np.arange(len(rows)), t.argmin(axis=1)  # of equal t the first, which has the lowest prim_id
    t, prim_id = t[nearest], tree.prim_id[leaf][nearest[1]]
    better = (t < hits.t[rows]) | ((t == hits.t[rows]) & (prim_id < hits.prim_id[rows]))
    for field, value in zip(hits, (t, prim_id, u[nearest], v[nearest]), strict=True):
        field[rows[better]] = value[better]
