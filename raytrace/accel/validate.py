"""Statistics of a tree, and its validation."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import NODE
from raytrace.accel.layout import boxes_of, children_of, corners_of, triangles_of
from raytrace.records import Nodes, Tree

NODE_COST = 1.0  # SAH cost of a visit of a node of eight boxes, in units of the test of a leaf of eight triangles


class TreeStats(NamedTuple):
    """Statistics of a tree."""

    triangles: int  # that have an area
    nodes: int
    leaves: int
    levels: int  # of nodes, the root included
    fill: float  # triangles per leaf / 8
    sah_cost: float  # expected nodes and leaves that a random ray through the root's box meets [Wald2007]
    bytes_per_triangle: float  # of nodes and leaves
    growth: float = (
        1.0  # sah_cost over that of the tree as it was built; larger than 1 after ``refit`` if rays are slower
    )


def _boxes(nodes: Nodes) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Low and high of every child slot: (n, 8, 3) arrays."""
    bounds = boxes_of(nodes).transpose(0, 2, 1)
    return bounds[..., :3], bounds[..., 3:]


def sah_cost(nodes: Nodes) -> float:
    """Return the cost of the root plus the sum over all children of area(child) / area(root) times the child's cost."""
    low, high = _boxes(nodes)
    child = children_of(nodes)
    used = (child != 0) & (low[..., 0] < np.inf)  # not a leaf whose triangles have all lost their area
    extent = np.where(used[..., None], high - low, 0).astype(np.float64)
    area = extent[..., 0] * extent[..., 1] + extent[..., 1] * extent[..., 2] + extent[..., 2] * extent[..., 0]
    root = np.ptp(np.concatenate([low[0][used[0]], high[0][used[0]]]), axis=0) if used[0].any() else np.ones(3)
    root_area = float(root[0] * root[1] + root[1] * root[2] + root[2] * root[0])
    with np.errstate(divide="ignore", invalid="ignore"):  # a mesh in one point
        return NODE_COST + float((area * np.where(child > 0, NODE_COST, 1.0)).sum() / np.float64(root_area))


def tree_stats(tree: Tree, levels: int, cost_when_built: float | None = None) -> TreeStats:
    """Compute the statistics of a tree; the cost when it was built is given after a refit."""
    nodes, numbers = len(children_of(tree.nodes)), triangles_of(tree.leaves)
    cost = sah_cost(tree.nodes)
    triangles, leaves = int((numbers >= 0).sum()), len(numbers)
    size = tree.nodes.bounds.nbytes + tree.leaves.rows.nbytes
    fill, each = (triangles / (leaves * NODE), size / triangles) if triangles else (0.0, 0.0)
    growth = cost / cost_when_built if cost_when_built else 1.0
    return TreeStats(triangles, nodes, leaves, levels, fill, cost, each, growth)


def tree_problems(tree: Tree, triangles: NDArray[np.floating]) -> list[str]:
    """List what is wrong with a tree, one line each; ``triangles`` are the (m, 12) rows that it was built from."""
    child = children_of(tree.nodes)
    prim_id = triangles_of(tree.leaves)
    problems = _link_problems(child, len(prim_id)) + _leaf_problems(prim_id, triangles)
    return problems or _box_problems(tree, triangles)  # boxes can be checked only where links are right


def _link_problems(child: NDArray[np.int32], leaf_count: int) -> list[str]:
    """Check that each leaf, and each node but the root, is the child of one node, and that empty slots come last."""
    problems = []
    if ((child[:, 1:] != 0) & (child[:, :-1] == 0)).any():
        problems.append("a node has an empty slot before a child")
    inner, leaf = child[child > 0], ~child[child < 0]
    for name, found, expected in (("node", inner, np.arange(1, len(child))), ("leaf", leaf, np.arange(leaf_count))):
        if leaf_count == 1 and not len(leaf) and name == "leaf":
            continue  # of a mesh without triangles
        if not np.array_equal(np.sort(found), expected):
            problems.append(f"not every {name} is the child of exactly one node")
    return problems


def _leaf_problems(prim_id: NDArray[np.int32], triangles: NDArray[np.floating]) -> list[str]:
    """Check that every triangle with an area lies in one leaf, and that empty lanes come last."""
    problems = []
    if ((prim_id[:, 1:] >= 0) & (prim_id[:, :-1] < 0)).any():
        problems.append("a leaf has an empty lane before a triangle")
    if not np.array_equal(np.sort(prim_id[prim_id >= 0]), np.flatnonzero(np.isfinite(triangles[:, 9]))):
        problems.append("not every triangle with an area lies in exactly one leaf")
    return problems


def _box_problems(tree: Tree, triangles: NDArray[np.floating]) -> list[str]:
    """Check that every box contains what is below it, and that lanes hold the vertices of their triangles."""
    low, high = _boxes(tree.nodes)
    child, prim_id = children_of(tree.nodes), triangles_of(tree.leaves)
    rows = corners_of(tree.leaves).transpose(0, 2, 1)
    held = prim_id >= 0
    problems = []
    if not (np.isposinf(low[child == 0]).all() and np.isneginf(high[child == 0]).all()):
        problems.append("an empty slot of a node does not hold the empty box")
    if not np.array_equal(rows[held], triangles[prim_id[held]]):
        problems.append("a lane of a leaf does not hold the vertices of its triangle")
    corners = rows[..., :9].reshape(len(prim_id), NODE, 3, 3)
    leaf_low = np.where(held[..., None], corners.min(axis=2), np.inf).min(axis=1)
    leaf_high = np.where(held[..., None], corners.max(axis=2), -np.inf).max(axis=1)
    node_low, node_high = low.min(axis=1), high.max(axis=1)
    for name, found, at, below in (
        ("leaf", child < 0, ~child, (leaf_low, leaf_high)),
        ("node", child > 0, child, (node_low, node_high)),
    ):
        if (low[found] > below[0][at[found]]).any() or (high[found] < below[1][at[found]]).any():
            problems.append(f"a box does not hold the {name} below it")
    return problems
