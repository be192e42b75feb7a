"""Sort points by cell, so that the search for each begins near the closest triangle of the one before."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel import query
from raytrace.accel.lanes import PACKET, packet, packet_width, splat_int, store
from raytrace.accel.reorder import DIGIT, Grid, cell_of, sort_by_digit
from raytrace.jit import inlined, kernel
from raytrace.records import Columns


class PointOrder(NamedTuple):
    """Scratch memory of one thread, for n points."""

    keys: NDArray[np.int32]  # (2, n)
    numbers: NDArray[np.int32]  # (2, n): numbers of the points with these keys
    counts: NDArray[np.int32]  # (2^DIGIT,)


def make_point_order(n: int) -> PointOrder:
    """Allocate scratch memory for n points."""
    n = -(-n // PACKET) * PACKET
    return PointOrder(np.empty((2, n), np.int32), np.empty((2, n), np.int32), np.empty(1 << DIGIT, np.int32))


@inlined
def point_keys(points: Columns, i: int, n: int, grid: Grid, like):
    """Morton codes of the cells of points."""
    position = query.read_vectors(points, i, n, like)
    key = splat_int(0, like)
    for axis in range(3):
        key = key | cell_of(position[axis], grid.low[axis], grid.scale[axis], grid.bits) << np.int32(axis)
    return key


@kernel
def sort_points(points: Columns, n: int, grid: Grid, order: PointOrder):
    """Sort numbers of points by cell, unless most neighbours share one; return the row of ``numbers`` to read."""
    like = packet(points.data)
    for i in range(0, n, packet_width(points.data)):
        store(order.keys[0], i, point_keys(points, i, n, grid, like))
    changes = 0
    for i in range(n):
        order.numbers[0, i] = i
        changes += order.keys[0, i] != order.keys[0, max(i - 1, 0)]
    row = 0
    if 2 * changes <= n:
        return row
    for shift in range(0, 3 * grid.bits, DIGIT):
        target = order.keys[1 - row], order.numbers[1 - row]
        sort_by_digit(order.keys[row], order.numbers[row], n, shift, order.counts, target)
        row = 1 - row
    return row
