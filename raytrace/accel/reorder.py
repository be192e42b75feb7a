"""Sort rays, so that rays that start in the same cell and point the same way go through the tree together.

Rays in random order find neither their nodes in the cache nor rays of the same octant and dominant axis to share a
packet with. Sorting them by cell, octant and axis costs far less than it saves [Pharr1997]. The results are
bit-identical, and come in the original order.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace import cores
from raytrace.accel import query
from raytrace.accel.batches import Pixels, pick, read_vectors
from raytrace.accel.lanes import (
    PACKET,
    absolute,
    load,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    poke,
    select,
    splat_int,
    store,
    to_int,
)
from raytrace.accel.layout import boxes_of, children_of
from raytrace.accel.pool import suits_pool
from raytrace.jit import inlined, kernel
from raytrace.records import Columns, Hits, Rays, Tree
from raytrace.work_records import PoolWork, Work

DIGIT = 12  # bits that one pass of the radix sort orders by
DIRECTION_BITS = 5  # of a key: octant (3) and dominant axis (2)
MAX_BITS = 8  # of a cell, per axis
SORTED = 4  # batches are sorted where more than 1 / SORTED of neighbours differ
SAMPLE = 256  # rays that decide whether a batch is in order already

# Scratch memory between queries. Allocated anew each time, it would be new pages; and after so much is freed, the
# allocator returns its pages to the system, so that those of the results are new too: 10 ns per ray.
spare: dict[np.dtype, list["SortScratch"]] = {}


class Grid(NamedTuple):
    """Grid over the bounds of a tree, of about as many cells as it has leaves."""

    low: NDArray[np.floating]  # (3,) f, world units
    scale: NDArray[np.floating]  # (3,) f: cells per world unit
    bits: int  # there are 2^bits cells along each axis


class SortScratch(NamedTuple):
    """Scratch memory of one thread, for n rays."""

    keys: NDArray[np.int32]  # (2, n)
    numbers: NDArray[np.int32]  # (2, n): numbers of the rays with these keys
    counts: NDArray[np.int32]  # (2^DIGIT,)
    rays: NDArray[np.floating]  # (8n,) f: o x y z, d x y z, tmin, tmax
    hits: Hits
    occluded: NDArray[np.bool_]
    work: PoolWork


def make_grid(tree: Tree) -> Grid:
    """Make the grid of a tree."""
    bounds = boxes_of(tree.nodes)[0]
    low, high = bounds[:3].min(axis=1), bounds[3:].max(axis=1)
    bits = min(round(np.log2(max(np.count_nonzero(children_of(tree.nodes) < 0), 1)) / 3), MAX_BITS)
    with np.errstate(all="ignore"):
        scale = np.where(high > low, 2.0**bits / (high - low), 0)
    return Grid(low, scale.astype(low.dtype), bits)


def make_sort_scratch(n: int, dtype: np.dtype, work: PoolWork) -> SortScratch:
    """Allocate scratch memory for n rays."""
    n = (-(-n // PACKET) + 5) * PACKET
    hits = Hits(np.empty(n, dtype), np.empty(n, np.int32), np.empty(n, dtype), np.empty(n, dtype))
    pairs = np.empty((2, n), np.int32), np.empty((2, n), np.int32)
    return SortScratch(
        *pairs, np.empty(1 << DIGIT, np.int32), np.empty(8 * n, dtype), hits, np.empty(n, np.bool_), work
    )


def borrow_sort_scratch(n: int, dtype: np.dtype, work: PoolWork) -> SortScratch:
    """Return scratch memory for at least n rays, which an earlier query gave back if there is any; see ``spare``."""
    try:
        scratch = spare.setdefault(dtype, []).pop()
    except IndexError:
        return make_sort_scratch(n, dtype, work)
    return scratch._replace(work=work) if len(scratch.occluded) >= n else make_sort_scratch(n, dtype, work)


def return_sort_scratch(dtype: np.dtype, scratch: list[SortScratch]) -> None:
    """Keep scratch memory that is no longer used for later queries, one for each core that the process may use."""
    kept = spare.setdefault(dtype, [])
    kept.extend(scratch[: max(cores.usable() - len(kept), 0)])


@inlined
def cell_of(x, low, scale, bits):
    """Numbers of cells along one axis, with their bits spread three apart for a Morton code."""
    cell = to_int(maximum(minimum((x - low) * scale, (1 << bits) - 1.0), 0.0))
    cell = (cell | cell << np.int32(8)) & np.int32(0x0300F00F)
    cell = (cell | cell << np.int32(4)) & np.int32(0x030C30C3)
    return (cell | cell << np.int32(2)) & np.int32(0x09249249)


@inlined
def keys_of(rays: Rays, i: int, n: int, grid: Grid, like):
    """Sort keys of rays: Morton code of the origin's cell, then octant and dominant axis in the lowest bits."""
    zero = splat_int(0, like)
    o, (x, y, z) = read_vectors(rays.o, i, n, like), read_vectors(rays.d, i, n, like)
    ax, ay, az = absolute(x), absolute(y), absolute(z)
    key = select((ax >= ay) & (ax >= az), zero, select(ay >= az, zero + np.int32(8), np.int32(16)))
    key = key | select(x < 0.0, zero + np.int32(1), np.int32(0)) | select(y < 0.0, zero + np.int32(2), np.int32(0))
    key = key | select(z < 0.0, zero + np.int32(4), np.int32(0))
    for axis in range(3):
        cell = cell_of(o[axis], grid.low[axis], grid.scale[axis], grid.bits)
        key = key | cell << np.int32(DIRECTION_BITS + axis)
    return key


@kernel
def changes(rays: Rays, n: int, grid: Grid, scratch: SortScratch):
    """Count neighbours with different keys, and with different directions, among ``SAMPLE`` rays.

    The rays are taken as runs of ``PACKET`` across the batch.
    """
    like = packet(scratch.rays)
    keys, directions = 0, 0
    for part in range(SAMPLE // PACKET):
        i = part * (n - PACKET) // (SAMPLE // PACKET - 1)
        for k in range(0, PACKET, packet_width(scratch.rays)):
            store(scratch.keys[0], k, keys_of(rays, i + k, n, grid, like))
        for k in range(1, PACKET):
            keys += scratch.keys[0, k] != scratch.keys[0, k - 1]
            directions += (scratch.keys[0, k] ^ scratch.keys[0, k - 1]) & ((1 << DIRECTION_BITS) - 1) != 0
    return keys, directions


@kernel
def sort_rays(rays: Rays, n: int, grid: Grid, scratch: SortScratch):
    """Sort keys and numbers of rays by key (radix sort, least digit first); return the row of ``numbers`` to read."""
    like = packet(scratch.rays)
    for i in range(0, n, packet_width(scratch.rays)):
        store(scratch.keys[0], i, keys_of(rays, i, n, grid, like))
    for i in range(n):
        scratch.numbers[0, i] = i
    row = 0
    for shift in range(0, DIRECTION_BITS + 3 * grid.bits, DIGIT):
        target = scratch.keys[1 - row], scratch.numbers[1 - row]
        sort_by_digit(scratch.keys[row], scratch.numbers[row], n, shift, scratch.counts, target)
        row = 1 - row
    return row


@inlined
def sort_by_digit(keys, numbers, n, shift, counts, target):
    """One pass of a radix sort; writes the keys and numbers of ``target``."""
    counts[:] = 0
    for i in range(n):
        counts[(peek(keys, i) >> shift) & ((1 << DIGIT) - 1)] += 1
    total = 0
    for digit in range(1 << DIGIT):
        here = peek(counts, digit)
        poke(counts, digit, total)
        total += here
    for i in range(n):
        key = peek(keys, i)
        digit = (key >> shift) & ((1 << DIGIT) - 1)
        at = peek(counts, digit)
        poke(counts, digit, at + 1)
        poke(target[0], at, key)
        poke(target[1], at, peek(numbers, i))


@kernel
def take(rays: Rays, n: int, numbers, out):
    """Copy rays in the order of ``numbers``, as a structure of arrays."""
    like = packet(out)
    size = len(out) // 8
    for i in range(n, min(n + packet_width(out), size)):
        numbers[i] = 0
    for i in range(0, n, packet_width(out)):
        rows = load(numbers, i, splat_int(0, like))
        for axis in range(3):
            store(out, axis * size + i, pick(rays.o, rows, axis))
            store(out, (3 + axis) * size + i, pick(rays.d, rows, axis))
        store(out, 6 * size + i, pick(rays.tmin, rows, 0))
        store(out, 7 * size + i, pick(rays.tmax, rows, 0))


@kernel
def give_back(values, n, numbers, out):
    """Write the values of sorted rays in the original order of the rays."""
    for i in range(n):
        poke(out, peek(numbers, i), peek(values, i))


def plain(work: PoolWork) -> Work:
    """Return scratch memory without its pool."""
    return Work(*work[: len(Work._fields)])


def in_order(tree: Tree, grid: Grid, rays: Rays, n: int, scratch: SortScratch) -> bool:
    """Return whether rays are neither sorted first nor traced in a pool, because most are like their neighbours."""
    sort, work = _order(tree, grid, rays, n, scratch)
    return not sort and isinstance(work, Work)


def worth_sorting(tree: Tree, grid: Grid, rays: Rays, n: int, scratch: SortScratch) -> bool:
    """Return whether rays are faster if they are sorted first: where most neighbours differ, but not for a pool."""
    return _order(tree, grid, rays, n, scratch)[0]


def _order(tree: Tree, grid: Grid, rays: Rays, n: int, scratch: SortScratch) -> tuple[bool, Work | PoolWork]:
    """Return whether rays are faster if sorted first, and scratch memory: with a pool if they are scattered."""
    if n < SAMPLE:
        return False, plain(scratch.work)
    keys, directions = changes(rays, n, grid, scratch)
    if 2 * directions > SAMPLE and suits_pool(tree):
        return False, scratch.work
    return SORTED * keys > SAMPLE, plain(scratch.work)


def closest_hit(tree: Tree, grid: Grid, rays: Rays, hits: Hits, batch: int | Pixels, scratch: SortScratch) -> None:
    """Find the nearest hits of the rays of a batch, which are sorted first if that is faster."""
    n = _count(batch)
    sort, work = _order(tree, grid, rays, n, scratch)
    if not sort:
        query.closest_hit(tree, rays, hits, batch, work)
        return
    numbers, rays = _sorted(rays, n, grid, scratch)
    query.closest_hit(tree, rays, scratch.hits, n, work)
    for values, out in zip(scratch.hits, hits, strict=True):
        give_back(values, n, numbers, out)


def any_hit(
    tree: Tree, grid: Grid, rays: Rays, occluded: NDArray[np.bool_], batch: int | Pixels, scratch: SortScratch
) -> None:
    """Find which rays of a batch are occluded; they are sorted first if that is faster."""
    n = _count(batch)
    sort, work = _order(tree, grid, rays, n, scratch)
    if not sort:
        query.any_hit(tree, rays, occluded, batch, work)
        return
    numbers, rays = _sorted(rays, n, grid, scratch)
    query.any_hit(tree, rays, scratch.occluded, n, work)
    give_back(scratch.occluded, n, numbers, occluded)


def _count(batch: int | Pixels) -> int:
    """Rays of a batch."""
    return batch.width * batch.height if isinstance(batch, Pixels) else batch


def sorted_rays(rays: Rays, n: int, numbers: NDArray[np.int32], scratch: SortScratch) -> tuple[NDArray[np.int32], Rays]:
    """Return n rays in the order of ``numbers``, and the numbers."""
    take(rays, n, numbers, scratch.rays)
    size = len(scratch.occluded)
    columns = [Columns(scratch.rays, first * size, 1, size) for first in (0, 3, 6, 7)]
    return numbers, Rays(*columns)


def _sorted(rays: Rays, n: int, grid: Grid, scratch: SortScratch) -> tuple[NDArray[np.int32], Rays]:
    return sorted_rays(rays, n, scratch.numbers[sort_rays(rays, n, grid, scratch)], scratch)
