"""Hits that were found in several leaves, because their triangle lies in several: each counts once."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.hit_work import MARKED, USED, HitWork
from raytrace.jit import inlined, kernel

if TYPE_CHECKING:
    from raytrace.accel.hit_lists import HitTracer, _Scratch


@inlined
def sink(keys, begin: int, root: int, size: int):
    """Move a key down a heap, whose largest key is its root."""
    child = 2 * root + 1
    while child < size:
        if child + 1 < size and keys[begin + child] < keys[begin + child + 1]:
            child += 1
        if keys[begin + child] <= keys[begin + root]:
            return
        keys[begin + root], keys[begin + child] = keys[begin + child], keys[begin + root]
        root, child = child, 2 * child + 1


@inlined
def sort(keys, begin: int, end: int):
    """Sort keys by a heap."""
    size = end - begin
    for root in range(size // 2 - 1, -1, -1):
        sink(keys, begin, root, size)
    for last in range(size - 1, 0, -1):
        keys[begin], keys[begin + last] = keys[begin + last], keys[begin]
        sink(keys, begin, 0, last)


@kernel
def unite(work: HitWork, counts, n: int, starts, keys, left):
    """Keep one of the hits of each ray and triangle; correct the counts of n rays.

    A ray meets a triangle in one point, whichever leaf it lies in, so these hits are equal. ``starts``: (n,), ``keys``:
    (k,) and ``left``: (k,) are int64 scratch memory for k hits. A key is a triangle and the place of the hit.
    """
    found, place = work.state[USED], 0
    for ray in range(n):
        starts[ray] = place
        place += counts[ray] & (MARKED - 1)
    for i in range(found):
        ray = work.hit_ray[i]
        keys[starts[ray]] = (np.int64(work.hit_prim[i]) << 32) | i
        starts[ray] += 1
        left[i] = 1
    begin = 0
    for ray in range(n):
        end = starts[ray]
        sort(keys, begin, end)
        for k in range(begin + 1, end):
            if keys[k] >> 32 == keys[k - 1] >> 32:
                left[keys[k] & 0xFFFFFFFF] = 0
                counts[ray] -= 1
        begin = end
    kept = 0
    for i in range(found):
        if left[i] != 0:
            work.hit_t[kept], work.hit_u[kept], work.hit_v[kept] = work.hit_t[i], work.hit_u[i], work.hit_v[i]
            work.hit_prim[kept], work.hit_ray[kept] = work.hit_prim[i], work.hit_ray[i]
            kept += 1
    work.state[USED] = kept


def count_united(
    tracer: "HitTracer", counts: NDArray[np.int32], rays: tuple[int, int], scratch: "_Scratch", most: int
) -> None:
    """Count the hits of a range of rays. They are listed for it: at most ``most`` at a time, or those of one ray.

    Where there are more, half of the rays are traced at a time.
    """
    begin, end = rays

    def room(found: int, _certain: bool) -> int:
        return found if found <= most or end - begin == 1 else 0

    if scratch.holds(tracer.trace(begin, end, scratch, room)):
        counts[begin:end] = scratch.ordered[: end - begin]
        return
    middle = (begin + end) // 2
    count_united(tracer, counts, (begin, middle), scratch, most)
    count_united(tracer, counts, (middle, end), scratch, most)
