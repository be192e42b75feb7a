"""Meshes and rays that break ray tracers, by name; whatever is random has a seed."""

import functools
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

import naive
import raytrace as rt
from raytrace.accel.lanes import PACKET  # noqa: F401
from raytrace.hardcases import tracers
from raytrace.hardcases.aiming import bad_rays, edge_points, lattice, signed_axes, towards  # noqa: F401
from raytrace.hardcases.meshes import CLOSED, cube, cubes, fan, grid, icosphere, joined, quads, torus  # noqa: F401
from raytrace.hardcases.tracers import octant_and_axis, scattered  # noqa: F401

F8 = NDArray[np.float64]
Mesh = tuple[F8, NDArray[np.int64]]


# --- meshes ----------------------------------------------------------------------------------------------------------


def soup(n: int, seed: int, size: float = 0.5) -> Mesh:
    """n triangles of about that size, anywhere in a cube of side 2; no two share a vertex."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3)


# --- rays ------------------------------------------------------------------------------------------------------------


def anywhere(n: int, seed: int) -> tuple[F8, F8]:
    """Origins in and around the cube of side 2, directions of any length about 1."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (n, 3)), rng.normal(size=(n, 3))


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


# --- three ways through the tree -------------------------------------------------------------------------------------


def packed(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> rt.Hits:
    """Nearest hits with rays of one kind beside each other, whole packets of them, so that they go side by side."""
    return tracers.packed(bvh.closest_hit, o, d, tmin)


def mixed(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> rt.Hits:
    """Nearest hits with every ray the only one of its packet that is alive, so that each goes alone."""
    return tracers.alone(functools.partial(tracers.closest_as_given, bvh), o, d, tmin)


def bundled(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> rt.Hits:
    """Nearest hits with every ray the only one of its bundle that is alive, behind a frustum of its own."""
    return tracers.bundled(functools.partial(tracers.closest_as_given, bvh), o, d, tmin)


def all_paths(bvh: rt.BVH, o: NDArray[np.floating], d: NDArray[np.floating], tmin: float = 0.0) -> Iterator[rt.Hits]:
    yield packed(bvh, o, d, tmin)
    yield mixed(bvh, o, d, tmin)
    yield bundled(bvh, o, d, tmin)


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
