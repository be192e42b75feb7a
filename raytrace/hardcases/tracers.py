"""Ray tracers behind one face: ours along every path, and the baseline, the course implementation of the beginning."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import raytrace
from raytrace.accel import query
from raytrace.accel.bundle import BUNDLE
from raytrace.accel.bvh import BVH
from raytrace.accel.grow import SPLITS
from raytrace.accel.inputs import columns_of
from raytrace.accel.lanes import PACKET
from raytrace.hardcases.judge import Flags, Query
from raytrace.hardcases.shadows import LightQuery
from raytrace.passes.light import shadow_rays, triangles_at
from raytrace.records import Hits, Points, Rays, Shadows, Surface

Reals = NDArray[np.floating]
EPSILON = 1e-4  # of the course: where shadow rays begin, and how far before the light they end, in user units


class Lit(NamedTuple):
    """What shadow rays found."""

    found: Flags  # (n,): a point was hit
    dark: Flags  # (n,): its light does not reach it


class Tracer(Protocol):
    """What the suite asks of a ray tracer; several answers to the same question are from several paths."""

    name: str
    version: str
    dtype: np.dtype
    interval: bool  # knows tmin and tmax
    exact: bool  # promises the same bits along every path, and the lowest of triangles at equal distance

    def nearest(self, asked: Query) -> Iterator[Hits]:
        """Nearest hits."""

    def blocked(self, asked: Query) -> Iterator[Flags]:
        """Whether anything is hit."""

    def shadows(self, asked: LightQuery) -> Iterator[Lit]:
        """Whether the light of each point is kept from it."""


# --- packets and single rays -----------------------------------------------------------------------------------------


def kind(d: Reals) -> NDArray[np.int64]:
    """Rays of one kind have the same signs and the same largest component."""
    return np.argmax(np.abs(d), axis=1) * 8 + (d < 0) @ np.array([1, 2, 4])


def scattered(answers: Any, order: NDArray[np.int64], n: int) -> Any:
    """Answers to rays ``order`` in the order of the rays."""
    if isinstance(answers, Hits):
        return Hits(*[scattered(column, order, n) for column in answers])
    column = np.empty(n, answers.dtype)
    column[order] = answers
    return column


def packed(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Ask with rays of one kind beside each other, whole packets of them, so that they go side by side."""
    kinds = kind(d)
    rows = [np.flatnonzero(kinds == number) for number in np.unique(kinds)]
    order = np.concatenate([np.resize(mine, -(-len(mine) // PACKET) * PACKET) for mine in rows] or [kinds])
    limits = (np.broadcast_to(limit, len(d))[order] for limit in (tmin, tmax))
    return scattered(ask(o[order], d[order], *limits), order, len(d))


def alone(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Ask with every ray the only one alive of its packet and kind, so that each goes through the tree alone."""
    starts, lone, *ends = _apart(PACKET, o, d, tmin, tmax)
    lone[1::PACKET] = -np.roll(d, 1, axis=1)  # of another kind: so they make no bundle
    return _first(PACKET, ask(starts, lone, *ends))


def bundled(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Ask with every ray the only one of its bundle that is alive: behind the narrowest frustum that there is."""
    return _first(BUNDLE * PACKET, ask(*_apart(BUNDLE * PACKET, o, d, tmin, tmax)))


def _apart(n: int, o: Reals, d: Reals, tmin: ArrayLike, tmax: ArrayLike) -> list[Reals]:
    """Rays n rows apart, and between them rays that can't hit."""
    limits = (np.broadcast_to(limit, len(d)) for limit in (tmin, tmax))
    starts, lone, *ends = (np.repeat(a, n, axis=0) for a in (o, d, *limits))
    lone[np.arange(len(lone)) % n != 0] = np.nan
    return [starts, lone, *ends]


def _first(n: int, answers: Any) -> Any:
    """Every n-th answer."""
    return Hits._make(column[::n] for column in answers) if isinstance(answers, Hits) else answers[::n]


def together(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Ask for all rays at once, in no order, so that they are sorted first."""
    order = np.argsort(np.arange(len(d)) * 0.6180339887498949 % 1.0)
    limits = (np.broadcast_to(limit, len(d))[order] for limit in (tmin, tmax))
    return scattered(ask(o[order], d[order], *limits), order, len(d))


def closest_as_given(bvh: BVH, o: Reals, d: Reals, tmin: ArrayLike, tmax: ArrayLike) -> Hits:
    """Nearest hits of rays in packets as they are given: they are not sorted first."""
    n, dtype = len(d), bvh.triangles.dtype
    hits = Hits(np.empty(n, dtype), np.empty(n, np.int32), np.empty(n, dtype), np.empty(n, dtype))
    arrays = [np.ascontiguousarray(a, dtype) for a in (o, d, tmin, tmax)]
    query.closest_hit(bvh.tree, Rays(*(columns_of(a, n) for a in arrays)), hits, n, bvh.work())
    return hits


def any_as_given(bvh: BVH, o: Reals, d: Reals, tmin: ArrayLike, tmax: ArrayLike) -> Flags:
    """Whether rays in packets as they are given hit anything."""
    occluded = np.empty(len(d), bool)
    arrays = [np.ascontiguousarray(a, bvh.triangles.dtype) for a in (o, d, tmin, tmax)]
    query.any_hit(bvh.tree, Rays(*(columns_of(a, len(d)) for a in arrays)), occluded, len(d), bvh.work())
    return occluded


def paths(bvh: BVH) -> Iterator[tuple[Callable[..., Hits], Callable[..., Flags]]]:
    """Nearest hit and occlusion along every path through a tree."""
    for path in (packed, together):
        yield partial(path, bvh.closest_hit), partial(path, bvh.any_hit)
    for path in (alone, bundled):
        yield partial(path, partial(closest_as_given, bvh)), partial(path, partial(any_as_given, bvh))


# --- ours ------------------------------------------------------------------------------------------------------------


class Ours:
    """``rt.BVH`` in one precision: both splits, packets and single rays."""

    interval, triangle, version = True, "watertight", raytrace.__version__

    def __init__(self, precision: str) -> None:
        self.name, self.exact = f"raytrace {precision}", True
        self.dtype: np.dtype = np.dtype(precision)

    def _trees(self, made: Query | LightQuery) -> Iterator[BVH]:
        for split in SPLITS:
            yield BVH(made.vertices, made.faces, self.dtype.name, split, self.triangle)

    def nearest(self, asked: Query) -> Iterator[Hits]:
        """Nearest hits."""
        for bvh in self._trees(asked):
            for closest, _ in paths(bvh):
                yield closest(asked.o, asked.d, asked.tmin, asked.tmax)

    def blocked(self, asked: Query) -> Iterator[Flags]:
        """Whether anything is hit."""
        for bvh in self._trees(asked):
            for _, occluded in paths(bvh):
                yield occluded(asked.o, asked.d, asked.tmin, asked.tmax)

    def shadows(self, asked: LightQuery) -> Iterator[Lit]:
        """Shadow rays as the renderer makes them, through a tree without the triangles that the light lies on."""
        lights, number = np.unique(asked.light, axis=0, return_inverse=True)
        rows = [np.flatnonzero(number.ravel() == k) for k in range(len(lights))]
        for bvh in self._trees(asked):
            lit_on = (triangles_at(bvh.tree, bvh.triangles, light) for light in lights)
            trees = [
                BVH(bvh.vertices, np.delete(bvh.faces, prims, axis=0), bvh.precision, bvh.split) for prims in lit_on
            ]
            ways = zip(paths(bvh), *map(paths, trees), strict=True)
            for (closest, _), *others in ways:
                hits = closest(asked.o, asked.d)
                surface, dark = bvh.surface(hits), np.zeros(len(asked.o), bool)
                for light, mine, (_, occluded) in zip(lights, rows, others, strict=True):
                    o, d, tmax = sent(Surface._make(a[mine] for a in surface), light)
                    dark[mine] = occluded(o, d, 0.0, tmax) | (tmax <= 0)
                yield Lit(hits.prim_id >= 0, dark)


def sent(surface: Surface, light: Reals) -> tuple[Reals, Reals, Reals]:
    """Origins, directions and ends of the renderer's shadow rays from points to a light."""
    n, dtype = len(surface.p), light.dtype
    rows = -(-n // PACKET) * PACKET  # kernels fill whole registers

    def flat(a: Reals) -> Reals:
        return np.resize(a, (rows, 3)).T.ravel()

    with np.errstate(invalid="ignore"):  # of misses
        side = np.where(((light - surface.p) * surface.ng).sum(axis=1) < 0, -1, 1).astype(dtype)
    normal = flat(surface.ng * side[:, None])
    offset = np.resize((np.abs(surface.ng) * surface.p_error).sum(axis=1), rows)
    points = Points(flat(surface.p), normal, normal, offset, np.zeros(rows, np.int32))
    (o, d), (tmax, irradiance) = np.empty((2, 3 * rows), dtype), np.empty((2, rows), dtype)
    shadow_rays(points, light, Shadows(o, d, tmax, irradiance, np.zeros(rows, bool)))
    return o.reshape(3, rows).T[:n], d.reshape(3, rows).T[:n], tmax[:n]


class Baseline(Ours):
    """The course's own implementation: Moller-Trumbore with |det| < 1e-5, and a constant offset of 1e-4."""

    triangle = "moller-trumbore"

    def __init__(self, precision: str) -> None:
        super().__init__(precision)
        self.name, self.exact = f"baseline {precision}", False

    def shadows(self, asked: LightQuery) -> Iterator[Lit]:
        """Shadow rays begin and end that constant from point and light."""
        for bvh in self._trees(asked):
            for closest, occluded in paths(bvh):
                hits = closest(asked.o, asked.d)
                with np.errstate(invalid="ignore"):
                    p = asked.o + np.where(hits.prim_id >= 0, hits.t, np.nan)[:, None] * asked.d
                away = asked.light - p
                distance = np.sqrt((away**2).sum(axis=1))
                ends = np.full(len(p), EPSILON, self.dtype), distance - self.dtype.type(EPSILON)
                yield Lit(hits.prim_id >= 0, occluded(p, away / distance[:, None], *ends))


def tracers() -> list[Tracer]:
    """What comes with this package."""
    return [make(precision) for make in (Ours, Baseline) for precision in ("float32", "float64")]
