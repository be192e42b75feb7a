"""Origins and targets of hard rays."""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from raytrace.hardcases.meshes import Doubles, Faces, choice, uniform

Reals = NDArray[np.floating]


def edge_points(mesh: tuple[Reals, Faces], dtype: DTypeLike, seed: int) -> Reals:
    """Vertices, edge midpoints, two more points per edge; then each of them again, moved by a few ulps."""
    vertices, faces = mesh[0].astype(dtype), mesh[1]
    ends = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    share = np.stack([np.full(len(ends), 0.5), *(uniform(seed, 2, len(ends)) + 1) / 2])[..., None].astype(dtype)
    on_edges = vertices[ends[:, 0]] + share * (vertices[ends[:, 1]] - vertices[ends[:, 0]])
    exact = np.concatenate([vertices, on_edges.reshape(-1, 3)])
    ulp = np.spacing(np.abs(exact).max(axis=1, keepdims=True))
    return np.concatenate([exact, exact + ulp * np.floor(3.5 * uniform(seed + 1, *exact.shape) + 0.5).astype(dtype)])


def towards(origins: ArrayLike, targets: Reals) -> tuple[Reals, Reals]:
    """Origins and directions of rays from every origin to every target, in the precision of the targets."""
    origins = np.asarray(origins, targets.dtype)
    o = np.repeat(origins, len(targets), axis=0)
    return o, np.tile(targets, (len(origins), 1)) - o


def lattice(n: int, seed: int) -> tuple[Doubles, Doubles]:
    """Rays with small integers as origins. Components of directions are 0, -0, +-1 or +-2: nothing is rounded."""
    directions = choice(seed, [-2.0, -1.0, -0.0, 0.0, 1.0, 2.0], n, 3)
    directions[(directions == 0).all(axis=1)] = 1.0
    return np.floor(4.5 * uniform(seed + 1, n, 3) + 0.5), directions


def signed_axes() -> Doubles:
    """All 24 unit directions along an axis, with zeros of both signs."""
    signs = product((-1.0, 1.0), (-0.0, 0.0), (-0.0, 0.0))
    return np.array([np.roll(numbers, k) for numbers in signs for k in range(3)])


def bad_rays() -> tuple[Doubles, Doubles]:
    """Invalid rays, which hit nothing: NaN, inf or direction 0. Otherwise they would hit (0 0 0, 4 0 0, 0 4 0)."""
    bad = [np.nan, np.inf, -np.inf]
    o, d = np.full((18, 3), 1.0), np.full((18, 3), -1.0)
    for k, (i, value) in enumerate(product(range(6), bad)):
        (o if i < 3 else d)[k, i % 3] = value
    return np.concatenate([o, np.ones((3, 3))]), np.concatenate([d, [[0, 0, 0], [-0.0, 0.0, -0.0], [np.nan] * 3]])
