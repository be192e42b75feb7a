"""How the rays of a batch fall into packets: one after the other, or as blocks of 4 x 4 pixels of an image.

A kernel's argument ``n`` chooses the order. A number n stands for n rays; a packet has neighbouring ones. ``Pixels``
stands for the rays of an image, numbered row by row; a packet has those of a block, or of some rows of it. So rays of
an image are traced as coherently as a renderer's, and read and written where they lie. Kernels number the rays in the
order of tracing; their numbers are places. Blocks at the edges of an image are padded with lanes that cannot hit. The
results do not depend on the order.
"""

import math
from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import (
    gather,
    lane_numbers,
    load,
    load_block,
    load_block_rows,
    load_rows,
    packet_width,
    prefetch,
    select,
    splat,
)
from raytrace.jit import inlined, specialised
from raytrace.parallel import GRAIN
from raytrace.records import Columns

BLOCK = 4  # pixels: side of a block
AHEAD = 64  # pixels: several rows at once are more than the processor brings into the cache in advance by itself
ROW = 2**32  # places from one row of blocks to the next, so that a place tells its pixel without a division
MOST = 1.25  # lanes per ray: images that need more padding are traced as rows


class Pixels(NamedTuple):
    """Rays of an image, in C order, to be traced in blocks of 4 x 4 pixels."""

    width: int
    height: int


class Corner(NamedTuple):
    """The first pixel of a packet."""

    x: int
    y: int


def image_width(shape: tuple[int, ...], limit: int) -> int:
    """Return the width of images whose rays are to be traced in blocks, or 0: trace them one after the other.

    All leading axes but the last are rows. A row of blocks has at most ``limit`` rays. Blocks are not used where images
    are so narrow or low that padding costs more than coherence gains.
    """
    if len(shape) < 2 or 0 in shape or BLOCK * shape[-1] > limit:
        return 0
    width, height = shape[-1], math.prod(shape[:-1])
    lanes = -(-width // BLOCK) * -(-height // BLOCK) * BLOCK**2
    return width if lanes <= MOST * width * height else 0


def whole_blocks(width: int) -> int:
    """Return the rays of which a thread takes a multiple: whole rows of blocks of images of that width, if any."""
    return BLOCK * width * max(GRAIN // (BLOCK * width), 1) if width else GRAIN


# --- rays one after the other -----------------------------------------------------------------------------------------


@inlined
def read_from_row(columns: Columns, i: int, axis: int, n: int, like):
    """Component ``axis`` of rays i, i + 1, ...; lanes beyond the last ray repeat it."""
    at = columns.start + axis * columns.axis
    if columns.row == 0:
        return splat(columns.data[at], like)
    if columns.row == 1 and i + packet_width(columns.data) <= n:
        return load(columns.data, at + i, like)
    rows = lane_numbers(like) + np.int32(i)
    return pick(columns, select(rows < np.int32(n), rows, np.int32(n - 1)), axis)


@inlined
def read_vectors_from_row(columns: Columns, i: int, n: int, like):
    """x, y, z of rays i, i + 1, ...; lanes beyond the last ray repeat it."""
    if columns.row == 3 and columns.axis == 1 and i + packet_width(columns.data) <= n:
        return load_rows(columns.data, columns.start + 3 * i, like)
    return (
        read_from_row(columns, i, 0, n, like),
        read_from_row(columns, i, 1, n, like),
        read_from_row(columns, i, 2, n, like),
    )


@inlined
def in_row(i: int, n: int, like):
    """Mask of the lanes that hold rays."""
    return lane_numbers(like) < np.int32(n - i)


@inlined
def left_of_row(i: int, n: int) -> int:
    return n - i


@inlined
def after_in_row(i: int, step: int, n: int) -> int:
    return i + step


# --- blocks of pixels -------------------------------------------------------------------------------------------------


@inlined
def corner(i: int, n: Pixels) -> Corner:
    """The first pixel of the packet that begins at place i."""
    lane = i & (ROW - 1)
    return Corner((lane >> 4 << 2) + (lane & 3), (i >> 32 << 2) + (lane >> 2 & 3))


@inlined
def is_whole(at: Corner, n: Pixels, width: int) -> bool:
    """Whether a packet of that width lies in the image; packets have rows of at most four pixels."""
    return at.x + min(width, BLOCK) <= n.width and at.y + (width + BLOCK - 1) // BLOCK <= n.height


@inlined
def read_from_pixels(columns: Columns, i: int, axis: int, n: Pixels, like):
    """Component ``axis`` of the rays of a packet; lanes beyond the image repeat its last row or column."""
    begin = columns.start + axis * columns.axis
    if columns.row == 0:
        return splat(columns.data[begin], like)
    at = corner(i, n)
    if columns.row == 1 and is_whole(at, n, packet_width(columns.data)):
        return load_block(columns.data, begin + at.y * n.width + at.x, n.width, like)
    x = (lane_numbers(like) & np.int32(BLOCK - 1)) + np.int32(at.x)
    y = (lane_numbers(like) >> np.int32(2)) + np.int32(at.y)
    x = select(x < np.int32(n.width), x, np.int32(n.width - 1))
    y = select(y < np.int32(n.height), y, np.int32(n.height - 1))
    return pick(columns, y * np.int32(n.width) + x, axis)


@inlined
def read_vectors_from_pixels(columns: Columns, i: int, n: Pixels, like):
    """x, y, z of the rays of a packet; lanes beyond the image repeat its last row or column."""
    if columns.row == 3 and columns.axis == 1:
        at = corner(i, n)
        if is_whole(at, n, packet_width(columns.data)):
            first = columns.start + 3 * (at.y * n.width + at.x)
            for y in range((packet_width(columns.data) + BLOCK - 1) // BLOCK):
                prefetch(columns.data, first + 3 * (y * n.width + AHEAD))
                prefetch(columns.data, first + 3 * (y * n.width + AHEAD + 2))
            return load_block_rows(columns.data, first, 3 * n.width, like)
    return (
        read_from_pixels(columns, i, 0, n, like),
        read_from_pixels(columns, i, 1, n, like),
        read_from_pixels(columns, i, 2, n, like),
    )


@inlined
def in_pixels(i: int, n: Pixels, like):
    """Mask of the lanes that hold rays."""
    at = corner(i, n)
    x, y = lane_numbers(like) & np.int32(BLOCK - 1), lane_numbers(like) >> np.int32(2)
    return (x < np.int32(n.width - at.x)) & (y < np.int32(n.height - at.y))


@inlined
def left_of_pixels(i: int, n: Pixels) -> int:
    lanes = (n.width + BLOCK - 1) // BLOCK * BLOCK**2
    return lanes - (i & (ROW - 1)) if (i >> 32) * BLOCK < n.height else 0


@inlined
def after_in_pixels(i: int, step: int, n: Pixels) -> int:
    return i + step if step < left_of_pixels(i, n) else ((i >> 32) + 1) * ROW


# --- either -----------------------------------------------------------------------------------------------------------


@inlined
def pick(columns: Columns, rows, axis: int):
    """Component ``axis`` of the rays whose numbers are ``rows``."""
    return gather(columns.data, rows * np.int32(columns.row) + np.int32(columns.start + axis * columns.axis))


def form(n, of_row, of_pixels):
    """The form of a function for a batch, or for the Numba type of one."""
    return of_pixels if isinstance(n, Pixels) or getattr(n, "instance_class", None) is Pixels else of_row


def read(columns: Columns, i: int, axis: int, n, like):
    """Component ``axis`` of the rays of the packet that begins at place i."""
    return form(n, read_from_row, read_from_pixels)(columns, i, axis, n, like)


@specialised(read)
def _read(columns, i, axis, n, like):
    chosen = form(n, read_from_row, read_from_pixels)
    return lambda columns, i, axis, n, like: chosen(columns, i, axis, n, like)


def read_vectors(columns: Columns, i: int, n, like):
    """x, y, z of the rays of the packet that begins at place i."""
    return form(n, read_vectors_from_row, read_vectors_from_pixels)(columns, i, n, like)


@specialised(read_vectors)
def _read_vectors(columns, i, n, like):
    chosen = form(n, read_vectors_from_row, read_vectors_from_pixels)
    return lambda columns, i, n, like: chosen(columns, i, n, like)


def in_batch(i: int, n, like):
    """Mask of the lanes that hold rays, of the packet that begins at place i."""
    return form(n, in_row, in_pixels)(i, n, like)


@specialised(in_batch)
def _in_batch(i, n, like):
    chosen = form(n, in_row, in_pixels)
    return lambda i, n, like: chosen(i, n, like)


def left(i: int, n) -> int:
    """Number of lanes that follow without a gap from place i on; 0 after the last packet of a batch."""
    return form(n, left_of_row, left_of_pixels)(i, n)


@specialised(left)
def _left(i, n):
    chosen = form(n, left_of_row, left_of_pixels)
    return lambda i, n: chosen(i, n)


def after(i: int, step: int, n) -> int:
    """The place after a bundle of ``step`` lanes at place i."""
    return form(n, after_in_row, after_in_pixels)(i, step, n)


@specialised(after)
def _after(i, step, n):
    chosen = form(n, after_in_row, after_in_pixels)
    return lambda i, step, n: chosen(i, step, n)
