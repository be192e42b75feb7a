"""Scratch memory of queries for all hits: that of a traversal, the hits found so far, and rows for exact decisions."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.batches import read
from raytrace.accel.expansions import TERMS, VECTOR
from raytrace.accel.lanes import (
    PACKET,
    absolute,
    count,
    first_bit,
    lane_numbers,
    machine_epsilon,
    machine_largest,
    maximum,
    packet,
    packet_width,
    peek,
    poke,
    select,
    splat_int,
    store_packed,
)
from raytrace.accel.scratch import (
    HIT_U,
    HIT_V,
    TMIN,
    read_bundle_rays,
    read_prim_id,
    write_prim_id,
    write_rows,
)
from raytrace.jit import inlined
from raytrace.records import Rays, Tree
from raytrace.work_records import Work

# Rows of the slots of a bundle, which need neither u nor v
USER_TMIN, USER_TMAX = HIT_V, HIT_V + 1  # as given; for rays that cannot hit, inf and -inf
REACH = HIT_U  # bound on the distances from the origin to all vertices along the axes; inf: products could overflow

USED, FIRST, PAIRS, ON_SURFACE = range(4)  # places in ``state``: hits and pairs found, also those for which there
# was no memory; the first ray of the bundle; whether to find rays that start on the surface
MARKED = 1 << 30  # bit of a ray's count: its origin lies on the surface
SLACK = 512.0  # machine epsilons of ``REACH``: more than the rounding error of a distance (docs/numerics.md)


class HitWork(NamedTuple):
    """Scratch memory of one thread. The first ten fields are those of ``Work``; ``prim_id`` holds the rays' counts."""

    t: NDArray[np.floating]
    child: NDArray[np.int32]
    alive: NDArray[np.int32]
    lanes: NDArray[np.floating]
    prim_id: NDArray[np.int32]
    counts: NDArray[np.int64]
    pool_t: NDArray[np.floating]
    pool_child: NDArray[np.signedinteger]
    pool_state: NDArray[np.int32]
    pool_queue: NDArray[np.int32]
    hit_t: NDArray[np.floating]  # (k,) f: of the hits found so far, in any order
    hit_u: NDArray[np.floating]
    hit_v: NDArray[np.floating]
    hit_prim: NDArray[np.int32]
    hit_ray: NDArray[np.int32]
    state: NDArray[
        np.int64
    ]  # hits found, also those beyond k; first ray of the bundle; pairs; whether origins are tested
    exact: NDArray[np.float64]  # vectors and expansions
    pair_ray: NDArray[np.int32]  # (p,): rays and triangles that need exact arithmetic
    pair_prim: NDArray[np.int32]


def make_hit_work(work: Work, hits: int, pairs: int = 0) -> HitWork:
    """Allocate scratch memory for so many hits and pairs."""
    dtype = work.lanes.dtype
    room = hits + PACKET
    floats, numbers = np.empty((3, room), dtype), np.empty((2, room), np.int32)
    exact = np.zeros(4 * VECTOR + 5 * TERMS)
    return HitWork(*work, *floats, *numbers, np.zeros(4, np.int64), exact, *np.empty((2, pairs + PACKET), np.int32))


class Interval(NamedTuple):
    """Open interval in which hits count, in the user's units; lanes for a packet, numbers for one ray."""

    tmin: float
    tmax: float


@inlined
def write_user_rows(tree: Tree, rays: Rays, i: int, n: int, packets: int, work: HitWork):
    """Write the rows of a bundle that queries for all hits need, and widen the interval of the traversal.

    A hit counts by its rounded distance. Boxes hold exact hits, so they are tested in an interval that is longer by
    more than the rounding error of a distance. Then an interval never loses a hit that its rounded t would keep.
    """
    size = 0.0
    for axis in range(3):
        size = max(size, max(-peek(tree.extent, axis), peek(tree.extent, 3 + axis)))
    for r in range(packets):
        like = packet(work.lanes)
        o, d, _, tmin, tmax = read_bundle_rays(work, r, like)
        at, alive = i + r * packet_width(work.lanes), tmin < tmax
        user_tmin, user_tmax = read(rays.tmin, at, 0, n, like), read(rays.tmax, at, 0, n, like)
        reach = maximum(maximum(absolute(o[0]), absolute(o[1])), absolute(o[2])) + size
        longest = maximum(maximum(absolute(d[0]), absolute(d[1])), absolute(d[2]))
        slack = reach * (SLACK * machine_epsilon(work.lanes)) / longest
        tmax = select(user_tmax == np.inf, np.inf, tmax)
        write_rows(work, r, USER_TMIN, (select(alive, user_tmin, np.inf), select(alive, user_tmax, -np.inf)))
        write_rows(work, r, TMIN, (select(alive, tmin - slack, np.inf), select(alive, tmax + slack, -np.inf)))
        safe = reach * reach < machine_largest(work.lanes) * 0.0625  # no product of two differences overflows
        write_rows(work, r, REACH, (select(safe, reach, np.inf),))
        write_prim_id(work, r, splat_int(0, like))


@inlined
def keep_of_packet(found, crossing, number: int, r: int, work: HitWork):
    """Count the rays of packet r that hit a triangle, and append their hits."""
    _, t, u, v = crossing
    like = t
    hits = read_prim_id(work, r, like)
    write_prim_id(work, r, select(found, hits + np.int32(1), hits))
    used, more = work.state[USED], count(found)
    work.state[USED] = used + more
    if used + more + PACKET <= len(work.hit_t):
        first = np.int32(work.state[FIRST] + r * packet_width(work.lanes))
        store_packed(work.hit_t, used, found, t)
        store_packed(work.hit_u, used, found, u)
        store_packed(work.hit_v, used, found, v)
        store_packed(work.hit_prim, used, found, splat_int(np.int32(number), like))
        store_packed(work.hit_ray, used, found, lane_numbers(like) + first)


@inlined
def keep_of_ray(left: int, crossing, prim_id, at: int, place: int, work: HitWork):
    """Count the triangles ``left`` (bits) of a leaf that one ray hits, and append the hits.

    ``place`` is the place of the ray in ``prim_id`` of the scratch memory.
    """
    _, t, u, v = crossing
    ray = work.state[FIRST] + place - packet_width(work.lanes)
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        poke(work.prim_id, place, peek(work.prim_id, place) + np.int32(1))
        used = work.state[USED]
        work.state[USED] = used + 1
        if used + 1 + PACKET <= len(work.hit_t):
            poke(work.hit_t, used, t[k])
            poke(work.hit_u, used, u[k])
            poke(work.hit_v, used, v[k])
            poke(work.hit_prim, used, np.int32(peek(prim_id, at + k)))
            poke(work.hit_ray, used, np.int32(ray))


@inlined
def keep_one(t, u, v, prim: int, ray: int, work: HitWork):
    """Append one hit."""
    used = work.state[USED]
    work.state[USED] = used + 1
    if used + 1 + PACKET <= len(work.hit_t):
        work.hit_t[used], work.hit_u[used], work.hit_v[used] = t, u, v
        work.hit_prim[used], work.hit_ray[used] = prim, ray


@inlined
def note_packet(undecided, number: int, r: int, work: HitWork):
    """Note the rays of packet r, and a triangle, as pairs to decide."""
    used, more = work.state[PAIRS], count(undecided)
    work.state[PAIRS] = used + more
    if used + more + PACKET <= len(work.pair_ray):
        rays = lane_numbers(packet(work.lanes)) + np.int32(work.state[FIRST] + r * packet_width(work.lanes))
        store_packed(work.pair_ray, used, undecided, rays)
        store_packed(work.pair_prim, used, undecided, splat_int(np.int32(number), packet(work.lanes)))


@inlined
def note_ray(left: int, prim_id, at: int, place: int, work: HitWork):
    """Note one ray, and the triangles ``left`` (bits) of a leaf, as pairs to decide; see ``keep_of_ray``."""
    ray = work.state[FIRST] + place - packet_width(work.lanes)
    while left != 0:
        k = first_bit(left)
        left &= left - 1
        number, used = np.int32(peek(prim_id, at + k)), work.state[PAIRS]
        if number >= 0:
            work.state[PAIRS] = used + 1
            if used + 1 + PACKET <= len(work.pair_ray):
                work.pair_ray[used], work.pair_prim[used] = ray, number


@inlined
def within(crossing, interval: Interval):
    """Mask of the crossings that lie in an interval, by their rounded t."""
    return crossing.inside & (crossing.t > interval.tmin) & (crossing.t < interval.tmax)
