"""Hits in the order of rays, t and prim_id."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.hit_work import HitWork
from raytrace.jit import inlined, kernel

FEW = 24  # hits of a ray up to which insertion sorts them fastest


class HitColumns(NamedTuple):
    """Hits of a range of rays, sorted by ray, t and prim_id."""

    t: NDArray[np.floating]
    prim_id: NDArray[np.int32]
    u: NDArray[np.floating]
    v: NDArray[np.floating]


@inlined
def exchange(hits: HitColumns, i: int, k: int):
    """Exchange two hits."""
    hits.t[i], hits.t[k] = hits.t[k], hits.t[i]
    hits.prim_id[i], hits.prim_id[k] = hits.prim_id[k], hits.prim_id[i]
    hits.u[i], hits.u[k] = hits.u[k], hits.u[i]
    hits.v[i], hits.v[k] = hits.v[k], hits.v[i]


@inlined
def before(hits: HitColumns, i: int, k: int):
    """Whether hit i comes before hit k."""
    return hits.t[i] < hits.t[k] or (hits.t[i] == hits.t[k] and hits.prim_id[i] < hits.prim_id[k])


@inlined
def sort_few(hits: HitColumns, begin: int, end: int):
    """Sort hits by insertion."""
    for i in range(begin + 1, end):
        k = i
        while k > begin and before(hits, k, k - 1):
            exchange(hits, k, k - 1)
            k -= 1


@inlined
def sink(hits: HitColumns, begin: int, root: int, size: int):
    """Move a hit down a heap, whose last hit by order is its root."""
    child = 2 * root + 1
    while child < size:
        if child + 1 < size and before(hits, begin + child, begin + child + 1):
            child += 1
        if before(hits, begin + child, begin + root):
            return
        exchange(hits, begin + root, begin + child)
        root, child = child, 2 * child + 1


@inlined
def sort_many(hits: HitColumns, begin: int, end: int):
    """Sort hits by a heap."""
    size = end - begin
    for root in range(size // 2 - 1, -1, -1):
        sink(hits, begin, root, size)
    for last in range(size - 1, 0, -1):
        exchange(hits, begin, begin + last)
        sink(hits, begin, 0, last)


@kernel
def place_hits(work: HitWork, found: int, numbers, ends, hits: HitColumns):
    """Write hits in the order of rays; ``numbers`` are those of the rays as they were traced.

    ``ends`` is where the hits of each ray begin, and afterwards where they end.
    """
    for i in range(found):
        ray = numbers[work.hit_ray[i]]
        at = ends[ray]
        ends[ray] = at + 1
        hits.t[at], hits.prim_id[at] = work.hit_t[i], work.hit_prim[i]
        hits.u[at], hits.v[at] = work.hit_u[i], work.hit_v[i]


@kernel
def sort_hits(begin: int, ends, hits: HitColumns):
    """Sort the hits of each of some rays by t and prim_id; those of the first ray begin at ``begin``."""
    for end in ends:
        if end - begin > FEW:
            sort_many(hits, begin, end)
        else:
            sort_few(hits, begin, end)
        begin = end
