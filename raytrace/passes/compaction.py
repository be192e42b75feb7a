"""Compaction: paths that go on, and shadow rays, are packed next to each other, sorted by direction.

Scattered rays in the order of their pixels would go through the tree one by one. A counting sort by octant, dominant
axis and cell makes packets of them. It costs far less than it saves [Pharr1997], and changes no bit of the image.
"""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import (
    absolute,
    gather,
    lane_numbers,
    load,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    poke,
    select,
    splat,
    splat_int,
    store,
)
from raytrace.accel.reorder import Grid, cell_of, make_grid
from raytrace.accel.vectors import scaled
from raytrace.jit import inlined, kernel
from raytrace.passes.paths import DEAD, ROULETTE, ROULETTE_FROM, SURVIVE, add, uniform
from raytrace.passes.surface import load3, store3
from raytrace.records import Tree

CELL_BITS = 2  # of a cell, at most, per axis
DIRECTIONS = 24  # octants times dominant axes; the key after theirs is that of rays that have ended


def make_cells(tree: Tree) -> Grid:
    """Make the grid whose cells paths are sorted by: coarse, because a batch has few rays for each direction."""
    grid = make_grid(tree)
    bits = min(grid.bits, CELL_BITS)
    return grid._replace(scale=grid.scale * 0.5 ** (grid.bits - bits), bits=bits)


def make_counts() -> NDArray[np.int32]:
    """Allocate the counters of a sort."""
    return np.zeros((DIRECTIONS << 3 * CELL_BITS) + 1, np.int32)


@inlined
def keys_of(rays, i, size, grid, like):
    """Sort keys of rays: octant and dominant axis, then the Morton code of the origin's cell in the lowest bits."""
    o, (x, y, z) = load3(rays.o, i, size, like), load3(rays.d, i, size, like)
    ax, ay, az = absolute(x), absolute(y), absolute(z)
    zero = splat_int(0, like)
    key = select((ax >= ay) & (ax >= az), zero, select(ay >= az, zero + np.int32(8), np.int32(16)))
    key = key + select(x < 0.0, zero + np.int32(1), np.int32(0)) + select(y < 0.0, zero + np.int32(2), np.int32(0))
    key = key + select(z < 0.0, zero + np.int32(4), np.int32(0))
    key = key << np.int32(3 * grid.bits)
    for axis in range(3):
        key = key + (cell_of(o[axis], grid.low[axis], grid.scale[axis], grid.bits) << np.int32(axis))
    return key


@inlined
def begin_runs(order, n, ended):
    """Set where each key's run begins in the sorted order; return how many rays have not ended."""
    counts = order.counts
    for key in range(ended + 1):
        poke(counts, key, np.int32(0))
    for i in range(n):
        key = np.int64(peek(order.keys, i))
        poke(counts, key, np.int32(peek(counts, key) + np.int32(1)))
    total = np.int32(0)
    for key in range(ended + 1):
        here = peek(counts, key)
        poke(counts, key, total)
        total = np.int32(total + here)
    return np.int64(peek(counts, ended))


@inlined
def sort_alive(order, n, ended):
    """Sort the numbers of rays by their keys, those that have ended last; return how many have not."""
    sent = begin_runs(order, n, ended)
    for i in range(n):
        key = np.int64(peek(order.keys, i))
        at = np.int64(peek(order.counts, key))
        poke(order.counts, key, np.int32(at + 1))
        poke(order.numbers, at, np.int32(i))
    return sent


@inlined
def gather3(a, rows, size):
    """Components of rows of a structure of arrays."""
    return gather(a, rows), gather(a, rows + np.int32(size)), gather(a, rows + np.int32(2 * size))


@kernel
def pack_shadow_rays(incident, n, grid, order, out):
    """Copy the shadow rays that exist to ``out``, sorted by direction; return how many they are.

    ``order.numbers`` are their paths. Of ``out``, a Paths, origins and directions are set, and tmax as its ``pdf``.
    """
    like, size, width = packet(incident.tmax), len(incident.tmax), packet_width(incident.tmax)
    ended = DIRECTIONS << 3 * grid.bits
    for i in range(0, n, width):
        there = (load(incident.tmax, i, like) > 0.0) & (lane_numbers(like) < np.int32(n - i))
        store(order.keys, i, select(there, keys_of(incident, i, size, grid, like), np.int32(ended)))
    sent = sort_alive(order, n, ended)
    for i in range(0, sent, width):
        rows = load(order.numbers, i, splat_int(0, like))
        store3(out.rays.o, i, size, gather3(incident.o, rows, size))
        store3(out.rays.d, i, size, gather3(incident.d, rows, size))
        store(out.pdf, i, gather(incident.tmax, rows))
    return sent


@kernel
def add_light(paths, n, incident, order, radiance):
    """Add the light that nothing stopped, of n packed shadow rays."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        arrives = ~load(incident.occluded, i, like) & (lane_numbers(like) < np.int32(n - i))
        rows = load(order.numbers, i, splat_int(0, like))
        add(radiance, size, gather(paths.rays.slot, rows), gather3(incident.radiance, rows, size), arrives)


@kernel
def go_on(paths, n, depth, grid, order, out):
    """Copy the paths that go on to ``out``, sorted by direction; return how many they are.

    From the surface number ``ROULETTE_FROM`` on, a path survives with a probability of its largest throughput, without
    the factors of radiance in dense media, and is divided by it: the expectation is the same [Arvo1990].
    """
    like, size, width = packet(paths.pdf), len(paths.pdf), packet_width(paths.pdf)
    ended = DIRECTIONS << 3 * grid.bits
    for i in range(0, n, width):
        alive = ((load(paths.state, i, like) & np.int32(DEAD)) == np.int32(0)) & (lane_numbers(like) < np.int32(n - i))
        if depth >= ROULETTE_FROM:
            throughput, scale = load3(paths.throughput, i, size, like), load(paths.scale, i, like)
            largest = maximum(maximum(throughput[0], throughput[1]), throughput[2]) / scale
            chance = minimum(maximum(largest, splat(SURVIVE, like)), splat(1.0, like))
            alive = alive & (uniform(paths, i, depth, ROULETTE) < chance)
            store3(paths.throughput, i, size, scaled(throughput, 1.0 / chance))
        store(order.keys, i, select(alive, keys_of(paths.rays, i, size, grid, like), np.int32(ended)))
    sent = sort_alive(order, n, ended)
    for i in range(0, sent, width):
        rows = load(order.numbers, i, splat_int(0, like))
        store3(out.rays.o, i, size, gather3(paths.rays.o, rows, size))
        store3(out.rays.d, i, size, gather3(paths.rays.d, rows, size))
        store3(out.throughput, i, size, gather3(paths.throughput, rows, size))
        store(out.scale, i, gather(paths.scale, rows))
        store(out.pdf, i, gather(paths.pdf, rows))
        store(out.key, i, gather(paths.key, rows))
        store(out.sample, i, gather(paths.sample, rows))
        store(out.state, i, gather(paths.state, rows))
        store(out.rays.slot, i, gather(paths.rays.slot, rows))
    return sent
