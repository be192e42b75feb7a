"""The records of scratch memory for traversals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Work(NamedTuple):
    """Scratch memory of one thread for traversals."""

    t: NDArray[np.floating]  # f: where the rays enter the nodes on the stack
    child: NDArray[np.int32]  # i4: these nodes, or ~leaf
    alive: NDArray[np.int32]  # i4: bit masks of the rays of a packet that enter them
    lanes: NDArray[np.floating]  # f: rays that are traced singly, and their results; one row of lanes per quantity
    prim_id: NDArray[np.int32]  # i4: one row of lanes
    counts: NDArray[np.int64]  # (2,) i8: nodes visited, triangles tested (counted once per packet)


class PoolWork(NamedTuple):
    """The same with a pool, for rays that may be scattered; the first six fields are those of ``Work``."""

    t: NDArray[np.floating]
    child: NDArray[np.int32]
    alive: NDArray[np.int32]
    lanes: NDArray[np.floating]
    prim_id: NDArray[np.int32]
    counts: NDArray[np.int64]
    pool_t: NDArray[np.floating]  # f: as t, a stack for each ray of the pool
    pool_child: NDArray[np.signedinteger]  # i of the size of f: as child
    pool_state: NDArray[np.int32]  # i4: where each ray of the pool is; one row of lanes per quantity
    pool_queue: NDArray[np.int32]  # i4: the rays before a node, then the rays before a leaf
