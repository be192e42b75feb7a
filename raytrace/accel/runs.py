"""Trace a list of rays in which neighbours lie in rows, though not in rows of one length, in compact bundles.

Shadow rays of the pixels that see a surface are such a list: the other pixels have none, so there is no width by which
``raster`` could find the next row. Here each four rays in turn, a run, stay together. Runs are sorted by the Morton
code of the point where they start, or of their direction where all start in one point [Morton1966]. Then the rays of a
bundle come from several rows. The results are bit-identical, and come in the original order.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel import query, reorder
from raytrace.accel.batches import pick
from raytrace.accel.lanes import (
    lane_max,
    lane_min,
    lane_numbers,
    load,
    load_rows,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    poke,
    prefetch,
    select,
    splat,
    store,
)
from raytrace.accel.reorder import DIGIT, MAX_BITS, Grid, SortScratch, cell_of, plain, sort_by_digit
from raytrace.jit import inlined, kernel
from raytrace.records import Columns, Hits, Rays, Tree

RUN = 4  # rays of a run
AHEAD = 16  # runs: how far ahead of their copying they are brought into the cache


class Runs(NamedTuple):
    """A batch of n rays, one after the other, to be sorted by runs."""

    n: int
    field: int  # what they are sorted by: 0 origins, 1 directions


@inlined
def middles_of_runs(columns: Columns, i: int, runs: int, like):
    """x, y, z of a vector in the middle of runs i, i + 1, ...; lanes beyond the last run repeat it."""
    numbers = lane_numbers(like) + np.int32(i)
    rows = select(numbers < np.int32(runs), numbers, np.int32(runs - 1)) * np.int32(RUN) + np.int32(RUN // 2)
    return pick(columns, rows, 0), pick(columns, rows, 1), pick(columns, rows, 2)


@inlined
def bounds_of_runs(columns: Columns, runs: int, like):
    """Least components of the vectors that are sorted by, and their largest range; NaN does not count."""
    x_low, y_low, z_low = splat(np.inf, like), splat(np.inf, like), splat(np.inf, like)
    x_high, y_high, z_high = splat(-np.inf, like), splat(-np.inf, like), splat(-np.inf, like)
    for i in range(0, runs, packet_width(columns.data)):
        x, y, z = middles_of_runs(columns, i, runs, like)
        x_low, y_low, z_low = minimum(x, x_low), minimum(y, y_low), minimum(z, z_low)
        x_high, y_high, z_high = maximum(x, x_high), maximum(y, y_high), maximum(z, z_high)
    low = splat(lane_min(x_low), like), splat(lane_min(y_low), like), splat(lane_min(z_low), like)
    x, y, z = lane_max(x_high) - low[0], lane_max(y_high) - low[1], lane_max(z_high) - low[2]
    return low, maximum(maximum(x, y), z)


@kernel
def sort_runs(columns: Columns, runs: int, scratch: SortScratch):
    """Sort numbers of runs by the Morton codes of vectors, in cubic cells; return the row of ``numbers`` to read."""
    like = packet(columns.data)
    low, size = bounds_of_runs(columns, runs, like)
    scale = ((1 << MAX_BITS) - 1.0) / size
    for i in range(0, runs, packet_width(columns.data)):
        x, y, z = middles_of_runs(columns, i, runs, like)
        key = cell_of(x, low[0], scale, MAX_BITS) | cell_of(y, low[1], scale, MAX_BITS) << np.int32(1)
        store(scratch.keys[0], i, key | cell_of(z, low[2], scale, MAX_BITS) << np.int32(2))
    for i in range(runs):
        scratch.numbers[0, i] = i
    row = 0
    for shift in range(0, 3 * MAX_BITS, DIGIT):
        target = scratch.keys[1 - row], scratch.numbers[1 - row]
        sort_by_digit(scratch.keys[row], scratch.numbers[row], runs, shift, scratch.counts, target)
        row = 1 - row
    return row


@inlined
def take_number(columns: Columns, i: int, axis: int, out, to: int):
    """Copy component ``axis`` of ray i."""
    poke(out, to, peek(columns.data, columns.start + axis * columns.axis + i * columns.row))


@inlined
def take_numbers(columns: Columns, i: int, axis: int, out, to: int):
    """Copy component ``axis`` of the run that begins at ray i."""
    if columns.row == 1:
        store(out, to, load(columns.data, columns.start + axis * columns.axis + i, RUN))
        return
    for k in range(RUN):
        take_number(columns, i + k, axis, out, to + k)


@inlined
def take_vectors(columns: Columns, i: int, out, to: int, size: int):
    """Copy the vectors of the run that begins at ray i."""
    if columns.row == 3 and columns.axis == 1:
        x, y, z = load_rows(columns.data, columns.start + 3 * i, RUN)
        store(out, to, x)
        store(out, to + size, y)
        store(out, to + 2 * size, z)
        return
    for axis in range(3):
        take_numbers(columns, i, axis, out, to + axis * size)


@inlined
def prefetch_vectors(columns: Columns, i: int):
    """Bring the vectors of the run that begins at ray i into the cache."""
    for axis in range(3):
        prefetch(columns.data, columns.start + axis * columns.axis + i * columns.row)


@kernel
def take_runs(rays: Rays, n: int, numbers, out):
    """Copy rays, run after run, as a structure of arrays; those after the last run come last."""
    size, runs = len(out) // 8, n // RUN
    for j in range(runs):
        ahead = RUN * np.int64(peek(numbers, min(j + AHEAD, runs - 1)))
        prefetch_vectors(rays.o, ahead)
        prefetch_vectors(rays.d, ahead)
        i, to = RUN * np.int64(peek(numbers, j)), RUN * j
        take_vectors(rays.o, i, out, to, size)
        take_vectors(rays.d, i, out, to + 3 * size, size)
        take_numbers(rays.tmin, i, 0, out, to + 6 * size)
        take_numbers(rays.tmax, i, 0, out, to + 7 * size)
    for i in range(RUN * runs, n):
        for axis in range(3):
            take_number(rays.o, i, axis, out, i + axis * size)
            take_number(rays.d, i, axis, out, i + (3 + axis) * size)
        take_number(rays.tmin, i, 0, out, i + 6 * size)
        take_number(rays.tmax, i, 0, out, i + 7 * size)


@kernel
def give_back_runs(values, n: int, numbers, out):
    """Write the values of rays in the order of ``take_runs`` in their original order."""
    runs = n // RUN
    for j in range(runs):
        store(out, RUN * np.int64(peek(numbers, j)), load(values, RUN * j, RUN))
    for i in range(RUN * runs, n):
        poke(out, i, peek(values, i))


def closest_hit(tree: Tree, grid: Grid, rays: Rays, hits: Hits, batch: Runs, scratch: SortScratch) -> None:
    """Find the nearest hits of the rays of a batch, which are sorted by runs, or as ``reorder`` does."""
    if not reorder.in_order(tree, grid, rays, batch.n, scratch):
        reorder.closest_hit(tree, grid, rays, hits, batch.n, scratch)
        return
    numbers, rays = _sorted(rays, batch, scratch)
    query.closest_hit(tree, rays, scratch.hits, batch.n, plain(scratch.work))
    for values, out in zip(scratch.hits, hits, strict=True):
        give_back_runs(values, batch.n, numbers, out)


def any_hit(tree: Tree, grid: Grid, rays: Rays, occluded: NDArray[np.bool_], batch: Runs, scratch: SortScratch) -> None:
    """Find which rays of a batch are occluded; they are sorted by runs, or as ``reorder`` does."""
    if not reorder.in_order(tree, grid, rays, batch.n, scratch):
        reorder.any_hit(tree, grid, rays, occluded, batch.n, scratch)
        return
    numbers, rays = _sorted(rays, batch, scratch)
    query.any_hit(tree, rays, scratch.occluded, batch.n, plain(scratch.work))
    give_back_runs(scratch.occluded, batch.n, numbers, occluded)


def _sorted(rays: Rays, batch: Runs, scratch: SortScratch) -> tuple[NDArray[np.int32], Rays]:
    """Return the numbers of the runs of a batch in the order of tracing, and its rays in that order."""
    numbers = scratch.numbers[sort_runs(rays[batch.field], batch.n // RUN, scratch)]
    take_runs(rays, batch.n, numbers, scratch.rays)
    size = len(scratch.occluded)
    taken = [Columns(scratch.rays, first * size, 1, size) for first in (0, 3, 6, 7)]
    return numbers, Rays(*(old if old.row == 0 else new for old, new in zip(rays, taken, strict=True)))
