"""``Tracer``, the interface of ray tracers in the suite; this package along every path, and the baseline.

The baseline is the original course implementation.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import raytrace
from raytrace.accel import query as kernels
from raytrace.accel.bundle import BUNDLE
from raytrace.accel.bvh import BVH
from raytrace.accel.grow import SPLITS
from raytrace.accel.inputs import columns_of
from raytrace.accel.lanes import PACKET
from raytrace.hardcases.judge import Flags, RayQuery
from raytrace.hardcases.shadows import LightQuery
from raytrace.passes.light import shadow_rays, triangles_at
from raytrace.records import Hits, Points, Rays, Shadows, Surface

Reals = NDArray[np.floating]
EPSILON = 1e-4  # offset of shadow rays in the course, world units: at the surface, and before the light


class Lit(NamedTuple):
    """Result of shadow rays."""

    found: Flags  # (n,): a point was hit
    dark: Flags  # (n,): the light does not reach it


class Tracer(Protocol):
    """Interface of a ray tracer in the suite; each path through the tracer yields an answer of its own."""

    name: str
    version: str
    dtype: np.dtype
    interval: bool  # supports tmin and tmax
    exact: bool  # guarantees bit-identical answers along every path, and the lowest prim_id at equal distance

    def nearest(self, query: RayQuery) -> Iterator[Hits]:
        """Nearest hits."""

    def blocked(self, query: RayQuery) -> Iterator[Flags]:
        """Whether anything is hit."""

    def shadows(self, query: LightQuery) -> Iterator[Lit]:
        """Whether each point is hit, and whether its light is blocked."""


# --- packets and single rays -----------------------------------------------------------------------------------------


def octant_and_axis(d: Reals) -> NDArray[np.int64]:
    """Number of the octant and dominant axis of each ray."""
    return np.argmax(np.abs(d), axis=1) * 8 + (d < 0) @ np.array([1, 2, 4])


def scattered(answers: Any, order: NDArray[np.int64], n: int) -> Any:
    """Bring answers to rays in ``order`` back into the original order."""
    if isinstance(answers, Hits):
        return Hits(*[scattered(column, order, n) for column in answers])
    column = np.empty(n, answers.dtype)
    column[order] = answers
    return column


def packed(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Trace rays sorted by octant and axis in full packets, so that they are traversed as packets."""
    kinds = octant_and_axis(d)
    rows = [np.flatnonzero(kinds == number) for number in np.unique(kinds)]
    order = np.concatenate([np.resize(row, -(-len(row) // PACKET) * PACKET) for row in rows] or [kinds])
    limits = (np.broadcast_to(limit, len(d))[order] for limit in (tmin, tmax))
    return scattered(ask(o[order], d[order], *limits), order, len(d))


def alone(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Trace each ray as the only valid one of its packet and octant, so that it is traversed as a single ray."""
    rays = _spaced(PACKET, o, d, tmin, tmax)
    rays.d[1::PACKET] = -np.roll(d, 1, axis=1)  # another octant, so that they form no bundle
    return _every(PACKET, ask(*rays))


def bundled(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Trace each ray as the only valid one of its bundle: behind the narrowest possible frustum."""
    return _every(BUNDLE * PACKET, ask(*_spaced(BUNDLE * PACKET, o, d, tmin, tmax)))


class _SpacedRays(NamedTuple):
    """Rays n rows apart, with invalid rays between them."""

    o: Reals  # (k n, 3)
    d: Reals  # (k n, 3); NaN: invalid
    tmin: Reals  # (k n,)
    tmax: Reals  # (k n,)


def _spaced(n: int, o: Reals, d: Reals, tmin: ArrayLike, tmax: ArrayLike) -> _SpacedRays:
    """Place the rays n rows apart, with invalid rays between them."""
    limits = (np.broadcast_to(limit, len(d)) for limit in (tmin, tmax))
    rays = _SpacedRays(*(np.repeat(a, n, axis=0) for a in (o, d, *limits)))
    rays.d[np.arange(len(rays.d)) % n != 0] = np.nan
    return rays


def _every(n: int, answers: Any) -> Any:
    """Keep every n-th answer."""
    return Hits._make(column[::n] for column in answers) if isinstance(answers, Hits) else answers[::n]


def shuffled(ask: Callable[..., Any], o: Reals, d: Reals, tmin: ArrayLike = 0.0, tmax: ArrayLike = np.inf) -> Any:
    """Trace all rays at once in shuffled order, so that the tree sorts them first."""
    order = np.argsort(np.arange(len(d)) * 0.6180339887498949 % 1.0)
    limits = (np.broadcast_to(limit, len(d))[order] for limit in (tmin, tmax))
    return scattered(ask(o[order], d[order], *limits), order, len(d))


def closest_as_given(bvh: BVH, o: Reals, d: Reals, tmin: ArrayLike, tmax: ArrayLike) -> Hits:
    """Nearest hits of rays in packets in the given order, without sorting."""
    n, dtype = len(d), bvh.triangles.dtype
    hits = Hits(np.empty(n, dtype), np.empty(n, np.int32), np.empty(n, dtype), np.empty(n, dtype))
    arrays = [np.ascontiguousarray(a, dtype) for a in (o, d, tmin, tmax)]
    kernels.closest_hit(bvh.tree, Rays(*(columns_of(a, n) for a in arrays)), hits, n, bvh.work())
    return hits


def any_as_given(bvh: BVH, o: Reals, d: Reals, tmin: ArrayLike, tmax: ArrayLike) -> Flags:
    """Whether rays in packets in the given order hit anything, without sorting."""
    occluded = np.empty(len(d), bool)
    arrays = [np.ascontiguousarray(a, bvh.triangles.dtype) for a in (o, d, tmin, tmax)]
    kernels.any_hit(bvh.tree, Rays(*(columns_of(a, len(d)) for a in arrays)), occluded, len(d), bvh.work())
    return occluded


def paths(bvh: BVH) -> Iterator[tuple[Callable[..., Hits], Callable[..., Flags]]]:
    """Functions for nearest hits and occlusion, a pair for each path through the traversal."""
    for path in (packed, shuffled):
        yield partial(path, bvh.closest_hit), partial(path, bvh.any_hit)
    for path in (alone, bundled):
        yield partial(path, partial(closest_as_given, bvh)), partial(path, partial(any_as_given, bvh))


# --- this package -----------------------------------------------------------------------------------------------------


class Ours:
    """``rt.BVH`` in one precision: both splits; packets, bundles and single rays."""

    interval, triangle, version = True, "watertight", raytrace.__version__

    def __init__(self, precision: str) -> None:
        self.name, self.exact = f"raytrace {precision}", True
        self.dtype: np.dtype = np.dtype(precision)

    def _trees(self, query: RayQuery | LightQuery) -> Iterator[BVH]:
        for split in SPLITS:
            yield BVH(query.vertices, query.faces, self.dtype.name, split, self.triangle)

    def nearest(self, query: RayQuery) -> Iterator[Hits]:
        """Nearest hits."""
        for bvh in self._trees(query):
            for closest, _ in paths(bvh):
                yield closest(query.o, query.d, query.tmin, query.tmax)

    def blocked(self, query: RayQuery) -> Iterator[Flags]:
        """Whether anything is hit."""
        for bvh in self._trees(query):
            for _, occluded in paths(bvh):
                yield occluded(query.o, query.d, query.tmin, query.tmax)

    def shadows(self, query: LightQuery) -> Iterator[Lit]:
        """Shadow rays as the renderer makes them, in a tree without the triangles that contain the light."""
        lights, number = np.unique(query.light, axis=0, return_inverse=True)
        rows = [np.flatnonzero(number.ravel() == k) for k in range(len(lights))]
        for bvh in self._trees(query):
            lit_on = (triangles_at(bvh.tree, bvh.triangles, light) for light in lights)
            trees = [
                BVH(bvh.vertices, np.delete(bvh.faces, prims, axis=0), bvh.precision, bvh.split) for prims in lit_on
            ]
            for (closest, _), *others in zip(paths(bvh), *map(paths, trees), strict=True):
                hits = closest(query.o, query.d)
                surface, dark = bvh.surface(hits), np.zeros(len(query.o), bool)
                for light, row, (_, occluded) in zip(lights, rows, others, strict=True):
                    rays = renderer_shadow_rays(Surface._make(a[row] for a in surface), light)
                    dark[row] = occluded(rays.o, rays.d, 0.0, rays.tmax) | (rays.tmax <= 0)
                yield Lit(hits.prim_id >= 0, dark)


class ShadowSegments(NamedTuple):
    """Shadow rays; tmin is 0."""

    o: Reals  # (n, 3), world units
    d: Reals  # (n, 3), world units
    tmax: Reals  # (n,); 0 or less: the surface faces away


def renderer_shadow_rays(surface: Surface, light: Reals) -> ShadowSegments:
    """Make the renderer's shadow rays from points to a light."""
    n, dtype = len(surface.p), light.dtype
    rows = -(-n // PACKET) * PACKET  # kernels need full packets

    def flat(a: Reals) -> Reals:
        return np.resize(a, (rows, 3)).T.ravel()

    with np.errstate(invalid="ignore"):  # from misses
        side = np.where(((light - surface.p) * surface.ng).sum(axis=1) < 0, -1, 1).astype(dtype)
    normal = flat(surface.ng * side[:, None])
    offset = np.resize((np.abs(surface.ng) * surface.p_error).sum(axis=1), rows)
    points = Points(flat(surface.p), normal, normal, offset, np.zeros(rows, np.int32))
    (o, d), (tmax, irradiance) = np.empty((2, 3 * rows), dtype), np.empty((2, rows), dtype)
    shadow_rays(points, light, Shadows(o, d, tmax, irradiance, np.zeros(rows, bool)))
    return ShadowSegments(o.reshape(3, rows).T[:n], d.reshape(3, rows).T[:n], tmax[:n])


class Baseline(Ours):
    """The original course implementation: Moller-Trumbore with |det| < 1e-5, and a constant offset of 1e-4."""

    triangle = "moller-trumbore"

    def __init__(self, precision: str) -> None:
        super().__init__(precision)
        self.name, self.exact = f"baseline {precision}", False

    def shadows(self, query: LightQuery) -> Iterator[Lit]:
        """Shadow rays start and end at the constant offset from point and light."""
        for bvh in self._trees(query):
            for closest, occluded in paths(bvh):
                hits = closest(query.o, query.d)
                with np.errstate(invalid="ignore"):
                    p = query.o + np.where(hits.prim_id >= 0, hits.t, np.nan)[:, None] * query.d
                away = query.light - p
                distance = np.sqrt((away**2).sum(axis=1))
                ends = np.full(len(p), EPSILON, self.dtype), distance - self.dtype.type(EPSILON)
                yield Lit(hits.prim_id >= 0, occluded(p, away / distance[:, None], *ends))


def own_tracers() -> list[Tracer]:
    """Tracers of this package: the renderer's and the baseline, in both precisions."""
    return [make(precision) for make in (Ours, Baseline) for precision in ("float32", "float64")]
