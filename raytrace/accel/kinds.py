"""Rays of one kind: all with the same signs and the same dominant axis, so that they see boxes and triangles alike."""

from typing import NamedTuple

from raytrace.accel.box import Slabs
from raytrace.accel.lanes import absolute, bits, load, packet_width, peek, poke, store
from raytrace.accel.triangle import Frame
from raytrace.jit import inlined

SLABS, FRAME, TMIN, HIT = 0, 12, 21, 22  # rows of scratch memory; HIT: t (at first tmax), u, v
RAW = SLABS  # of a bundle's packets, which need no slabs: o, d, scale
ROWS = 25


class Axes(NamedTuple):
    """Where the planes and vertices of rays of one kind stand in a node and a leaf."""

    near_x: int  # first of the eight planes that face the rays; the far ones are the others
    near_y: int
    near_z: int
    x: int  # first of the eight x, y, z of a vertex, the dominant axis of the rays last
    y: int
    z: int


class RayPacket(NamedTuple):
    """Rays of one kind: lanes for a packet, numbers for a single ray."""

    slabs: Slabs
    frame: Frame
    axes: Axes
    tmin: float


@inlined
def kinds_of(d):
    """Bits of the lanes that are negative in x, y, z, and whose dominant axis is x, or else y."""
    ax, ay, az = absolute(d[0]), absolute(d[1]), absolute(d[2])
    on_x = (ax >= ay) & (ax >= az)
    return bits(d[0] < 0.0), bits(d[1] < 0.0), bits(d[2] < 0.0), bits(on_x), bits(~on_x & (ay >= az))


@inlined
def same_kind(kinds, k):
    """Bits of the lanes that have the signs and the dominant axis of lane k."""
    same = -1
    for flags in kinds:
        same &= flags if flags >> k & 1 else ~flags
    return same


@inlined
def kind_of(kinds, k):
    """Dominant axis and axes of the ray in lane k."""
    dominant = 0 if kinds[3] >> k & 1 else 1 if kinds[4] >> k & 1 else 2
    axes = Axes(
        24 if kinds[0] >> k & 1 else 0, 32 if kinds[1] >> k & 1 else 8, 40 if kinds[2] >> k & 1 else 16,
        8 * ((dominant + 1) % 3), 8 * ((dominant + 2) % 3), 8 * dominant,
    )  # fmt: skip
    return dominant, axes


@inlined
def permute(dominant, a):
    """Components with the dominant one last."""
    if dominant == 0:
        return a[1], a[2], a[0]
    if dominant == 1:
        return a[2], a[0], a[1]
    return a


@inlined
def make_frame(dominant, o, d, scale):
    """Frame of rays that share their dominant axis."""
    ox, oy, oz = permute(dominant, o)
    dx, dy, dz = permute(dominant, d)
    return Frame(ox, oy, oz, dx, dy, dz, -(dx / dz), -(dy / dz), scale)


@inlined
def put(work, first, numbers):
    """Write registers to scratch memory, a row each, so that each lane may be read on its own."""
    for x in numbers:
        store(work.lanes, first * packet_width(work.lanes), x)
        first += 1


@inlined
def row(work, number, like):
    """A row of scratch memory."""
    return load(work.lanes, number * packet_width(work.lanes), like)


@inlined
def slot(r):
    """First row of packet r of a bundle; the rows before the first slot are for rays that go on alone."""
    return (r + 1) * ROWS


@inlined
def put_number(work, number, k, x):
    """Write lane k of a row of scratch memory."""
    poke(work.lanes, number * packet_width(work.lanes) + k, x)


@inlined
def number_of(work, row, k):
    """Lane k of a row of scratch memory."""
    return peek(work.lanes, row * packet_width(work.lanes) + k)


@inlined
def put_rays(work, rays):
    """Write a packet to scratch memory."""
    put(work, SLABS, rays.slabs)
    put(work, FRAME, rays.frame)
    put(work, TMIN, (rays.tmin,))


@inlined
def ray_of(work, axes, k):
    """The ray in lane k of a packet that was written to scratch memory."""
    slabs = Slabs(
        number_of(work, 0, k), number_of(work, 1, k), number_of(work, 2, k), number_of(work, 3, k),
        number_of(work, 4, k), number_of(work, 5, k), number_of(work, 6, k), number_of(work, 7, k),
        number_of(work, 8, k), number_of(work, 9, k), number_of(work, 10, k), number_of(work, 11, k),
    )  # fmt: skip
    frame = Frame(
        number_of(work, 12, k), number_of(work, 13, k), number_of(work, 14, k), number_of(work, 15, k),
        number_of(work, 16, k), number_of(work, 17, k), number_of(work, 18, k), number_of(work, 19, k),
        number_of(work, 20, k),
    )  # fmt: skip
    return RayPacket(slabs, frame, axes, number_of(work, 21, k))


@inlined
def hits_row(work, r):
    """Where the prim_id of packet r of a bundle stand; those before are for rays that go on alone."""
    return (r + 1) * packet_width(work.lanes)


@inlined
def frame_of(work, r, like):
    """Frame of packet r of a bundle."""
    at = slot(r) + FRAME
    return Frame(
        row(work, at, like), row(work, at + 1, like), row(work, at + 2, like),
        row(work, at + 3, like), row(work, at + 4, like), row(work, at + 5, like),
        row(work, at + 6, like), row(work, at + 7, like), row(work, at + 8, like),
    )  # fmt: skip
