"""Exact answers about all hits of rays, their crossings of closed meshes, and points inside; faults in other answers.

Inside is decided by another rule than in the kernels: a line in random direction meets only interiors of triangles, or
another direction is taken. Its crossings are counted in integer arithmetic.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.hardcases.judge import BACKWARD
from raytrace.hardcases.meshes import uniform
from raytrace.hardcases.oracle import INTERIOR, Index, Oracle
from raytrace.records import AllHits

Flags = NDArray[np.bool_]

OUTSIDE, INSIDE, SURFACE = range(3)


def inside_exactly(corners: ArrayLike, points: ArrayLike, seed: int = 1) -> NDArray[np.int8]:
    """Return OUTSIDE, INSIDE (an odd number of crossings) or SURFACE for each of n points and a closed mesh.

    >>> side = [[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 0, 0], [0, 0, 4], [4, 0, 0]], [[0, 0, 0], [0, 4, 0], [0, 0, 4]]
    >>> inside_exactly([*side, [[4, 0, 0], [0, 0, 4], [0, 4, 0]]], [[1, 1, 1], [2, 2, 2], [1, 1, 2]]).tolist()
    [1, 0, 2]
    """
    places = np.asarray(points, np.float64).reshape(-1, 3)
    state, left = np.full(len(places), -1, np.int8), np.arange(len(places))
    while len(left):
        oracle = Oracle(corners, places[left], uniform(seed, len(left), 3))
        c, many = oracle.crossings, np.bincount(oracle.group, minlength=len(oracle.corners))
        sense = oracle.ahead(c.ray, c.prim)
        ahead, on = sense > 0, np.bincount(c.ray[sense == 0], minlength=len(left)) > 0
        unclear = np.bincount(c.ray[ahead & (c.kind != INTERIOR)], minlength=len(left)) > 0
        odd = np.bincount(c.ray[ahead], many[oracle.group[c.prim[ahead]]], len(left)) % 2 == 1
        state[left] = np.where(on, SURFACE, np.where(unclear, -1, np.where(odd, INSIDE, OUTSIDE)))
        left, seed = left[~on & unclear], seed + 1
    return state


class Faults(NamedTuple):
    """Numbers of faults in the answers to rays."""

    parity: int  # rays from outside or inside whose number of crossings has the wrong parity
    lost: int  # hits that are missing: crossings of interiors; or hits that no rounding of vertices can move away
    false: int  # hits that do not exist: of closed triangles; or hits that are far from their triangle
    order: int  # hits out of order, or the same triangle twice
    t_error: float  # largest error of t, in units of its bound


class HitJudge:
    """Compute what n rays meet exactly, and find faults in other answers.

    Parameters
    ----------
    corners : (m, 3, 3) float array
        Vertices of the triangles, in the precision of the answers.
    o, d : (n, 3) float arrays
        Finite rays, in the same precision.
    """

    def __init__(self, corners: NDArray[np.floating], o: NDArray[np.floating], d: NDArray[np.floating]) -> None:
        self.n, self.m, self.dtype = len(o), len(corners), o.dtype
        self.oracle = Oracle(corners, o, d)
        self._corners, self._o = corners, o
        c, group = self.oracle.crossings, self.oracle.group
        members = np.argsort(group, kind="stable")  # of every group of identical triangles, one after the other
        many = np.bincount(group, minlength=len(self.oracle.corners))
        begin, here = np.cumsum(many) - many, group[c.prim]
        row = np.repeat(np.arange(len(c.ray)), many[here])
        nth = np.arange(len(row)) - np.repeat(np.cumsum(many[here]) - many[here], many[here])
        prim = members[begin[here][row] + nth]
        order = np.lexsort((prim, c.ray[row]))
        self.row, self.key = row[order], (c.ray[row] * self.m + prim)[order]  # every pair that crosses, in order
        self.ahead = self.oracle.ahead(c.ray, c.prim)
        length = np.sqrt((d.astype(np.float64) ** 2).sum(axis=1))
        self.slack = BACKWARD * float(np.finfo(o.dtype).eps) * self.oracle.reach(c.ray, c.prim)
        self.t_slack = self.slack / (c.cosine * length[c.ray])

    def sides(self) -> NDArray[np.int8]:
        """OUTSIDE, INSIDE or SURFACE of each origin."""
        return inside_exactly(self._corners, self._o)

    def _matched(self, hits: AllHits) -> tuple[Index, Index, Flags, Index]:
        """Rays and keys of hits; whether each pair crosses; and its row in the crossings."""
        ray = np.repeat(np.arange(self.n), np.diff(hits.start))
        key = ray * self.m + hits.prim_id
        if not len(self.key):
            return ray, key, np.zeros(len(key), bool), np.zeros(len(key), np.intp)
        at = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        return ray, key, self.key[at] == key, self.row[at]

    def _disorder(self, hits: AllHits, ray: Index, key: Index) -> int:
        """Number of hits that are out of order, or there twice."""
        same, t, prim = np.diff(ray) == 0, np.diff(hits.t.astype(np.float64)), np.diff(hits.prim_id)
        return int((same & ((t < 0) | ((t == 0) & (prim <= 0)))).sum()) + len(key) - len(np.unique(key))

    def _t_error(self, hits: AllHits, exists: Flags, row: Index) -> float:
        exact = self.oracle.crossings.t[row[exists]]
        bound = self.t_slack[row[exists]] + np.finfo(self.dtype).eps * np.abs(exact) + np.finfo(self.dtype).tiny
        return float(np.max(np.abs(hits.t[exists] - exact) / bound, initial=0.0))

    def of_crossings(self, hits: AllHits, closed: bool = True) -> Faults:
        """Faults in crossings beyond tmin = 0: all interiors, once, and of edges and vertices only what exists."""
        c = self.oracle.crossings
        ray, key, exists, row = self._matched(hits)
        lost = ~np.isin(self.key, key) & (c.kind[self.row] == INTERIOR) & (self.ahead[self.row] > 0)
        false = ~exists
        false[exists] = self.ahead[row[exists]] <= 0
        parity = 0
        if closed:
            sides = self.sides()
            parity = int(((np.diff(hits.start) % 2 == 1) != (sides == INSIDE))[sides != SURFACE].sum())
        order = self._disorder(hits, ray, key)
        return Faults(parity, int(lost.sum()), int(false.sum()), order, self._t_error(hits, exists, row))

    def of_hits(self, hits: AllHits) -> Faults:
        """Faults in all hits beyond tmin = 0, within the bound of the watertight test."""
        c, (ray, key, exists, row) = self.oracle.crossings, self._matched(hits)
        clear = (c.edge.min(axis=1, initial=np.inf) > self.slack) & (c.t > self.t_slack)
        lost = ~np.isin(self.key, key) & clear[self.row]
        prim, t = hits.prim_id.astype(np.intp), hits.t.astype(np.float64)
        bound = BACKWARD * float(np.finfo(self.dtype).eps) * self.oracle.reach(ray, prim)
        false = self.oracle.distance(ray, prim, t) > bound
        order = self._disorder(hits, ray, key)
        return Faults(0, int(lost.sum()), int(false.sum()), order, self._t_error(hits, exists, row))
