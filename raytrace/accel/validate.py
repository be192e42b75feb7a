"""Statistics of a tree, and its validation."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import NODE
from raytrace.accel.layout import boxes_of, children_of, corners_of, triangles_of
from raytrace.records import Nodes, Tree

NODE_COST = 1.0  # SAH cost of a visit of a node of eight boxes, in units of the test of a leaf of eight triangles

STEPS = 10  # of a grid of points along each edge of a divided triangle


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
    references: float = 1.0  # leaves per triangle; more than 1 where large triangles are divided among several


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


def tree_stats(tree: Tree, levels: int, cost_when_built: float | None = None, number: int | None = None) -> TreeStats:
    """Compute the statistics of a tree.

    The cost when it was built is given after a refit; the number of triangles where some lie in several leaves.
    """
    nodes, numbers = len(children_of(tree.nodes)), triangles_of(tree.leaves)
    cost = sah_cost(tree.nodes)
    used, leaves = int((numbers >= 0).sum()), len(numbers)
    triangles = used if number is None else number
    size = tree.nodes.bounds.nbytes + tree.leaves.rows.nbytes
    fill, each = (used / (leaves * NODE), size / triangles) if triangles else (0.0, 0.0)
    growth = cost / cost_when_built if cost_when_built else 1.0
    references = used / triangles if triangles else 1.0
    return TreeStats(triangles, nodes, leaves, levels, fill, cost, each, growth, references)


def tree_problems(tree: Tree, triangles: NDArray[np.floating], divided: bool = False) -> list[str]:
    """List what is wrong with a tree, one line each; ``triangles`` are the (m, 12) rows that it was built from."""
    child = children_of(tree.nodes)
    prim_id = triangles_of(tree.leaves)
    problems = _link_problems(child, len(prim_id)) + _leaf_problems(prim_id, triangles, divided)
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


def _leaf_problems(prim_id: NDArray[np.int32], triangles: NDArray[np.floating], divided: bool) -> list[str]:
    """Check that every triangle with an area lies in one leaf, or in several, and that empty lanes come last."""
    problems = []
    if ((prim_id[:, 1:] >= 0) & (prim_id[:, :-1] < 0)).any():
        problems.append("a leaf has an empty lane before a triangle")
    found, leaf = np.sort(prim_id[prim_id >= 0]), "exactly one leaf"
    if divided:
        found, leaf = np.unique(found), "a leaf"
    if not np.array_equal(found, np.flatnonzero(np.isfinite(triangles[:, 9]))):
        problems.append(f"not every triangle with an area lies in {leaf}")
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
    counts = np.bincount(prim_id[held], minlength=max(len(triangles), 1))
    whole = held & (counts[prim_id] == 1)
    leaf_low = np.where(whole[..., None], corners.min(axis=2), np.inf).min(axis=1)
    leaf_high = np.where(whole[..., None], corners.max(axis=2), -np.inf).max(axis=1)
    node_low, node_high = low.min(axis=1), high.max(axis=1)
    for name, found, at, below in (
        ("leaf", child < 0, ~child, (leaf_low, leaf_high)),
        ("node", child > 0, child, (node_low, node_high)),
    ):
        if (low[found] > below[0][at[found]]).any() or (high[found] < below[1][at[found]]).any():
            problems.append(f"a box does not hold the {name} below it")
    if (counts > 1).any() and not _parts_cover(tree, triangles, counts > 1):
        problems.append("the boxes of the leaves of a triangle do not cover it")
    return problems


def _parts_cover(tree: Tree, triangles: NDArray[np.floating], several: NDArray[np.bool_]) -> bool:
    """Whether a grid of points on each triangle that lies in several leaves lies in the boxes of these leaves."""
    low, high = _boxes(tree.nodes)
    child, prim_id = children_of(tree.nodes), triangles_of(tree.leaves)
    leaf_low, leaf_high = np.empty((2, len(prim_id), 3), low.dtype)
    leaf_low[~child[child < 0]], leaf_high[~child[child < 0]] = low[child < 0], high[child < 0]
    leaf, lane = np.nonzero((prim_id >= 0) & several[prim_id])
    number = prim_id[leaf, lane]
    v0, v1, v2 = triangles[number, :9].astype(np.float64).reshape(-1, 3, 3).transpose(1, 0, 2)
    for i, j in zip(*np.triu_indices(STEPS + 1), strict=True):  # i <= j
        p = (i * v0 + (j - i) * v1 + (STEPS - j) * v2) / STEPS
        inside = ((p >= leaf_low[leaf]) & (p <= leaf_high[leaf])).all(axis=1)
        if np.bincount(number[inside], minlength=len(several))[several].min() == 0:
            return False
    return True
