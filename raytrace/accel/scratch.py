"""Scratch memory of a traversal: packets of rays and their hits, one register per row.

A slot of ``ROWS`` rows holds one packet. The first slot, ``ALONE``, holds the packet whose rays are traced one by one:
each lane of its rows is read on its own. The slots after it hold the packets of a bundle.
"""

from typing import NamedTuple

from raytrace.accel.box import Slabs
from raytrace.accel.lanes import load, packet_width, peek, poke, store
from raytrace.accel.octants import Axes, RayPacket
from raytrace.accel.triangle import RayFrame
from raytrace.jit import inlined
from raytrace.work_records import Work

ALONE = -1  # number of the first slot; slot r >= 0 holds packet r of a bundle

# Rows of a slot. The packets of a bundle need no slabs, so they keep their origins and directions in those rows.
SLABS = 0  # 12 rows, the fields of Slabs
ORIGIN, DIRECTION = 0, 3  # x, y, z; x, y, z
FRAME = 12  # 9 rows, the fields of RayFrame
FRAME_X, FRAME_Z, FRAME_DZ, FRAME_SX = FRAME, FRAME + 2, FRAME + 5, FRAME + 6  # those of them that are read alone
SCALE = FRAME + 8  # the power of two that the direction was divided by
TMIN = 21
HIT_T, HIT_U, HIT_V = 22, 23, 24  # t of the nearest hit so far (tmax before the first one); then its u, v
TMAX, OCCLUDED = HIT_T, HIT_U  # in any-hit queries: tmax, -inf once anything is hit; then 1 if it is, else 0
ROWS = 26  # the last one is used by queries for all hits


class BundleRays(NamedTuple):
    """Rays of one packet, in the units of their scaled directions; lanes."""

    o: tuple  # x, y, z
    d: tuple  # x, y, z: the user's direction divided by ``scale``
    scale: float
    tmin: float  # inf for rays that cannot hit
    tmax: float  # -inf for rays that cannot hit


@inlined
def read_row(work: Work, slot: int, row: int, like):
    """One row of a slot."""
    return load(work.lanes, ((slot + 1) * ROWS + row) * packet_width(work.lanes), like)


@inlined
def write_rows(work: Work, slot: int, row: int, registers):
    """Write registers to a slot, from one row on."""
    at = (slot + 1) * ROWS + row
    for x in registers:
        store(work.lanes, at * packet_width(work.lanes), x)
        at += 1


@inlined
def read_prim_id(work: Work, slot: int, like):
    """Numbers of the triangles that the packet in a slot has hit; -1: none."""
    return load(work.prim_id, (slot + 1) * packet_width(work.lanes), like)


@inlined
def write_prim_id(work: Work, slot: int, prim_id):
    """Write the numbers of the triangles that the packet in a slot has hit."""
    store(work.prim_id, (slot + 1) * packet_width(work.lanes), prim_id)


@inlined
def read_frame(work: Work, slot: int, like) -> RayFrame:
    """Frame of the packet in a slot."""
    return RayFrame(
        read_row(work, slot, FRAME, like), read_row(work, slot, FRAME + 1, like), read_row(work, slot, FRAME + 2, like),
        read_row(work, slot, FRAME + 3, like), read_row(work, slot, FRAME + 4, like),
        read_row(work, slot, FRAME + 5, like), read_row(work, slot, FRAME + 6, like),
        read_row(work, slot, FRAME + 7, like), read_row(work, slot, FRAME + 8, like),
    )  # fmt: skip


@inlined
def read_bundle_rays(work: Work, slot: int, like) -> BundleRays:
    """Rays of packet ``slot`` of a bundle."""
    return BundleRays(
        (
            read_row(work, slot, ORIGIN, like), read_row(work, slot, ORIGIN + 1, like),
            read_row(work, slot, ORIGIN + 2, like),
        ),
        (
            read_row(work, slot, DIRECTION, like), read_row(work, slot, DIRECTION + 1, like),
            read_row(work, slot, DIRECTION + 2, like),
        ),
        read_row(work, slot, SCALE, like), read_row(work, slot, TMIN, like), read_row(work, slot, TMAX, like),
    )  # fmt: skip


@inlined
def write_packet(work: Work, packet: RayPacket):
    """Write a packet to the first slot, so that its rays can be read one by one."""
    write_rows(work, ALONE, SLABS, packet.slabs)
    write_rows(work, ALONE, FRAME, packet.frame)
    write_rows(work, ALONE, TMIN, (packet.tmin,))


@inlined
def read_lane(work: Work, row: int, k: int):
    """Lane k of a row of the first slot."""
    return peek(work.lanes, row * packet_width(work.lanes) + k)


@inlined
def write_lane(work: Work, row: int, k: int, x):
    """Write lane k of a row of the first slot."""
    poke(work.lanes, row * packet_width(work.lanes) + k, x)


@inlined
def read_ray(work: Work, axes: Axes, k: int) -> RayPacket:
    """The single ray in lane k of the packet in the first slot."""
    slabs = Slabs(
        read_lane(work, SLABS, k), read_lane(work, SLABS + 1, k), read_lane(work, SLABS + 2, k),
        read_lane(work, SLABS + 3, k), read_lane(work, SLABS + 4, k), read_lane(work, SLABS + 5, k),
        read_lane(work, SLABS + 6, k), read_lane(work, SLABS + 7, k), read_lane(work, SLABS + 8, k),
        read_lane(work, SLABS + 9, k), read_lane(work, SLABS + 10, k), read_lane(work, SLABS + 11, k),
    )  # fmt: skip
    frame = RayFrame(
        read_lane(work, FRAME, k), read_lane(work, FRAME + 1, k), read_lane(work, FRAME + 2, k),
        read_lane(work, FRAME + 3, k), read_lane(work, FRAME + 4, k), read_lane(work, FRAME + 5, k),
        read_lane(work, FRAME + 6, k), read_lane(work, FRAME + 7, k), read_lane(work, FRAME + 8, k),
    )  # fmt: skip
    return RayPacket(slabs, frame, axes, read_lane(work, TMIN, k))
