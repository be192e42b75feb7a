"""Hard rays for ray tracers: cases with a name, a seed and a condition that must hold."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from raytrace.hardcases.aiming import bad_rays, edge_points, lattice, signed_axes, towards
from raytrace.hardcases.judge import RayQuery
from raytrace.hardcases.meshes import (
    CLOSED,
    Mesh,
    choice,
    cubes,
    flat,
    grid,
    icosphere,
    joined,
    strip,
    torus,
    turned,
    uniform,
)

MAX_TARGETS, MANY_TRIANGLES = 600, 2000  # targets per origin; half as many for a mesh of many triangles
OUTSIDE = [[2.3, -1.7, 1.9], [-0.4, 3.1, 0.2], [0.05, -0.1, -6.0]]


class Case(NamedTuple):
    """Rays and a mesh, rounded to a precision; the rounded numbers are taken as exact."""

    name: str
    seed: int
    must: str  # condition that must hold
    make: Callable[[np.dtype, int], RayQuery]  # (precision, seed)

    def query(self, dtype: DTypeLike, step: int = 1) -> RayQuery:
        """Make the query of this case, with every ``step``-th ray."""
        query = self.make(np.dtype(dtype), self.seed)
        return query._replace(**{name: getattr(query, name)[::step] for name in ("o", "d", "tmin", "tmax", "inside")})


# --- queries ----------------------------------------------------------------------------------------------------------


def make_query(mesh: Mesh, o: ArrayLike, d: ArrayLike, dtype: np.dtype, **more: Any) -> RayQuery:
    """Query of (n, 3) rays, rounded to a precision; by default for t > 0 and with origins outside the mesh."""
    with np.errstate(over="ignore"):
        o, d = (np.ascontiguousarray(a, dtype) for a in np.broadcast_arrays(o, d))
    limits = {"tmin": 0.0, "tmax": np.inf} | more
    tmin, tmax = (np.broadcast_to(np.asarray(limits[name], dtype), len(o)) for name in ("tmin", "tmax"))
    inside = np.broadcast_to(more.get("inside", False), len(o))
    return RayQuery(mesh[0].astype(dtype), mesh[1], o, d, tmin, tmax, inside, more.get("tied", False))


# --- makers of cases --------------------------------------------------------------------------------------------------


def aimed(mesh: Mesh, inside: ArrayLike, outside: ArrayLike, dtype: np.dtype, seed: int) -> RayQuery:
    """Rays from points inside and outside a closed mesh, aimed at its edges and vertices."""
    targets = edge_points(mesh, dtype, seed)
    targets = targets[:: -(-len(targets) // (MAX_TARGETS if len(mesh[1]) < MANY_TRIANGLES else MAX_TARGETS // 2))]
    inside, outside = (np.asarray(points, np.float64).reshape(-1, 3) for points in (inside, outside))
    o, d = towards(np.concatenate([inside, outside]), targets)
    keep = (d != 0).any(axis=1)
    starts_inside = np.arange(len(o)) < len(inside) * len(targets)
    return make_query(mesh, o[keep], d[keep], dtype, inside=starts_inside[keep])


def scaled(size: float, shift: float, dtype: np.dtype, seed: int) -> RayQuery:
    """A scaled and translated sphere."""
    vertices, faces = icosphere(2)
    inside, outside = (np.array(points) * size + shift for points in ([[0.0, 0, 0], [0.1, 0.2, -0.3]], OUTSIDE[:2]))
    return aimed((vertices * size + shift, faces), inside, outside, dtype, seed)


def far(distance: float, dtype: np.dtype, seed: int) -> RayQuery:
    """A sphere seen from far away."""
    return aimed(icosphere(2), [], distance * turned(np.eye(3))[:2], dtype, seed)


def long(length: float, dtype: np.dtype, seed: int) -> RayQuery:
    """A torus and rays with directions of about this length."""
    query = aimed(torus(20, 10), CLOSED["torus"][1], OUTSIDE[:1], dtype, seed)
    with np.errstate(over="ignore", under="ignore"):
        return query._replace(d=query.d * dtype.type(length))


def lattice_soup(dtype: np.dtype, seed: int) -> RayQuery:
    """Triangles and rays with small integer coordinates."""
    corners = np.floor(2.5 * uniform(seed, 40, 3, 3) + 0.5)
    return make_query((corners.reshape(-1, 3), np.arange(120).reshape(-1, 3)), *lattice(1000, seed + 1), dtype)


def lattice_in_cubes(dtype: np.dtype, seed: int) -> RayQuery:
    """Rays that start and lie in faces, edges and diagonals of touching cubes."""
    o, d = lattice(1500, seed)
    o = np.clip(o, -2, 2) + choice(seed + 2, [-0.5, 0.0, 0.5], 1500, 3)
    keep = (np.abs(o) < 2.5).all(axis=1)
    return make_query(cubes(5), o[keep], d[keep], dtype, inside=True)


def along_axes(dtype: np.dtype, seed: int) -> RayQuery:
    """Rays along the axes, at vertices, edges and planes of three grids that share a corner."""
    vertices, faces = grid(8)
    mesh = joined(*((np.roll(vertices, k, axis=1), faces) for k in range(3)))
    targets = np.floor(4 * uniform(seed, 40, 3)) + 4 + choice(seed + 1, [0.0, 0.5], 40, 3)
    d, o = (a.reshape(-1, 3) for a in np.broadcast_arrays(signed_axes()[:, None], targets))
    return make_query(mesh, o - 16 * d, d, dtype)


def denormal(dtype: np.dtype, seed: int) -> RayQuery:
    """Directions along the axes whose other components are denormal or nearly so."""
    info, n = np.finfo(dtype), 400
    small = np.where(uniform(seed, n, 3) < 0, info.smallest_subnormal * 5, info.tiny * 3) * uniform(seed + 1, n, 3)
    axis = np.arange(n) % 3
    small[np.arange(n), axis] = choice(seed + 2, [-1.0, 1.0], n)
    o = np.concatenate([choice(seed + 3, [-0.5, 0.0, 0.5], n // 2, 3), uniform(seed + 3, n // 2, 3) * 0.4])
    return make_query(cubes(3), o, small, dtype, inside=True)


def along_walls(dtype: np.dtype, seed: int) -> RayQuery:
    """Rays from just inside a closed box, almost parallel to a wall and into it, with directions of several lengths."""
    vertices, faces = grid(4)
    sides = [(np.roll(vertices / 4 + [0, 0, z], k, axis=1), faces) for k in range(3) for z in (0.0, 1.0)]
    n = 800
    small = 10.0 ** np.floor(-20 + 10 * uniform(seed, n))
    aside = uniform(seed + 1, n) * choice(seed + 2, [0.0, 1.0], n)
    d = np.stack([-(uniform(seed + 3, n) + 1.5) * small, aside * small, np.ones(n)], axis=1)
    o = np.stack([(uniform(seed + 4, n) + 1) * 0.5 * small, 0.5 + 0.5 * uniform(seed + 5, n), np.full(n, 0.05)], axis=1)
    turn = (np.arange(n)[:, None] + np.arange(3)) % 3
    o, d = np.take_along_axis(o, turn, axis=1), np.take_along_axis(d, turn, axis=1)
    return make_query(joined(*sides), o, d * choice(seed + 6, [1e-6, 1e-5, 1e-3, 1.0], n, 1), dtype, inside=True)


def on_surface(dtype: np.dtype, seed: int) -> RayQuery:
    """Rays in all directions from corners, edges, diagonals and faces of a cube."""
    o = choice(seed, [-1.0, -0.5, 0.0, 0.25, 1.0], 600, 3)
    o[np.arange(600), np.arange(600) % 3] = choice(seed + 1, [-1.0, 1.0], 600)
    d = np.concatenate([lattice(300, seed + 2)[1], uniform(seed + 3, 300, 3)])
    return make_query(CLOSED["cube"][0](), o, d, dtype)


def in_box_planes(dtype: np.dtype, seed: int) -> RayQuery:
    """Rays that lie in planes of bounding boxes: origins share coordinates with vertices."""
    vertices, faces = icosphere(2)
    pick = (((uniform(seed, 600, 3) + 1) / 2) * len(vertices)).astype(int)
    o = 0.9 * np.take_along_axis(vertices, pick, axis=0)
    o[:, 0] = vertices[pick[:, 0], 0]
    o[::2] *= np.array([1, 1 / 0.9, 1])
    d = np.tile(signed_axes(), (25, 1))
    return make_query((vertices, faces), o, d, dtype)


def no_area(dtype: np.dtype, seed: int) -> RayQuery:
    """Rays aimed at triangles without area."""
    vertices, faces = flat(seed)
    targets = np.concatenate([vertices, (vertices + np.roll(vertices, 1, axis=0)) / 2])
    return make_query(
        (vertices, faces), *towards(OUTSIDE[:1] + [[4.0, 0, 0], [0, 0, -4.0]], targets.astype(dtype)), dtype
    )


def some_without_area(dtype: np.dtype, seed: int) -> RayQuery:
    """A sphere with triangles without area on its vertices and around it."""
    vertices, faces = icosphere(2)
    a, b, c = faces[::5].T
    more = np.concatenate([np.stack([a, a, b], 1), np.stack([b, c, b], 1), np.stack([c, c, c], 1)])
    mesh = joined((vertices, np.concatenate([more, faces])), flat(seed + 2))
    query = aimed((vertices, faces), CLOSED["icosphere"][1], OUTSIDE[:1], dtype, seed)
    return query._replace(vertices=mesh[0].astype(dtype), faces=mesh[1])


def slivers(aspect: float, turn: bool, dtype: np.dtype, seed: int) -> RayQuery:
    """A band of slivers seen from above at steep, oblique and grazing angles; aimed at edges, corners and centroids."""
    vertices, faces = strip(8, aspect)
    middles = vertices[faces].mean(axis=1)
    heights = np.array(
        [[0.0, 4 / aspect, 1.0], [1.5, 1.0, 0.7], [-1.5, 2 / aspect, 0.3], [-0.2, 9 / aspect, 9 / aspect]]
    )
    if turn:
        vertices, middles, heights = turned(vertices), turned(middles), turned(heights)
    targets = np.concatenate([edge_points((vertices, faces), dtype, seed), middles.astype(dtype)])
    return make_query((vertices, faces), *towards(heights, targets), dtype)


def grazing(turn: bool, dtype: np.dtype, seed: int) -> RayQuery:
    """Rays at 1e-7 rad to a floor of squares, aimed at interiors, edges and corners."""
    vertices, faces = grid(8)
    targets = np.concatenate([np.floor(8 * uniform(seed, 200, 2)) / 2 + 4, 4 * uniform(seed + 1, 200, 2) + 4])
    flat_d = uniform(seed + 2, 400, 2)
    flat_d *= choice(seed + 3, [0.5, 1.0, 4.0], 400, 1) / np.sqrt((flat_d**2).sum(axis=1, keepdims=True))
    length = np.sqrt((flat_d**2).sum(axis=1))
    d = np.column_stack([flat_d, -1e-7 * length])
    o = np.column_stack([targets, np.zeros(400)]) - d
    if turn:
        vertices, o, d = turned(vertices), turned(o), turned(d)
    return make_query((vertices, faces), o, d, dtype)


def huge_and_tiny(dtype: np.dtype, seed: int) -> RayQuery:
    """Tiny spheres above the edges of a huge floor."""
    ball, faces = icosphere(1)
    places = np.array([[0.0, 0, 2e-3], [0.5, 0.5, 1e-2], [-1e3, -1e3, 0.1]])
    floor = (
        np.array([[-1e6, -1e6, 0], [1e6, -1e6, 0], [1e6, 1e6, 0], [-1e6, 1e6, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    mesh = joined(floor, *((1e-3 * ball + place, faces) for place in places))
    queries = [
        aimed((mesh[0][4:], mesh[1][2:] - 4), [], place + np.array(OUTSIDE[:2]), dtype, seed) for place in places
    ]
    o, d = (np.concatenate([getattr(query, name)[::3] for query in queries]) for name in ("o", "d"))
    return make_query(mesh, o, d, dtype)


def overlaps(dtype: np.dtype, seed: int) -> RayQuery:
    """Overlapping triangles in two planes, seen from straight above."""
    corners = np.floor(8.5 * uniform(seed, 300, 3, 3) + 0.5)
    corners[..., 2] = choice(seed + 1, [0.0, 0.0, -1.0], 300, 1)
    o = np.column_stack([np.floor(9.5 * uniform(seed + 2, 500, 2) + 0.5), np.full(500, 2.0)])
    return make_query((corners.reshape(-1, 3), np.arange(900).reshape(-1, 3)), o, [[0.0, 0, -1]], dtype, tied=True)


def duplicates(dtype: np.dtype, seed: int) -> RayQuery:
    """10,000 copies of a triangle above another triangle."""
    floor = np.array([[0.0, 0, -1], [4, 0, -1], [0, 4, -1], [0, 0, 0], [4, 0, 0], [0, 4, 0]])
    faces = np.repeat([[0, 1, 2], [3, 4, 5]], [7, 10_000], axis=0)
    o = np.concatenate([(uniform(seed, 64, 3) + 1) * 0.9 + 0.05, choice(seed, [0.0, 1.0, 2.0, 3.0], 64, 3) + [0, 0, 1]])
    return make_query((floor, faces), o, [[0.0, 0, -1]], dtype, tied=True)


def ends(dtype: np.dtype, _seed: int) -> RayQuery:
    """A hit at t = 0.75, and intervals that end at it, before it or behind it, or are empty."""
    hit, inf = dtype.type(0.75), np.inf
    below, above = np.nextafter(hit, dtype.type(0)), np.nextafter(hit, dtype.type(1))
    limits = [(hit, 9), (0, hit), (below, above), (below, hit), (hit, above), (0.9, 0.6), (hit, hit), (-inf, inf)]
    limits += [(-5, 0), (0.76, inf), (np.nan, 9), (0, np.nan), (inf, -inf), (0, 0.5), (0.5, 1.0), (1.0, 0.5)]
    tmin, tmax = np.array(limits, dtype).T
    floor = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])
    return make_query(floor, np.tile([1.0, 1, 3], (16, 1)), [[0.0, 0, -4]], dtype, tmin=tmin, tmax=tmax)


def not_finite(dtype: np.dtype, _seed: int) -> RayQuery:
    """Rays with NaN, infinity or direction 0."""
    floor = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])
    return make_query(floor, *bad_rays(), dtype)


def cases() -> Iterator[Case]:
    """All cases of rays, in a fixed order."""
    for k, (name, (mesh, inside)) in enumerate(CLOSED.items()):
        must = "at edges and vertices, and a few ulps beside them"
        yield Case(f"{name}, from inside", 10 + k, f"every ray hits a wall: {must}", partial(aimed, mesh(), inside, []))
        yield Case(f"{name}, from outside", 20 + k, f"the front is hit: {must}", partial(aimed, mesh(), [], OUTSIDE))
    yield Case("lattice rays, triangles", 30, "exact answers for rays through corners and in planes", lattice_soup)
    yield Case("lattice rays, slab planes", 31, "no ray in the planes of touching boxes leaves a box", lattice_in_cubes)
    yield Case("axes, signed zeros", 32, "the sign of a zero does not matter", along_axes)
    yield Case("denormal components", 33, "rays almost parallel to an axis hit the wall", denormal)
    yield Case("all but along walls", 38, "no ray leaves a box", along_walls)
    yield Case("origins on the surface", 34, "triangles ahead of the origin are hit", on_surface)
    yield Case("origins in box planes", 35, "triangles ahead of the origin are hit", in_box_planes)
    yield Case("no area, alone", 36, "points, needles and collinear corners are never hit", no_area)
    yield Case("no area, mixed in", 37, "triangles without area change nothing", some_without_area)
    for k, aspect in enumerate((1e6, 1e7, 1e8, 1e9)):
        yield Case(f"slivers {aspect:.0e}, flat", 40 + k, "no ray passes the slivers", partial(slivers, aspect, False))
        yield Case(f"slivers {aspect:.0e}, turned", 50 + k, "no ray passes the slivers", partial(slivers, aspect, True))
    for k, size in enumerate((1e-12, 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e12)):
        yield Case(f"scale {size:.0e}", 60 + k, "size changes nothing", partial(scaled, size, 0.0))
    for k, shift in enumerate((1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7)):
        yield Case(f"translation {shift:.0e}", 70 + k, "translation changes nothing", partial(scaled, 1.0, shift))
    yield Case("translation 1e+07, size 1e+03", 79, "translation changes nothing", partial(scaled, 1e3, 1e7))
    for k, distance in enumerate((1e2, 1e4, 1e6, 1e9, 1e12)):
        yield Case(f"origins {distance:.0e} away", 80 + k, "distance changes nothing", partial(far, distance))
    for k, length in enumerate((1e-20, 1e-10, 1e10, 1e20)):
        yield Case(f"directions {length:.0e} long", 90 + k, "length changes nothing", partial(long, length))
    yield Case("grazing 1e-7, flat", 100, "almost parallel triangles are hit", partial(grazing, False))
    yield Case("grazing 1e-7, turned", 101, "almost parallel triangles are hit", partial(grazing, True))
    yield Case("huge beside tiny", 102, "tiny spheres are hit before the huge floor", huge_and_tiny)
    yield Case("coplanar overlaps", 103, "at equal distance, the lowest prim_id is returned", overlaps)
    yield Case("10,000 duplicates", 104, "of equal triangles, the lowest prim_id is returned", duplicates)
    yield Case("ends of the interval", 105, "the interval is open at both ends, and may be empty", ends)
    yield Case("rays not finite", 106, "nothing is hit", not_finite)
