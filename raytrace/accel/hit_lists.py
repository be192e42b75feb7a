"""All hits of a batch of rays as flat arrays: ranges of rays on threads, each into memory of its own, then joined."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace import memory
from raytrace.accel import reorder
from raytrace.accel.all_hits import all_crossings, all_hits
from raytrace.accel.exact_crossing import decide
from raytrace.accel.hit_work import MARKED, ON_SURFACE, PAIRS, USED, HitWork, make_hit_work
from raytrace.accel.inputs import Field, rays_of
from raytrace.accel.lanes import PACKET
from raytrace.accel.line_order import lines_in_order
from raytrace.accel.undecided import decide_pairs
from raytrace.errors import MemoryLimitError
from raytrace.jit import inlined, kernel
from raytrace.parallel import MAX_RANGE, share_out
from raytrace.records import AllHits, WatertightLeaves

if TYPE_CHECKING:
    from raytrace.accel.ray_queries import RayQueries

FEW = 24  # hits of a ray up to which insertion sorts them fastest
FIRST_HITS, FIRST_PAIRS = 4.0, 0.125  # per ray: memory for the first rays
MARGIN = 1.25  # more memory than the rays so far have needed
HIT = 28  # most bytes of a hit
UNCHECKED = 1 << 26  # bytes of hits for which the free memory is not looked up
KEPT = 0.3  # share of the free memory that the hits of one range may take before they are sorted


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
def sort_hits(work: HitWork, found: int, numbers, ends, hits: HitColumns):
    """Write hits in the order of rays, t and prim_id.

    ``numbers`` are those of the rays as they were traced. ``ends`` is where the hits of each ray begin, and afterwards
    where they end.
    """
    for i in range(found):
        ray = numbers[work.hit_ray[i]]
        at = ends[ray]
        ends[ray] = at + 1
        hits.t[at], hits.prim_id[at] = work.hit_t[i], work.hit_prim[i]
        hits.u[at], hits.v[at] = work.hit_u[i], work.hit_v[i]
    begin = 0
    for end in ends:
        if end - begin > FEW:
            sort_many(hits, begin, end)
        else:
            sort_few(hits, begin, end)
        begin = end


class HitTracer:
    """Traces ranges of rays for one query. Each thread takes scratch memory from it."""

    def __init__(self, bvh: "RayQueries", fields: list[Field], n: int, crossings: bool, surface: bool = False) -> None:
        self._bvh, self._fields, self._kernel = bvh, fields, all_crossings if crossings else all_hits
        leaves = WatertightLeaves(*bvh.tree.leaves) if crossings else bvh.tree.leaves  # the same memory in every tree
        self._tree = bvh.tree._replace(leaves=leaves)
        self.dtype, self._rows, self._surface = bvh.triangles.dtype, min(MAX_RANGE, n), surface
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
        sort_hits(scratch.hits, found, scratch.numbers, np.cumsum(numbers, dtype=np.int64) - numbers, hits)
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


def list_all(tracer: HitTracer, n: int, threads: int | None) -> AllHits:
    """Find the hits of n rays.

    Raises
    ------
    MemoryLimitError
        There are too many; the message has their number.
    """
    start, lists = np.zeros(n + 1, np.int64), _Lists()

    def trace(begin: int, end: int) -> None:
        scratch = tracer.take()
        found = tracer.trace(begin, end, scratch, lists.room)
        counts = scratch.ordered[: end - begin]
        if lists.add(found):
            lists.parts[begin] = tracer.sorted_hits(scratch, found, counts)
        start[begin + 1 : end + 1] = counts
        tracer.give(scratch)

    share_out(trace, n, threads)
    np.cumsum(start, out=start)
    return AllHits(*lists.joined(int(start[n]), tracer.dtype), start)


class _Lists:
    """The hits of all ranges of rays, as long as there is memory for them."""

    def __init__(self) -> None:
        self.parts: dict[int, HitColumns] = {}  # by first ray
        self.full, self._taken, self._turn = False, 0, threading.Lock()

    def room(self, found: int, certain: bool) -> int:
        """Return for how many hits of a range there must be memory: all, or none if there is not enough.

        If it is not certain that there are so many, too little memory is no reason to give up.
        """
        much = found * HIT > UNCHECKED and found * HIT > memory.free() * KEPT
        self.full = self.full or (much and certain)
        return 0 if much or self.full else found

    def add(self, found: int) -> bool:
        """Note hits of a range; return whether they can be kept."""
        with self._turn:
            self._taken += found * HIT
            if not self.full and self._taken > UNCHECKED:
                self.full = found * HIT + self._taken > memory.free()
            if self.full:
                self.parts.clear()
            return not self.full

    def joined(self, found: int, dtype: np.dtype) -> HitColumns:
        """Return all hits, as one."""
        if self.full:
            needed = memory.size(float(found * (3 * dtype.itemsize + 4)))
            raise MemoryLimitError(
                f"memory: {found:,} hits take {needed}, and as much again while they are joined, but "
                f"{memory.size(memory.free())} are free; pass fewer rays at a time, or a smaller tmax"
            )
        parts = [self.parts[begin] for begin in sorted(self.parts)]
        if len(parts) == 1:
            return parts[0]
        t, u, v = np.empty((3, found), dtype)
        hits, at = HitColumns(t, np.empty(found, np.int32), u, v), 0
        for part in parts:
            for whole, column in zip(hits, part, strict=True):
                whole[at : at + len(column)] = column
            at += len(part.t)
        return hits
