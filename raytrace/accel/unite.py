"""Hits that were found in several leaves, because their triangle lies in several: each counts once."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.hit_work import MARKED
from raytrace.jit import kernel

if TYPE_CHECKING:
    from raytrace.accel.hit_lists import HitColumns, HitTracer, _Scratch


@kernel
def unite(hits: "HitColumns", counts):
    """Keep one of the hits of each ray and triangle, correct the counts of the rays, and return how many are kept.

    A ray meets a triangle in one point, whichever leaf it lies in. So these hits are equal, and neighbours once they
    are sorted.
    """
    begin = kept = 0
    for ray in range(len(counts)):
        end = begin + (counts[ray] & (MARKED - 1))
        for k in range(begin, end):
            if k > begin and hits.prim_id[k] == hits.prim_id[k - 1]:
                counts[ray] -= 1
            else:
                hits.t[kept], hits.prim_id[kept] = hits.t[k], hits.prim_id[k]
                hits.u[kept], hits.v[kept] = hits.u[k], hits.v[k]
                kept += 1
        begin = end
    return kept


def count_united(
    tracer: "HitTracer", counts: NDArray[np.int32], rays: tuple[int, int], scratch: "_Scratch", most: int
) -> None:
    """Count the hits of a range of rays. They are listed for it: at most ``most`` at a time, or those of one ray.

    Where there are more, half of the rays are traced at a time.
    """
    begin, end = rays

    def room(found: int, _certain: bool) -> int:
        return found if found <= most or end - begin == 1 else 0

    found = tracer.trace(begin, end, scratch, room)
    if scratch.holds(found):
        counts[begin:end] = scratch.ordered[: end - begin]
        tracer.sorted_hits(scratch, found, counts[begin:end])
        return
    middle = (begin + end) // 2
    count_united(tracer, counts, (begin, middle), scratch, most)
    count_united(tracer, counts, (middle, end), scratch, most)
