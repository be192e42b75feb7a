"""How nodes and leaves lie in memory: the data of one visit lies side by side.

A node has 64 elements (four cache lines of float32): 8 low x, 8 low y, 8 low z, 8 high x, 8 high y, 8 high z, then the
numbers of its 8 children, the bits of the children that exist, and 7 unused elements. A leaf has 104 elements: 8 each
of v0 x y z, v1 x y z, v2 x y z, then the numbers of its 8 triangles, then 8 each of the unit normals x y z, which are
read for hits only.

``bounds`` and ``child`` of ``Nodes``, and ``rows`` and ``prim_id`` of ``Leaves``, are the same memory, seen as floats
and as integers of the same size.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import NODE
from raytrace.records import MollerTrumboreLeaves, Nodes, WatertightLeaves

Leaves = WatertightLeaves | MollerTrumboreLeaves

NODE_SIZE = 8 * NODE
LEAF_SIZE = 13 * NODE
CHILD = 6 * NODE  # offset of the children in a node
PRESENT = 7 * NODE  # offset of their bits: bit k is set if there is a child k
V0, V1, V2 = 0, 3 * NODE, 6 * NODE  # offsets of the vertices of the triangles in a leaf
PRIM_ID = 9 * NODE  # offset of the numbers of the triangles
NORMAL = 10 * NODE
LINE = 64  # bytes of a cache line


def integers(dtype: np.dtype) -> np.dtype:
    """The integer type of the same size as a float type."""
    return np.dtype(f"i{dtype.itemsize}")


def aligned(n: int, dtype: np.dtype) -> NDArray[Any]:
    """Allocate n elements, aligned to a cache line."""
    memory = np.zeros(n * dtype.itemsize + LINE, np.uint8)
    start = -memory.__array_interface__["data"][0] % LINE
    return memory[start : start + n * dtype.itemsize].view(dtype)


def make_nodes(n: int, dtype: np.dtype) -> Nodes:
    """Allocate n nodes."""
    memory = aligned(n * NODE_SIZE, dtype)
    return Nodes(memory, memory.view(integers(dtype)))


def make_leaves(kind: type[Leaves], n: int, dtype: np.dtype) -> Leaves:
    """Allocate n leaves."""
    memory = aligned(n * LEAF_SIZE, dtype)
    return kind(memory, memory.view(integers(dtype)))


def boxes_of(nodes: Nodes) -> NDArray[Any]:
    """Planes of a tree: (n, 6, 8) view."""
    return nodes.bounds.reshape(-1, NODE_SIZE)[:, :CHILD].reshape(-1, 6, NODE)


def children_of(nodes: Nodes) -> NDArray[Any]:
    """Children of a tree: (n, 8) view."""
    return nodes.child.reshape(-1, NODE_SIZE)[:, CHILD : CHILD + NODE]


def triangles_of(leaves: Leaves) -> NDArray[Any]:
    """Numbers of the triangles in leaves: (n, 8) view."""
    return leaves.prim_id.reshape(-1, LEAF_SIZE)[:, PRIM_ID:NORMAL]


def corners_of(leaves: Leaves) -> NDArray[Any]:
    """Vertices and normals in leaves: (n, 12, 8) array."""
    rows = leaves.rows.reshape(-1, LEAF_SIZE // NODE, NODE)
    return np.concatenate([rows[:, : PRIM_ID // NODE], rows[:, NORMAL // NODE :]], axis=1)
