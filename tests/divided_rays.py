"""Meshes whose long triangles are divided among leaves, and rays aimed at the planes that divide them."""

import numpy as np

import raytrace as rt
from raytrace.accel.layout import boxes_of, children_of, triangles_of

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
BEAM = np.array([[0, 1, 3], [1, 2, 4], [2, 0, 5], [1, 4, 3], [2, 5, 4], [0, 3, 5], [0, 2, 1], [3, 4, 5]])


def beams(small: int, long: int, seed: int):
    """Small tetrahedra, and beams about 3 long and 0.05 wide, in every direction, in a cube of side 2; all closed."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (small, 1, 3)) + rng.normal(0, 0.01, (small, 4, 3))
    along, across = rng.normal(size=(2, long, 3))
    across = np.cross(along, across)
    third = np.cross(along, across)
    along, across, third = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in (along, across, third))
    turn = 2 * np.pi * np.arange(3)[:, None] / 3
    ring = 0.03 * (np.cos(turn) * across[:, None] + np.sin(turn) * third[:, None])
    middle = rng.uniform(-0.5, 0.5, (long, 1, 3))
    ends = np.concatenate([middle - 1.5 * along[:, None] + ring, middle + 1.5 * along[:, None] + ring], axis=1)
    faces = [TETRAHEDRON + 4 * np.arange(small)[:, None, None], BEAM + 6 * np.arange(long)[:, None, None] + 4 * small]
    vertices = np.concatenate([corners.reshape(-1, 3), ends.reshape(-1, 3)])
    return vertices, np.concatenate([part.reshape(-1, 3) for part in faces])


def aimed_at_cuts(bvh: rt.BVH, n: int, seed: int):
    """Rays to points of divided triangles, and of their edges, on the sides of leaf boxes, and a few roundings beside.

    A third comes from the scene, a third from far away, and a third almost in the plane of the triangle.
    """
    rng = np.random.default_rng(seed)
    child, prim = children_of(bvh.tree.nodes), triangles_of(bvh.tree.leaves)
    node, slot = np.nonzero(child < 0)
    box = np.empty((len(prim), 6))
    box[~child[node, slot]] = boxes_of(bvh.tree.nodes)[node, :, slot]
    leaf, lane = np.nonzero(prim >= 0)
    several = np.flatnonzero(np.bincount(prim[leaf, lane])[prim[leaf, lane]] > 1)
    k = rng.choice(several, n)
    number, side = prim[leaf[k], lane[k]], rng.integers(0, 6, n)
    x, axis, row = box[leaf[k], side], side % 3, np.arange(n)
    corners = np.take_along_axis(
        bvh.triangles[number, :9].reshape(-1, 3, 3).astype(float),
        rng.permuted(np.tile([0, 1, 2], (n, 1)), axis=1)[..., None],
        1,
    )
    a, b = corners[row, 0], corners[row, 1]
    b = np.where(rng.random((n, 1)) < 0.5, b, (b + corners[row, 2]) / 2)  # an edge, or a line through the interior
    with np.errstate(all="ignore"):
        share = np.nan_to_num((x - a[row, axis]) / (b[row, axis] - a[row, axis]), nan=0.5).clip(0, 1)
    target = a + (b - a) * share[:, None]
    target += rng.integers(-2, 3, (n, 3)) * np.finfo(bvh.precision).eps * np.abs(target)
    normal = bvh.triangles[number, 9:].astype(float)
    flat = np.cross(normal, rng.normal(size=(n, 3)))
    flat += normal * 10.0 ** rng.uniform(-9, -1, (n, 1))
    away = [rng.normal(size=(n, 3)), 1e3 * rng.normal(size=(n, 3)), flat]
    o = target + np.choose(rng.integers(0, 3, (n, 1)), away)
    return np.concatenate([o, o]), np.concatenate([target - o, rng.uniform(-1, 1, (n, 3)) * 1e-7 + target - o])
