"""Which answers of a ray tracer the exact ones contradict, and how far off the others are.

An answer to a ray is judged by its backward error: it is right if it is the exact answer to some scene in which every
vertex lies within 32 eps x distance of where it should, eps the machine epsilon of the precision and distance that
from the ray's origin to the farthest vertex of the triangle. So a hit is wrong if the point o + t d lies farther than
that from the triangle, and a triangle must not be missed if the ray passes farther than that inside its outline.

Vertices move together with all their triangles. A ray that passes close to an edge or a vertex whose triangles all face
it, or all turn away from it, therefore crosses one of them wherever they move: to miss them all is a leak. So is to
leave a closed mesh without a hit. An outline (an edge of one triangle, or of two that face differently) is no excuse
beyond the bound, and triangles without area are never hit.
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
PATCHES = 1024  # looked at together
WELL_SEEN = 8  # t is well-conditioned if distance <= WELL_SEEN x that from the origin to the triangle's plane ...
WELL_SHAPED = 64  # ... and u, v if distance <= WELL_SHAPED x the least height of the triangle as the ray sees it


class Query(NamedTuple):
    """Rays for a mesh, in the numbers of one precision, and what must hold."""

    vertices: NDArray[np.floating]  # (v, 3), world units
    faces: Index  # (m, 3)
    o: NDArray[np.floating]  # (n, 3), world units
    d: NDArray[np.floating]  # (n, 3)
    tmin: NDArray[np.floating]  # (n,) units of d
    tmax: NDArray[np.floating]  # (n,) units of d
    inside: Flags  # (n,): starts within a closed mesh and must meet it
    tied: bool  # distances are equal without a rounding: the lowest of the nearest triangles must be named


class Verdict(NamedTuple):
    """What is wrong with the answers to n rays."""

    wrong: Flags  # (n,): a hit or miss that the exact answer contradicts
    leak: Flags  # (n,): went between triangles that share an edge or vertex, or out of a closed mesh
    t_error: float  # largest relative error of t, of well-conditioned hits; NaN: there is none
    uv_error: float  # largest error of u or v, of well-conditioned hits; NaN: there is none


def together(verdicts: Iterable[Verdict]) -> Verdict:
    """Merge verdicts about several answers to the same rays; a ray is right if all of them are."""
    wrong, leak, t_errors, uv_errors = zip(*verdicts, strict=True)
    t, uv = (np.fmax.reduce(errors) for errors in (t_errors, uv_errors))  # NaN: none
    return Verdict(np.any(wrong, axis=0), np.any(leak, axis=0), float(t), float(uv))


class Judge:
    """Exact answers to a query, and what they say of others.

    Parameters
    ----------
    query : Query

    Examples
    --------
    >>> floor = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])
    >>> ray = np.array([[1.0, 1, 3]]), np.array([[0.0, 0, -4]])
    >>> judge = Judge(Query(*floor, *ray, np.zeros(1), np.full(1, np.inf), np.zeros(1, bool), False))
    >>> judge.hits(Hits(np.array([0.75]), np.array([0]), np.array([0.25]), np.array([0.25]))).wrong
    array([False])
    >>> judge.hits(Hits(np.array([np.inf]), np.array([-1]), np.zeros(1), np.zeros(1))).wrong
    array([ True])
    """

    def __init__(self, query: Query) -> None:
        self.query = query
        self.oracle = Oracle(query.vertices[query.faces], query.o, query.d)
        info = np.finfo(query.o.dtype)
        self._bound = BACKWARD * float(info.eps)
        self._tmin, self._tmax = query.tmin.astype(np.float64), query.tmax.astype(np.float64)
        c = self.crossings = self.oracle.crossings
        with np.errstate(all="ignore"):  # of rays that are not finite
            d = np.abs(query.d.astype(np.float64))
            longest = d.max(axis=1, initial=0.0)
            self._length = longest * np.sqrt(((d / longest[:, None]) ** 2).sum(axis=1))
            self._slack = self._bound * self.oracle.reach(c.ray, c.prim) / (c.cosine * self._length[c.ray])  # in t
        self._finite = np.isfinite(self._length) & (self._length > 0) & np.isfinite(query.o).all(axis=1)
        within = (c.t > self._tmin[c.ray]) & (c.t < self._tmax[c.ray])
        surely = (c.t - self._slack > self._tmin[c.ray]) & (c.t + self._slack < self._tmax[c.ray])
        self._surrounds = np.full(len(c.ray), -1, np.int8)  # -1: not asked yet
        self._within, self._required = within, surely & (c.t + self._slack < info.max)

    # --- nearest hits ---

    def hits(self, hits: Hits) -> Verdict:
        """Judge nearest hits; a miss has prim_id -1."""
        t, prim = np.asarray(hits.t, np.float64), np.asarray(hits.prim_id, np.int64)
        found = (prim >= 0) & (prim < len(self.query.faces)) & np.isfinite(t)
        missed, leak = self._missed(np.where(found, t, np.inf))
        row = np.flatnonzero(found)
        false = ~found & (prim != -1)
        false[row] = self._implausible(row, prim[row], t[row])
        leak &= ~false  # such a ray went nowhere
        return Verdict((missed | false) & ~leak, leak, *self._errors(hits))

    def _pairs(self, ray: Index, prim: Index) -> tuple[Flags, Index]:
        """Whether pairs cross, and their row of the crossings."""
        c, m = self.crossings, len(self.query.faces)
        if not len(c.ray):
            return np.zeros(len(ray), bool), np.zeros(len(ray), np.intp)
        keys = c.ray * m + c.prim
        wanted = ray * m + self.oracle.first[self.oracle.group[prim]]
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        return keys[at] == wanted, at

    def _implausible(self, ray: Index, prim: Index, t: Doubles) -> Flags:
        """Hits that lie off their triangle, outside of the interval, or on no area."""
        low, high = self._tmin[ray], self._tmax[ray]
        bad = ~((low < high) & (low <= t) & (t <= high)) | ~self._finite[ray] | ~self.oracle.has_area(prim)
        reach = self.oracle.reach(ray, prim)
        sure, at = self._pairs(ray, prim)  # then the distance along the ray is enough, if it is small
        length = self._length[ray]
        with np.errstate(all="ignore"):
            off = np.abs(t[sure] - self.crossings.t[at[sure]]) * length[sure]
            sure[sure] = off <= self._bound * reach[sure]
            bad |= ~sure & ~(np.abs(t) * length <= 4 * reach)
        rest = np.flatnonzero(~sure & ~bad)
        bad[rest] = self.oracle.distance(ray[rest], prim[rest], t[rest]) > self._bound * reach[rest]
        return bad

    def lowest(self) -> Index:
        """First of the nearest triangles of each ray; -1: none. Exact where the query says that distances are tied."""
        c = self.crossings
        lowest = np.full(len(self.query.o), -1)
        order = np.lexsort((c.prim, c.t, c.ray))
        order = order[self._within[order]]
        rays, first = np.unique(c.ray[order], return_index=True)
        lowest[rays] = c.prim[order[first]]
        return lowest

    def _errors(self, hits: Hits) -> tuple[float, float]:
        """Largest errors of well-conditioned hits: of t relative, of u and v absolute."""
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
        """Rays that went past a triangle before their answer t, and which of them between neighbours."""
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
        """Whether each ray crosses a patch of neighbours that face it alike, and passes its rim beyond the bound."""
        m, ray, prim = len(self.query.faces), self.crossings.ray[pairs], self.crossings.prim[pairs]
        side = self.oracle.facing(ray, prim)
        extent = float(np.sqrt((np.ptp(self.query.vertices.astype(np.float64), axis=0) ** 2).sum()))
        held = self._bound * self.oracle.reach(ray, prim) < extent  # else the bound blurs the whole mesh
        known = np.zeros((len(pairs), m), bool)  # the patch of each pair
        known[np.flatnonzero(held), prim[held]] = True
        number, face = np.nonzero(known)  # of it, what is new
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
        """Triangle behind each edge, of those with an area; -1 where there is none, or more than one."""
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
        """Distance of lines from the edges (n, 3) of triangles as seen along them, by float64; world units."""
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
        """Judge whether anything lies within the interval."""
        wrong, leak = self._missed(np.where(occluded, -np.inf, np.inf))
        c = self.crossings
        low, high = self._tmin[c.ray], self._tmax[c.ray]
        with np.errstate(invalid="ignore"):
            perhaps = (c.t + self._slack >= low) & (c.t - self._slack <= high) & (low < high)
        explained = np.zeros(len(occluded), bool)
        explained[c.ray[perhaps]] = True
        for ray in np.flatnonzero(occluded & ~explained):
            wrong[ray] = not (self._finite[ray] and self._tmin[ray] < self._tmax[ray] and self._grazes(int(ray)))
        return Verdict(wrong & ~leak, leak, np.nan, np.nan)

    def _grazes(self, ray: int) -> bool:
        """Whether a ray passes an edge within twice the bound (once, and as much for float64's own rounding)."""
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
