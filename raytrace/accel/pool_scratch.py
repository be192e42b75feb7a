"""Scratch memory of a pool: the rays of a bundle, of which each is read and written on its own."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.box import Slabs
from raytrace.accel.bundle import BUNDLE
from raytrace.accel.lanes import NODE, PACKET, packet_width, peek, poke
from raytrace.accel.layout import aligned, integers
from raytrace.accel.octants import Axes
from raytrace.accel.scratch import FRAME, ROWS, SLABS
from raytrace.accel.stack import NOTHING
from raytrace.accel.triangle import RayFrame
from raytrace.jit import inlined
from raytrace.work_records import Work

# Rows of ``Work.pool_state``. A slot has as many rows as one of ``Work.lanes``, so that a ray has one place in both.
AXES = 0  # 6 rows, the fields of Axes
NEXT, TOP, BOTTOM, FOUND = 6, 7, 8, 9  # node or leaf to visit; height of the stack; its least height; triangle hit
PLACE = 10  # of the ray in ``Work.prim_id``

RAYS = BUNDLE * PACKET  # most rays of a pool
QUEUE = RAYS + 1  # elements of a queue: one more than there are rays, because every ray is written to both


def make_pool(height: int, dtype: np.dtype) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Allocate the arrays of a pool, with stacks of that height; a push writes a register, so each has room for one."""
    room = height + 1 + NODE
    child = np.empty(RAYS * room, integers(dtype))
    child[::room] = NOTHING  # below each stack
    state = aligned((BUNDLE + 1) * ROWS * PACKET, np.dtype(np.int32))
    return aligned(RAYS * room, dtype), child, state, np.empty(2 * QUEUE, np.int32)


def without_pool(work: Work) -> Work:
    """Return scratch memory without a pool, for calls of few rays."""
    empty = [a[:0] for a in (work.pool_t, work.pool_child, work.pool_state, work.pool_queue)]
    return work._replace(pool_t=empty[0], pool_child=empty[1], pool_state=empty[2], pool_queue=empty[3])


@inlined
def read_number(work: Work, f: int, row: int):
    """One number of ray f."""
    return peek(work.lanes, f + packet_width(work.lanes) * row)


@inlined
def write_number(work: Work, f: int, row: int, x):
    """Write one number of ray f."""
    poke(work.lanes, f + packet_width(work.lanes) * row, x)


@inlined
def read_state(work: Work, f: int, row: int):
    """One integer of ray f."""
    return np.int64(peek(work.pool_state, f + packet_width(work.lanes) * row))


@inlined
def write_state(work: Work, f: int, row: int, x: int):
    """Write one integer of ray f."""
    poke(work.pool_state, f + packet_width(work.lanes) * row, np.int32(x))


@inlined
def axes_of_ray(work: Work, f: int) -> Axes:
    """Octant and dominant axis of ray f."""
    return Axes(
        read_state(work, f, AXES), read_state(work, f, AXES + 1), read_state(work, f, AXES + 2),
        read_state(work, f, AXES + 3), read_state(work, f, AXES + 4), read_state(work, f, AXES + 5),
    )  # fmt: skip


@inlined
def slabs_of_ray(work: Work, f: int) -> Slabs:
    """Slabs of ray f."""
    return Slabs(
        read_number(work, f, SLABS), read_number(work, f, SLABS + 1), read_number(work, f, SLABS + 2),
        read_number(work, f, SLABS + 3), read_number(work, f, SLABS + 4), read_number(work, f, SLABS + 5),
        read_number(work, f, SLABS + 6), read_number(work, f, SLABS + 7), read_number(work, f, SLABS + 8),
        read_number(work, f, SLABS + 9), read_number(work, f, SLABS + 10), read_number(work, f, SLABS + 11),
    )  # fmt: skip


@inlined
def frame_of_ray(work: Work, f: int) -> RayFrame:
    """Frame of ray f."""
    return RayFrame(
        read_number(work, f, FRAME), read_number(work, f, FRAME + 1), read_number(work, f, FRAME + 2),
        read_number(work, f, FRAME + 3), read_number(work, f, FRAME + 4), read_number(work, f, FRAME + 5),
        read_number(work, f, FRAME + 6), read_number(work, f, FRAME + 7), read_number(work, f, FRAME + 8),
    )  # fmt: skip
