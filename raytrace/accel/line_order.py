"""Sort rays for queries that follow them through the whole tree: rays along the same line lie side by side.

A ray has four coordinates besides its octant and dominant axis: those across that axis of the point where it enters the
bounds of the tree, or begins, and of the point where it leaves them, or ends. A Morton code of the four is the key.
"""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.batches import read, read_vectors
from raytrace.accel.lanes import (
    absolute,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    select,
    splat,
    splat_int,
    store,
    to_int,
)
from raytrace.accel.reorder import DIGIT, DIRECTION_BITS, Grid, SortScratch, sort_by_digit, sorted_rays, worth_sorting
from raytrace.jit import inlined, kernel
from raytrace.records import Rays, Tree

CELLS = 64  # along each coordinate
CODE = 24  # bits of the code of four coordinates


@inlined
def spread(x, low, high):
    """Cell of a coordinate, with its six bits spread four apart."""
    cell = to_int(maximum(minimum((x - low) * (CELLS / (high - low)), CELLS - 1.0), 0.0))
    cell = (cell | cell << np.int32(9)) & np.int32(0x7007)
    return cell & np.int32(0x1001) | (cell & np.int32(0x2002)) << np.int32(3) | (cell & np.int32(0x4004)) << np.int32(6)


@inlined
def across(on_x, on_y, values):
    """The two of three values, x y z, that belong to the axes across the dominant one."""
    first = select(on_x, values[1], select(on_y, values[2], values[0]))
    return first, select(on_x, values[2], select(on_y, values[0], values[1]))


@inlined
def keys_of_lines(rays: Rays, i: int, n: int, extent, like):
    """Sort keys of rays: octant and dominant axis in the highest bits, then the code of the line."""
    o, d = read_vectors(rays.o, i, n, like), read_vectors(rays.d, i, n, like)
    begin, end = read(rays.tmin, i, 0, n, like), read(rays.tmax, i, 0, n, like)
    for axis in range(3):
        first, last = (peek(extent, axis) - o[axis]) / d[axis], (peek(extent, 3 + axis) - o[axis]) / d[axis]
        begin, end = maximum(minimum(first, last), begin), minimum(maximum(first, last), end)
    ax, ay, az = absolute(d[0]), absolute(d[1]), absolute(d[2])
    on_x = (ax >= ay) & (ax >= az)
    on_y = ~on_x & (ay >= az)
    zero = splat_int(0, like)
    key = select(on_x, zero, select(on_y, zero + np.int32(8), np.int32(16)))
    key = (
        key | select(d[0] < 0.0, zero + np.int32(1), np.int32(0)) | select(d[1] < 0.0, zero + np.int32(2), np.int32(0))
    )
    key = (key | select(d[2] < 0.0, zero + np.int32(4), np.int32(0))) << np.int32(CODE)
    lows = splat(peek(extent, 0), like), splat(peek(extent, 1), like), splat(peek(extent, 2), like)
    highs = splat(peek(extent, 3), like), splat(peek(extent, 4), like), splat(peek(extent, 5), like)
    low, high, at, to = (
        across(on_x, on_y, lows),
        across(on_x, on_y, highs),
        across(on_x, on_y, o),
        across(on_x, on_y, d),
    )
    for k in range(2):
        key = key | spread(at[k] + begin * to[k], low[k], high[k]) << np.int32(k)
        key = key | spread(at[k] + end * to[k], low[k], high[k]) << np.int32(2 + k)
    return key


@kernel
def sort_lines(rays: Rays, n: int, extent, scratch: SortScratch):
    """Sort keys and numbers of rays by key; return the row of ``numbers`` to read."""
    like = packet(scratch.rays)
    for i in range(0, n, packet_width(scratch.rays)):
        store(scratch.keys[0], i, keys_of_lines(rays, i, n, extent, like))
    for i in range(n):
        scratch.numbers[0, i] = i
    row = 0
    for shift in range(0, DIRECTION_BITS + CODE, DIGIT):
        target = scratch.keys[1 - row], scratch.numbers[1 - row]
        sort_by_digit(scratch.keys[row], scratch.numbers[row], n, shift, scratch.counts, target)
        row = 1 - row
    return row


def lines_in_order(
    tree: Tree, grid: Grid, rays: Rays, n: int, scratch: SortScratch
) -> tuple[NDArray[np.int32] | None, Rays]:
    """Return n rays in an order that is fast to trace, and the number that each had; None: as they are."""
    if not worth_sorting(tree, grid, rays, n, scratch):
        return None, rays
    return sorted_rays(rays, n, scratch.numbers[sort_lines(rays, n, tree.extent, scratch)], scratch)
