"""Check the answers of a ray tracer against exact ones, and measure the errors of t, u and v.

An answer is checked by its backward error. It is right if it is the exact answer for some scene in which every vertex
is within 32 eps x distance of its position. Here eps is the machine epsilon of the precision, and distance is the
distance from the ray's origin to the farthest vertex of the triangle. So a hit is wrong if the point o + t d is farther
than that from the triangle. A miss is wrong if the ray passes farther than that inside the triangle's outline.

A vertex moves together with all its triangles. Consider a ray that passes close to an edge or a vertex whose triangles
all face it, or all face away from it. It crosses one of them, however the vertices move: to miss them all is a leak.
To leave a closed mesh without a hit is a leak too. At an outline (an edge of one triangle, or of two that face
differently) a miss is allowed only within the bound. Triangles without area are never hit.
"""

from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.hardcases.oracle import Doubles, Index, Oracle
from raytrace.records import Hits

Flags = NDArray[np.bool_]

BACKWARD = 32  # machine epsilons times distance
PATCHES = 1024  # examined together
WELL_SEEN = 8  # t is well-conditioned if distance <= WELL_SEEN x the distance from origin to the triangle's plane ...
WELL_SHAPED = 64  # ... and u, v if distance <= WELL_SHAPED x the least height of the triangle seen along the ray


class RayQuery(NamedTuple):
    """Rays and a mesh, rounded to one precision, and what must hold for the answers."""

    vertices: NDArray[np.floating]  # (v, 3), world units
    faces: Index  # (m, 3)
    o: NDArray[np.floating]  # (n, 3), world units
    d: NDArray[np.floating]  # (n, 3)
    tmin: NDArray[np.floating]  # (n,) units of d
    tmax: NDArray[np.floating]  # (n,) units of d
    inside: Flags  # (n,): the ray starts inside a closed mesh and must hit it
    tied: bool  # equal distances are exactly equal: the lowest prim_id of the nearest triangles must be returned


class Verdict(NamedTuple):
    """Errors in the answers to n rays."""

    wrong: Flags  # (n,): a hit or miss that the exact answer contradicts
    leak: Flags  # (n,): the ray passed between triangles that share an edge or vertex, or left a closed mesh
    t_error: float  # largest relative error of t over well-conditioned hits; NaN: there are none
    uv_error: float  # largest error of u or v over well-conditioned hits; NaN: there are none


def merged(verdicts: Iterable[Verdict]) -> Verdict:
    """Merge verdicts on several answers to the same rays: a ray is right only if all its answers are."""
    wrong, leak, t_errors, uv_errors = zip(*verdicts, strict=True)
    t, uv = (np.fmax.reduce(errors) for errors in (t_errors, uv_errors))  # NaN: none
    return Verdict(np.any(wrong, axis=0), np.any(leak, axis=0), float(t), float(uv))


class Judge:
    """Compute the exact answers to a query, and check other answers against them.

    Parameters
    ----------
    query : RayQuery

    Examples
    --------
    >>> floor = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])
    >>> ray = np.array([[1.0, 1, 3]]), np.array([[0.0, 0, -4]])
    >>> judge = Judge(RayQuery(*floor, *ray, np.zeros(1), np.full(1, np.inf), np.zeros(1, bool), False))
    >>> judge.hits(Hits(np.array([0.75]), np.array([0]), np.array([0.25]), np.array([0.25]))).wrong
    array([False])
    >>> judge.hits(Hits(np.array([np.inf]), np.array([-1]), np.zeros(1), np.zeros(1))).wrong
    array([ True])
    """

    def __init__(self, query: RayQuery) -> None:
        self.query = query
        self.oracle = Oracle(query.vertices[query.faces], query.o, query.d)
        info = np.finfo(query.o.dtype)
        self._bound = BACKWARD * float(info.eps)
        self._tmin, self._tmax = query.tmin.astype(np.float64), query.tmax.astype(np.float64)
        c = self.crossings = self.oracle.crossings
        with np.errstate(all="ignore"):  # from rays that are not finite
            d = np.abs(query.d.astype(np.float64))
            longest = d.max(axis=1, initial=0.0)
            self._length = longest * np.sqrt(((d / longest[:, None]) ** 2).sum(axis=1))
            self._slack = self._bound * self.oracle.reach(c.ray, c.prim) / (c.cosine * self._length[c.ray])  # in t
        self._finite = np.isfinite(self._length) & (self._length > 0) & np.isfinite(query.o).all(axis=1)
        within = (c.t > self._tmin[c.ray]) & (c.t < self._tmax[c.ray])
        surely = (c.t - self._slack > self._tmin[c.ray]) & (c.t + self._slack < self._tmax[c.ray])
        self._surrounds = np.full(len(c.ray), -1, np.int8)  # -1: not computed yet
        self._within, self._required = within, surely & (c.t + self._slack < info.max)

    # --- nearest hits ---

    def hits(self, hits: Hits) -> Verdict:
        """Check nearest hits; a miss has prim_id -1."""
        t, prim = np.asarray(hits.t, np.float64), np.asarray(hits.prim_id, np.int64)
        found = (prim >= 0) & (prim < len(self.query.faces)) & np.isfinite(t)
        missed, leak = self._missed(np.where(found, t, np.inf))
        row = np.flatnonzero(found)
        false = ~found & (prim != -1)
        false[row] = self._implausible(row, prim[row], t[row])
        leak &= ~false  # a ray with an invalid hit is wrong, not a leak
        return Verdict((missed | false) & ~leak, leak, *self._errors(hits))

    def _pairs(self, ray: Index, prim: Index) -> tuple[Flags, Index]:
        """Whether each pair of ray and triangle crosses, and its row in the crossings."""
        c, m = self.crossings, len(self.query.faces)
        if not len(c.ray):
            return np.zeros(len(ray), bool), np.zeros(len(ray), np.intp)
        keys = c.ray * m + c.prim
        searched = ray * m + self.oracle.first[self.oracle.group[prim]]
        at = np.minimum(np.searchsorted(keys, searched), len(keys) - 1)
        return keys[at] == searched, at

    def _implausible(self, ray: Index, prim: Index, t: Doubles) -> Flags:
        """Mark hits that are off their triangle, outside the interval, or on a triangle without area."""
        low, high = self._tmin[ray], self._tmax[ray]
        bad = ~((low < high) & (low <= t) & (t <= high)) | ~self._finite[ray] | ~self.oracle.has_area(prim)
        reach = self.oracle.reach(ray, prim)
        sure, at = self._pairs(ray, prim)  # for these, a small distance along the ray is sufficient
        length = self._length[ray]
        with np.errstate(all="ignore"):
            off = np.abs(t[sure] - self.crossings.t[at[sure]]) * length[sure]
            sure[sure] = off <= self._bound * reach[sure]
            bad |= ~sure & ~(np.abs(t) * length <= 4 * reach)
        rest = np.flatnonzero(~sure & ~bad)
        bad[rest] = self.oracle.distance(ray[rest], prim[rest], t[rest]) > self._bound * reach[rest]
        return bad

    def lowest(self) -> Index:
        """Lowest prim_id of the nearest triangles of each ray; -1: none. Exact where ``query.tied`` is true."""
        c = self.crossings
        lowest = np.full(len(self.query.o), -1)
        order = np.lexsort((c.prim, c.t, c.ray))
        order = order[self._within[order]]
        rays, first = np.unique(c.ray[order], return_index=True)
        lowest[rays] = c.prim[order[first]]
        return lowest

    def _errors(self, hits: Hits) -> tuple[float, float]:
        """Largest errors of well-conditioned hits: relative error of t, absolute error of u and v."""
        prim = np.asarray(hits.prim_id, np.int64)
        row = np.flatnonzero((prim >= 0) & (prim < len(self.query.faces)) & self._finite)
        crosses, at = self._pairs(row, prim[row])
        row, at = row[crosses], at[crosses]
        c = self.crossings
        reach, distance = self.oracle.reach(row, c.prim[at]), np.abs(c.t[at]) * self._length[row]
        seen, shaped = reach <= WELL_SEEN * distance * c.cosine[at], reach <= WELL_SHAPED * c.height[at]
        t, u, v = (np.asarray(column, np.float64)[row] for column in (hits.t, hits.u, hits.v))
        t_error = np.abs(t - c.t[at])[seen] / np.abs(c.t[at])[seen]
        uv_error = np.maximum(np.abs(u - c.u[at]), np.abs(v - c.v[at]))[shaped]
        return tuple(float(error.max()) if len(error) else np.nan for error in (t_error, uv_error))  # type: ignore[return-value]

    # --- misses ---

    def _missed(self, t: Doubles) -> tuple[Flags, Flags]:
        """Rays that missed a triangle before their answer t, and those that passed between neighbours (leaks)."""
        c = self.crossings
        pairs = np.flatnonzero(self._required & (t[c.ray] > c.t + self._slack))
        near = c.edge[pairs] <= (self._bound * self.oracle.reach(c.ray[pairs], c.prim[pairs]))[:, None]
        wrong, leak = np.zeros((2, len(t)), bool)
        wrong[c.ray[pairs[~near.any(axis=1)]]] = True
        doubtful = pairs[near.any(axis=1)]
        new = doubtful[self._surrounds[doubtful] < 0]
        for i in range(0, len(new), PATCHES):
            self._surrounds[new[i : i + PATCHES]] = self._surrounded(new[i : i + PATCHES])
        leak[c.ray[doubtful[self._surrounds[doubtful] == 1]]] = True
        lost = c.ray[pairs]
        leak[lost[self.query.inside[lost] & (t[lost] == np.inf)]] = True
        return wrong, leak

    def _surrounded(self, pairs: Index) -> Flags:
        """Whether each ray crosses a patch of neighbours with equal facing, farther than the bound from its rim."""
        m, ray, prim = len(self.query.faces), self.crossings.ray[pairs], self.crossings.prim[pairs]
        side = self.oracle.facing(ray, prim)
        extent = float(np.sqrt((np.ptp(self.query.vertices.astype(np.float64), axis=0) ** 2).sum()))
        held = self._bound * self.oracle.reach(ray, prim) < extent  # else the bound is larger than the whole mesh
        known = np.zeros((len(pairs), m), bool)  # the patch of each pair
        known[np.flatnonzero(held), prim[held]] = True
        number, face = np.nonzero(known)  # triangles added in the last step
        while len(number):
            alike = self.oracle.facing(ray[number], face) == side[number]
            reach = self.oracle.reach(ray[number], face)
            close = self._beside(ray[number], face) <= self._bound * reach[:, None]
            behind = self._neighbours[face]
            held[number[~alike | (close & (behind < 0)).any(axis=1)]] = False
            grown = close & held[number][:, None] & ~known[number[:, None], behind]
            fresh = np.unique((number[:, None] * m + behind)[grown])
            number, face = fresh // m, fresh % m
            known[number, face] = True
        return held

    @cached_property
    def _neighbours(self) -> Index:
        """Neighbour with an area across each edge; -1: there is none, or more than one."""
        faces = self.query.faces
        order = np.stack([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]], axis=1)  # opposite v0, v1, v2
        low, high = order.min(axis=2), order.max(axis=2)
        keys = np.where(self.oracle.has_area(np.arange(len(faces)))[:, None], low * len(self.query.vertices) + high, -1)
        _, number, count = np.unique(keys, return_inverse=True, return_counts=True)
        number = number.reshape(keys.shape)
        owner = np.arange(len(faces))[:, None]
        both = np.bincount(number.ravel(), (owner + 0 * number).ravel().astype(np.float64)).astype(np.intp)
        return np.where((keys >= 0) & (count[number] == 2), both[number] - owner, -1)

    def _beside(self, ray: Index, prim: Index) -> Doubles:
        """Distances (n, 3) of rays from the edges of triangles, projected along the ray, by float64; world units."""
        corners = self.oracle.corners[self.oracle.group[prim]] - self.oracle.o[ray][:, None]
        d = self.oracle.d[ray][:, None] / np.sqrt((self.oracle.d[ray] ** 2).sum(axis=1))[:, None, None]
        flat = corners - (corners * d).sum(axis=2, keepdims=True) * d
        start = np.roll(flat, -1, axis=1)
        edge = np.roll(flat, -2, axis=1) - start
        square = (edge**2).sum(axis=2, keepdims=True)
        share = np.clip(-(start * edge).sum(axis=2, keepdims=True) / np.where(square > 0, square, 1), 0, 1)
        return self.oracle.size * np.sqrt(((start + share * edge) ** 2).sum(axis=2))

    # --- occlusion ---

    def occluded(self, occluded: Flags) -> Verdict:
        """Check occlusion answers: whether anything is hit within the interval."""
        wrong, leak = self._missed(np.where(occluded, -np.inf, np.inf))
        c = self.crossings
        low, high = self._tmin[c.ray], self._tmax[c.ray]
        with np.errstate(invalid="ignore"):
            possible = (c.t + self._slack >= low) & (c.t - self._slack <= high) & (low < high)
        explained = np.zeros(len(occluded), bool)
        explained[c.ray[possible]] = True
        for ray in np.flatnonzero(occluded & ~explained):
            wrong[ray] = not (self._finite[ray] and self._tmin[ray] < self._tmax[ray] and self._grazes(int(ray)))
        return Verdict(wrong & ~leak, leak, np.nan, np.nan)

    def _grazes(self, ray: int) -> bool:
        """Whether a ray passes an edge within twice the bound; the second half covers the rounding of float64."""
        corners = self.oracle.corners[self.oracle.group] - self.oracle.o[ray]
        reach = np.sqrt((corners**2).sum(axis=2).max(axis=1))
        d = self.oracle.d[ray] / np.sqrt((self.oracle.d[ray] ** 2).sum())
        area = self.oracle.has_area(np.arange(len(corners)))
        for k in range(3):
            start, edge = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
            flat_start, flat_edge = start - (start @ d)[:, None] * d, edge - (edge @ d)[:, None] * d
            square = (flat_edge**2).sum(axis=1)
            share = np.clip(-(flat_start * flat_edge).sum(axis=1) / np.where(square > 0, square, 1), 0, 1)[:, None]
            ahead = ((start + share * edge) @ d) >= -2 * self._bound * reach
            close = np.sqrt(((flat_start + share * flat_edge) ** 2).sum(axis=1)) <= 2 * self._bound * reach
            if (ahead & close & area).any():
                return True
        return False
