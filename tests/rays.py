"""Meshes and rays that break ray tracers, by name; whatever is random has a seed."""

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

import naive
import raytrace as rt
from raytrace.accel.lanes import PACKET
from raytrace.accel.reorder import SAMPLE

F8 = NDArray[np.float64]
Mesh = tuple[F8, NDArray[np.int64]]


# --- meshes ----------------------------------------------------------------------------------------------------------


def soup(n: int, seed: int, size: float = 0.5) -> Mesh:
    """n triangles of about that size, anywhere in a cube of side 2; no two share a vertex."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3)


def grid(n: int) -> Mesh:
    """2 n^2 triangles over [0, n]^2 in the plane z = 0, facing +z; vertex (i, j) has number i (n + 1) + j."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    vertices = np.stack([i, j, 0 * i], axis=-1).reshape(-1, 3).astype(np.float64)
    return vertices, quads(n + 1, n + 1)


def quads(rows: int, columns: int, wrap: bool = False) -> NDArray[np.int64]:
    """Two triangles for each cell of rows x columns vertices, on a torus if they wrap."""
    i, j = np.meshgrid(np.arange(rows - (not wrap)), np.arange(columns - (not wrap)), indexing="ij")
    a, b = i * columns + j, (i + 1) % rows * columns + j
    c, d = (i + 1) % rows * columns + (j + 1) % columns, i * columns + (j + 1) % columns
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def cube() -> Mesh:
    """Closed, 12 triangles, corners at -1 and 1, facing outwards."""
    vertices = np.array(list(product((-1.0, 1.0), repeat=3)))
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return vertices, np.array([[s[0], s[i], s[i + 1]] for s in sides for i in (1, 2)])


def icosphere(level: int) -> Mesh:
    """Closed, 20 * 4^level triangles about the unit sphere."""
    golden = (1 + 5**0.5) / 2
    corners = [np.roll([0.0, a, b * golden], k) for k in range(3) for a in (-1, 1) for b in (-1, 1)]
    vertices = np.array(corners) / np.linalg.norm(corners[0])
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 1.1
    faces = np.array(
        [(i, j, k) for i, j, k in product(range(12), repeat=3) if i < j < k and near[i, j] & near[j, k] & near[i, k]]
    )
    for _ in range(level):
        a, b, c = faces.T
        ends = np.sort(np.concatenate([np.stack([a, b], 1), np.stack([b, c], 1), np.stack([c, a], 1)]), axis=1)
        ends, number = np.unique(ends, axis=0, return_inverse=True)
        ab, bc, ca = number.ravel().reshape(3, -1) + len(vertices)
        middles = vertices[ends].mean(axis=1)
        vertices = np.concatenate([vertices, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        faces = np.concatenate([np.stack(f, 1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    centre, normal = vertices[faces].mean(axis=1), np.cross(*np.diff(vertices[faces], axis=1).swapaxes(0, 1))
    return vertices, np.where(((centre * normal).sum(axis=1) < 0)[:, None], faces[:, ::-1], faces)


def torus(rings: int, sides: int) -> Mesh:
    """Closed; the circle of radius 1 in the plane z = 0 runs inside a tube of radius 0.4."""
    f, t = np.meshgrid(np.arange(rings) * 2 * np.pi / rings, np.arange(sides) * 2 * np.pi / sides, indexing="ij")
    r = 1 + 0.4 * np.cos(t)
    vertices = np.stack([r * np.cos(f), r * np.sin(f), 0.4 * np.sin(t)], axis=-1).reshape(-1, 3)
    return vertices, quads(rings, sides, wrap=True)


def fan(n: int) -> Mesh:
    """Closed, two cones base to base; n triangles meet in the vertex 0 at the top."""
    angle = np.arange(n) * 2 * np.pi / n
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    i, j = np.arange(n) + 2, (np.arange(n) + 1) % n + 2
    faces = np.concatenate([np.stack([0 * i, i, j], 1), np.stack([0 * i + 1, j, i], 1)])
    return np.concatenate([[[0.1, -0.05, 0.7], [0.0, 0.0, -0.6]], rim]), faces


# Closed meshes, and points inside them that see every wall or at least some wall in every direction.
CLOSED: dict[str, tuple[Callable[[], Mesh], F8]] = {
    "cube": (cube, np.array([[0, 0, 0], [0.3, -0.7, 0.2], [0.999, 0.999, 0.999]])),
    "icosphere": (lambda: icosphere(3), np.array([[0, 0, 0], [0.1, 0.2, -0.3], [0.5, 0.5, 0.5]])),
    "torus": (lambda: torus(40, 20), np.array([[1, 0, 0], [0.6, 0.8, 0.1], [-0.7, -0.7, 0.2]])),
    "fan": (lambda: fan(1000), np.array([[0, 0, 0], [0.09, -0.04, 0.6], [0.5, 0.2, -0.1]])),
}


# --- rays ------------------------------------------------------------------------------------------------------------


def anywhere(n: int, seed: int) -> tuple[F8, F8]:
    """Origins in and around the cube of side 2, directions of any length about 1."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (n, 3)), rng.normal(size=(n, 3))


def edge_points(mesh: Mesh, dtype: str, seed: int) -> NDArray[np.floating]:
    """All vertices, edges' middles and two more points on every edge, and each of them a few ulps to all sides."""
    vertices, faces = mesh[0].astype(dtype), mesh[1]
    rng = np.random.default_rng(seed)
    ends = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    share = np.stack([np.full(len(ends), 0.5), *rng.uniform(0, 1, (2, len(ends)))])[..., None].astype(dtype)
    on_edges = vertices[ends[:, 0]] + share * (vertices[ends[:, 1]] - vertices[ends[:, 0]])
    exact = np.concatenate([vertices, on_edges.reshape(-1, 3)])
    ulp = np.spacing(np.abs(exact).max(axis=1, keepdims=True))
    return np.concatenate([exact, exact + ulp * rng.integers(-3, 4, exact.shape).astype(dtype)])


def towards(origins: ArrayLike, targets: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Rays from every origin to every target, in the targets' precision."""
    origins = np.asarray(origins, targets.dtype)
    o = np.repeat(origins, len(targets), axis=0)
    return o, np.tile(targets, (len(origins), 1)) - o


def lattice(n: int, seed: int) -> tuple[F8, F8]:
    """Small integers; the components of a direction are 0, -0 or powers of two, so that nothing is rounded."""
    rng = np.random.default_rng(seed)
    directions = rng.choice([-2.0, -1.0, -0.0, 0.0, 1.0, 2.0], (n, 3))
    directions[(directions == 0).all(axis=1)] = 1.0
    return rng.integers(-4, 5, (n, 3)).astype(np.float64), directions


def signed_axes() -> F8:
    """All 24 ways to write a direction along an axis, with zeros of both signs."""
    signs = product((-1.0, 1.0), (-0.0, 0.0), (-0.0, 0.0))
    return np.array([np.roll(numbers, k) for numbers in signs for k in range(3)])


def bad_rays() -> tuple[F8, F8]:
    """Rays that hit nothing, though those that they are made of hit the triangle (0 0 0, 4 0 0, 0 4 0)."""
    bad = [np.nan, np.inf, -np.inf]
    o, d = np.full((18, 3), 1.0), np.full((18, 3), -1.0)
    for k, (i, value) in enumerate(product(range(6), bad)):
        (o if i < 3 else d)[k, i % 3] = value
    return np.concatenate([o, np.ones((3, 3))]), np.concatenate([d, [[0, 0, 0], [-0.0, 0.0, -0.0], [np.nan] * 3]])


# --- what to expect of them -------------------------------------------------------------------------------------------


def condition(mesh: Mesh, o: F8, d: F8) -> tuple[F8, F8, F8]:
    """How clearly each ray (n,) decides about each triangle (m,).

    Least distance of a barycentric weight from 0, over all weights; cosine between ray and normal; determinant.
    """
    v0, v1, v2 = np.moveaxis(mesh[0][mesh[1]], 1, 0)
    n = np.cross(v1 - v0, v2 - v0)
    weight = np.full((len(o), len(v0)), np.inf)
    axis = np.argmax(np.abs(d), axis=1)
    with np.errstate(all="ignore"):
        for kz in range(3):
            _, *edges = naive.crossings(*mesh, o[axis == kz], d[axis == kz], kz)
            weight[axis == kz] = np.min(np.abs(edges), axis=0) / np.abs(np.sum(edges, axis=0))
    det = np.abs(d @ n.T)
    return weight, det / (np.linalg.norm(d, axis=1)[:, None] * np.linalg.norm(n, axis=1)), det


def rounded(precision: str, *arrays: F8) -> tuple[F8, ...]:
    """Numbers of the precision, as float64: both twins see the same scene."""
    return tuple(array.astype(precision).astype(np.float64) for array in arrays)


# --- two ways through the tree ---------------------------------------------------------------------------------------


def kind(d: NDArray[np.floating]) -> NDArray[np.int64]:
    """Rays of one kind have the same signs and the same largest component."""
    return np.argmax(np.abs(d), axis=1) * 8 + (d < 0) @ np.array([1, 2, 4])


def packed(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> rt.Hits:
    """Nearest hits with rays of one kind beside each other, whole packets of them, so that they go side by side."""
    rows: list[NDArray[np.int64]] = []
    kinds = kind(d)
    for number in np.unique(kinds):
        mine = np.flatnonzero(kinds == number)
        rows.append(np.resize(mine, -(-len(mine) // PACKET) * PACKET))  # the last packet is filled with first ones
    order = np.concatenate(rows)
    return scattered(bvh.closest_hit(o[order], d[order], tmin), order, len(d))


def mixed(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> rt.Hits:
    """Nearest hits with every ray the only one of its packet that is alive, so that each goes through the tree alone.

    A few at a time: batches as small as that are traced in the order they have.
    """
    dead = np.full_like(d, np.nan)
    lone = np.stack([d, *[dead] * (PACKET - 1)], axis=1).reshape(-1, 3)
    parts = [slice(k, k + SAMPLE // PACKET - 1) for k in range(0, len(d), SAMPLE // PACKET - 1)] or [slice(0, 0)]
    hits = [
        bvh.closest_hit(np.repeat(o[part], PACKET, axis=0), lone[part.start * PACKET : part.stop * PACKET], tmin)
        for part in parts
    ]
    return rt.Hits(*(np.concatenate(columns)[::PACKET] for columns in zip(*hits, strict=True)))


def both_paths(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> Iterator[rt.Hits]:
    yield packed(bvh, o, d, tmin)
    yield mixed(bvh, o, d, tmin)


def scattered(hits: rt.Hits, order: NDArray[np.int64], n: int) -> rt.Hits:
    """Hits of rays ``order`` in the order of the rays."""
    columns = [np.empty(n, column.dtype) for column in hits]
    for column, values in zip(columns, hits, strict=True):
        column[order] = values
    return rt.Hits(*columns)


def same_bits(a: ArrayLike, b: ArrayLike) -> bool:
    """Equal shape, type and bits; any NaN is as good as another, zeros differ by their sign."""
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape or a.dtype != b.dtype:
        return False
    if a.dtype.kind != "f":
        return bool(np.array_equal(a, b))
    return bool(
        np.array_equal(a, b, equal_nan=True)
        and np.array_equal(np.signbit(a) | np.isnan(a), np.signbit(b) | np.isnan(b))
    )


def same_hits(a: rt.Hits, b: rt.Hits) -> bool:
    return all(same_bits(x, y) for x, y in zip(a, b, strict=True))
