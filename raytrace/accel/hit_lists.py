"""All hits of a batch of rays as flat arrays: ranges of rays on threads, each into memory of its own, then joined."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raytrace import memory
from raytrace.accel import reorder
from raytrace.accel.all_hits import all_crossings, all_hits
from raytrace.accel.exact_crossing import decide
from raytrace.accel.hit_work import MARKED, ON_SURFACE, PAIRS, USED, make_hit_work
from raytrace.accel.inputs import Field, rays_of
from raytrace.accel.lanes import PACKET
from raytrace.accel.line_order import lines_in_order
from raytrace.accel.sort_hits import HitColumns, place_hits, sort_hits
from raytrace.accel.undecided import decide_pairs
from raytrace.errors import MemoryLimitError
from raytrace.parallel import MAX_RANGE, share_out
from raytrace.records import AllHits, WatertightLeaves

if TYPE_CHECKING:
    from raytrace.accel.ray_queries import RayQueries

FIRST_HITS, FIRST_PAIRS = 4.0, 0.125  # per ray: memory for the first rays
MARGIN = 1.25  # more memory than the rays so far have needed
HIT = 28  # most bytes of a hit
UNCHECKED = 1 << 26  # bytes of hits for which the free memory is not looked up
KEPT = 0.3  # share of the free memory that the hits of one range may take before they are sorted
MANY, DENSE = 1 << 23, 4096  # hits of rays, and of each on average, from which fewer rays are traced at a time
TOGETHER = 1 << 20  # hits that are sorted without a break, so that Ctrl-C takes effect soon


class HitTracer:
    """Traces ranges of rays for one query. Each thread takes scratch memory from it."""

    def __init__(self, bvh: "RayQueries", fields: list[Field], n: int, crossings: bool, surface: bool = False) -> None:
        self._bvh, self._fields, self._kernel = bvh, fields, all_crossings if crossings else all_hits
        leaves = WatertightLeaves(*bvh.tree.leaves) if crossings else bvh.tree.leaves  # the same memory in every tree
        self._tree = bvh.tree._replace(leaves=leaves)
        self.dtype, self._rows, self._surface = bvh.triangles.dtype, min(MAX_RANGE, n), surface
        self.halted = False  # whether an error or Ctrl-C has ended the query
        self.divided = bvh.divided  # whether a triangle may be hit in several leaves
        self._unused: list[_Scratch] = []
        self._hits, self._pairs = FIRST_HITS, FIRST_PAIRS  # per ray, for which there is memory before they are traced

    def take(self) -> "_Scratch":
        """Return scratch memory that no other thread uses."""
        return self._unused.pop() if self._unused else _Scratch(self._bvh, self._rows)

    def give(self, scratch: "_Scratch") -> None:
        """Return scratch memory."""
        self._unused.append(scratch)

    def trace(self, begin: int, end: int, scratch: "_Scratch", room: Callable[[int, bool], int]) -> int:
        """Trace rays ``begin`` to ``end``; return the number of their hits, which are in scratch memory then.

        ``room`` returns for how many hits there must be memory where there are, certainly or perhaps, as many as its
        argument. Rays for whose hits there was too little are traced again.
        """
        bvh, n = self._bvh, end - begin
        given = rays_of(self._fields, begin, end, self.dtype)
        numbers, rays = lines_in_order(bvh.tree, bvh.grid, given, n, scratch.sort)
        scratch.numbers = scratch.identity if numbers is None else numbers
        scratch.enlarge(room(int(n * self._hits), False), int(n * self._pairs))
        while True:
            work = scratch.hits
            work.state[ON_SURFACE] = self._surface
            self._kernel(self._tree, rays, scratch.counts, n, work)
            pairs = int(work.state[PAIRS])
            if not scratch.enlarge(room(int(work.state[USED]) + pairs, True), pairs):
                break
        self._hits = max(self._hits, MARGIN * (int(work.state[USED]) + pairs) / n)
        self._pairs = max(self._pairs, MARGIN * pairs / n)
        if pairs:
            decide(bvh.triangles.ravel(), rays, scratch.counts, work)
        if work.state[PAIRS]:
            decide_pairs(bvh, rays, scratch.counts, work)
        reorder.give_back(scratch.counts, n, scratch.numbers, scratch.ordered)
        return int(work.state[USED])

    def sorted_hits(self, scratch: "_Scratch", found: int, counts: NDArray[np.int32]) -> HitColumns:
        """Return the hits of the last rays, sorted, each once; correct their counts, which are in the order given."""
        t, u, v = np.empty((3, found), self.dtype)
        hits, numbers = HitColumns(t, np.empty(found, np.int32), u, v), counts & (MARKED - 1)
        ends = np.cumsum(numbers, dtype=np.int64) - numbers
        place_hits(scratch.hits, found, scratch.numbers, ends, hits)
        begin = 0
        while begin < len(ends) and not self.halted:
            at = ends[begin - 1] if begin else 0
            last = max(int(np.searchsorted(ends, at + TOGETHER, "right")), begin + 1)
            sort_hits(int(at), ends[begin:last], hits)
            begin = last
        if not self.divided:
            return hits
        from raytrace.accel.unite import unite  # few trees need it

        kept = unite(hits, counts)
        return HitColumns(*(column[:kept] for column in hits))


class _Scratch:
    """Scratch memory of one thread."""

    def __init__(self, bvh: "RayQueries", rows: int) -> None:
        work = bvh.pool_work()
        self.sort = reorder.make_sort_scratch(rows, bvh.triangles.dtype, work)
        self.hits = make_hit_work(work, 0)
        self.counts, self.ordered = np.empty((2, rows), np.int32)  # of hits: in the order of tracing, and as given
        self.identity = np.arange(rows, dtype=np.int32)
        self.numbers = self.identity  # of the rays as they were traced

    def enlarge(self, hits: int, pairs: int) -> bool:
        """Make room for so many hits and pairs; return whether there was too little."""
        room, pair_room = len(self.hits.hit_t) - PACKET, len(self.hits.pair_ray) - PACKET
        if hits <= room and pairs <= pair_room:
            return False
        self.hits = make_hit_work(self.sort.work, max(hits, room), max(pairs, pair_room))
        return True

    def holds(self, hits: int) -> bool:
        """Whether there is room for so many hits."""
        return hits <= len(self.hits.hit_t) - PACKET


def count_all(tracer: HitTracer, n: int, threads: int | None) -> NDArray[np.int32]:
    """Count the hits of n rays."""
    counts = np.empty(n, np.int32)

    def trace(begin: int, end: int) -> None:
        scratch = tracer.take()
        if tracer.divided:
            from raytrace.accel.unite import count_united  # few trees need it

            count_united(tracer, counts, (begin, end), scratch, UNCHECKED // HIT)
        else:
            tracer.trace(begin, end, scratch, lambda _found, _certain: 0)
            counts[begin:end] = scratch.ordered[: end - begin]
        tracer.give(scratch)

    share_out(trace, n, threads)
    return counts


def crowded(found: int, rays: int) -> bool:
    """Whether rays have so many hits that fewer are traced at a time, so that Ctrl-C takes effect soon."""
    return rays > 1 and found > MANY and found > DENSE * rays


def list_all(tracer: HitTracer, n: int, threads: int | None) -> AllHits:
    """Find the hits of n rays.

    Raises
    ------
    MemoryLimitError
        There are too many; the message has the number that was found until then.
    """
    start, lists = np.zeros(n + 1, np.int64), _Lists(n, tracer)

    def trace(begin: int, end: int) -> None:
        scratch = tracer.take()
        rays = end - begin

        def room(found: int, certain: bool) -> int:
            return 0 if crowded(found, rays) else lists.room(found, certain)

        try:
            found = tracer.trace(begin, end, scratch, room)
            if crowded(found, rays):
                lists.look_ahead(found, rays, end, scratch)
                tracer.give(scratch)
                step = rays * MANY // found or 1
                for first in range(begin, end, step):
                    if not tracer.halted:
                        trace(first, min(first + step, end))
                return
            counts = scratch.ordered[:rays]
            lists.add(found, rays)
            lists.parts[begin] = tracer.sorted_hits(scratch, found, counts)
        except BaseException:
            tracer.halted = True
            raise
        start[begin + 1 : end + 1] = counts
        tracer.give(scratch)

    share_out(trace, n, threads)
    np.cumsum(start, out=start)
    return AllHits(*lists.joined(int(start[n])), start)


class _Lists:
    """The hits of all ranges of rays, as long as there is memory for them."""

    def __init__(self, n: int, tracer: HitTracer) -> None:
        self.parts: dict[int, HitColumns] = {}  # by first ray
        self._n, self._tracer, self._dtype, self._ahead = n, tracer, tracer.dtype, False
        self._full, self._found, self._rays, self._turn = False, 0, 0, threading.Lock()

    def room(self, found: int, certain: bool) -> int:
        """Return for how many hits of a range there must be memory: all, or none if there is not enough.

        If it is not certain that there are so many, too little memory is no reason to give up.
        """
        much = found * HIT > UNCHECKED and found * HIT > memory.free() * KEPT
        self._full = self._full or (much and certain)
        return 0 if much or self._full else found

    def look_ahead(self, found: int, rays: int, end: int, scratch: _Scratch) -> None:
        """Raise an error if rays with many hits, and those from ``end`` on, have more than there is memory for.

        To count hits takes a thirtieth of the time to list them.
        """
        if self._ahead:
            return
        self._ahead, most = True, memory.free() / HIT
        total, first = found, end
        while total <= most and first < self._n:
            last = min(first + rays, self._n)
            total += self._tracer.trace(first, last, scratch, lambda _found, _certain: 0)
            first = last
        if total > most:
            self._full = True
            self.add(total, first - end + rays)

    def add(self, found: int, rays: int) -> None:
        """Note hits of a range of rays; raise an error if they cannot be kept."""
        with self._turn:
            self._found += found
            self._rays += rays
            if not self._full and self._found * HIT > UNCHECKED:
                self._full = found * HIT + self._found * HIT > memory.free()
            if self._full:
                self.parts.clear()
                self._refuse()

    def _refuse(self) -> None:
        """Raise the error that there are too many hits."""
        at_most = "at most " * self._tracer.divided  # a hit counts once per leaf that holds a part of its triangle
        needed = (3 * self._dtype.itemsize + 4) * self._found / max(self._rays, 1) * self._n
        raise MemoryLimitError(
            f"memory: {self._rays:,} of {self._n:,} rays have {at_most}{self._found:,} hits; those of all take about "
            f"{memory.size(needed)}, and as much again while they are joined, but {memory.size(memory.free())} are "
            f"free; pass fewer rays at a time, or a smaller tmax"
        )

    def joined(self, found: int) -> HitColumns:
        """Return all hits, as one."""
        parts = [self.parts[begin] for begin in sorted(self.parts)]
        if len(parts) == 1:
            return parts[0]
        t, u, v = np.empty((3, found), self._dtype)
        hits, at = HitColumns(t, np.empty(found, np.int32), u, v), 0
        for part in parts:
            for whole, column in zip(hits, part, strict=True):
                whole[at : at + len(column)] = column
            at += len(part.t)
        return hits
