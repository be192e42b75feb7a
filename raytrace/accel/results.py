"""Write the results of a bundle from scratch memory to the arrays of a batch."""

import numpy as np

from raytrace.accel.batches import BLOCK, Pixels, corner, form, in_pixels, is_whole
from raytrace.accel.lanes import (
    bits,
    compress,
    group_size,
    lane_numbers,
    load_block,
    mask_of,
    packet,
    packet_width,
    select,
    store,
    store_block,
)
from raytrace.accel.scratch import HIT_T, HIT_U, HIT_V, OCCLUDED, ROWS, SCALE, read_prim_id, read_row
from raytrace.jit import inlined, specialised
from raytrace.records import Hits
from raytrace.work_records import Work


@inlined
def write(a, i: int, n: int, x):
    """Write a register to elements i, i + 1, ... of an array of length n, as far as it goes."""
    if i + packet_width(a) <= n:
        store(a, i, x)
    else:
        compress(a, i, lane_numbers(x) < np.int32(n - i), x)


@inlined
def write_hits_of_row(hits: Hits, i: int, n: int, count: int, work: Work):
    like, width = packet(work.lanes), packet_width(work.lanes)
    for r in range(count):
        at, prim = i + r * width, read_prim_id(work, r, like)
        found, scale = prim >= 0, read_row(work, r, SCALE, like)
        write(hits.t, at, n, select(found, read_row(work, r, HIT_T, like) / scale, np.inf))
        write(hits.prim_id, at, n, prim)
        write(hits.u, at, n, select(found, read_row(work, r, HIT_U, like), 0.0))
        write(hits.v, at, n, select(found, read_row(work, r, HIT_V, like), 0.0))


@inlined
def write_occluded_of_row(occluded, i: int, n: int, count: int, work: Work):
    like, width = packet(work.lanes), packet_width(work.lanes)
    for r in range(count):
        at, hit = i + r * width, read_row(work, r, OCCLUDED, like) > 0.0
        if at + width <= n:
            store(occluded, at, hit)
            continue
        left = bits(hit)
        for k in range(n - at):
            occluded[at + k] = left >> k & 1


# --- blocks of pixels: whole rows of a bundle, so that each cache line is written once --------------------------------


@inlined
def is_whole_bundle(i: int, n: Pixels, count: int, work: Work) -> bool:
    """Whether a bundle has four rows of pixels, each as wide as a packet, which all lie in the image."""
    at, width = corner(i, n), packet_width(work.lanes)
    return width >= BLOCK and count == group_size(work.lanes) and at.x + width <= n.width and at.y + BLOCK <= n.height


@inlined
def row_of_bundle(a, width: int, y: int, slot: int, row: int, like):
    """Row y of pixels of a bundle, from one row of each of its slots in scratch memory; slots have so many rows."""
    place = BLOCK * y  # within the first block, whose packets have their rows one after the other
    first = (1 + place // width) * slot * width + row * width + place % width
    return load_block(a, first, max(BLOCK**2 // width, 1) * slot * width, like)


@inlined
def write_hits_of_pixels(hits: Hits, i: int, n: Pixels, count: int, work: Work):
    like, width = packet(work.lanes), packet_width(work.lanes)
    if is_whole_bundle(i, n, count, work):
        at = corner(i, n)
        for y in range(BLOCK):
            first = (at.y + y) * n.width + at.x
            prim = row_of_bundle(work.prim_id, width, y, 1, 0, like)
            found, scale = prim >= 0, row_of_bundle(work.lanes, width, y, ROWS, SCALE, like)
            store(hits.t, first, select(found, row_of_bundle(work.lanes, width, y, ROWS, HIT_T, like) / scale, np.inf))
            store(hits.prim_id, first, prim)
            store(hits.u, first, select(found, row_of_bundle(work.lanes, width, y, ROWS, HIT_U, like), 0.0))
            store(hits.v, first, select(found, row_of_bundle(work.lanes, width, y, ROWS, HIT_V, like), 0.0))
        return
    for r in range(count):
        prim = read_prim_id(work, r, like)
        found, scale = prim >= 0, read_row(work, r, SCALE, like)
        write_block(hits.t, i + r * width, n, select(found, read_row(work, r, HIT_T, like) / scale, np.inf), width)
        write_block(hits.prim_id, i + r * width, n, prim, width)
        write_block(hits.u, i + r * width, n, select(found, read_row(work, r, HIT_U, like), 0.0), width)
        write_block(hits.v, i + r * width, n, select(found, read_row(work, r, HIT_V, like), 0.0), width)


@inlined
def write_block(a, i: int, n: Pixels, x, width: int):
    """Write a register to the elements of an array that belong to the rays of a packet."""
    at = corner(i, n)
    first = at.y * n.width + at.x
    if is_whole(at, n, width):
        store_block(a, first, n.width, x)
        return
    inside, rows = in_pixels(i, n, x), lane_numbers(x) >> np.int32(2)
    for k in range(min(BLOCK, n.height - at.y)):
        compress(a, first + k * n.width, inside & (rows == np.int32(k)), x)


@inlined
def occluded_in_row(y: int, work: Work) -> int:
    """Bits of the rays of row y of pixels of a bundle that hit anything."""
    like, width = packet(work.lanes), packet_width(work.lanes)
    first, shift, found = BLOCK * y // width, BLOCK * y % width, 0
    for block in range(width // BLOCK):
        hit = bits(read_row(work, first + block * max(BLOCK**2 // width, 1), OCCLUDED, like) > 0.0)
        found |= (hit >> shift & (1 << BLOCK) - 1) << BLOCK * block
    return found


@inlined
def write_occluded_of_pixels(occluded, i: int, n: Pixels, count: int, work: Work):
    like, width = packet(work.lanes), packet_width(work.lanes)
    if is_whole_bundle(i, n, count, work):
        at = corner(i, n)
        for y in range(BLOCK):
            store(occluded, (at.y + y) * n.width + at.x, mask_of(occluded_in_row(y, work), like))
        return
    for r in range(count):
        at, left = corner(i + r * width, n), bits(read_row(work, r, OCCLUDED, like) > 0.0)
        for k in range(width):
            x, y = at.x + k % BLOCK, at.y + k // BLOCK
            if x < n.width and y < n.height:
                occluded[y * n.width + x] = left >> k & 1


# --- either -----------------------------------------------------------------------------------------------------------


def write_hits(hits: Hits, i: int, n, count: int, work: Work):
    """Write the hits of a bundle of ``count`` packets that begins at place i of a batch."""
    form(n, write_hits_of_row, write_hits_of_pixels)(hits, i, n, count, work)


@specialised(write_hits)
def _write_hits(hits, i, n, count, work):
    chosen = form(n, write_hits_of_row, write_hits_of_pixels)
    return lambda hits, i, n, count, work: chosen(hits, i, n, count, work)


def write_occluded(occluded, i: int, n, count: int, work: Work):
    """Write which rays are occluded, of a bundle of ``count`` packets that begins at place i of a batch."""
    form(n, write_occluded_of_row, write_occluded_of_pixels)(occluded, i, n, count, work)


@specialised(write_occluded)
def _write_occluded(occluded, i, n, count, work):
    chosen = form(n, write_occluded_of_row, write_occluded_of_pixels)
    return lambda occluded, i, n, count, work: chosen(occluded, i, n, count, work)
