"""Meshes that are hard for ray tracers, and addressed random numbers to aim rays at them."""

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Faces = NDArray[np.int64]
Mesh = tuple[Doubles, Faces]  # vertices (v, 3) and faces (m, 3)


def uniform(seed: int, *shape: int) -> Doubles:
    """Random numbers in [-1, 1), each a hash of the seed and its index.

    >>> bool((uniform(1, 8, 3)[:4] == uniform(1, 4, 3)).all())
    True
    """
    from raytrace.jit import interpreted
    from raytrace.passes.sampling import mix

    place = np.arange(2 * int(np.prod(shape)), dtype=np.uint32)
    bits = interpreted(mix)(interpreted(mix)(np.full_like(place, seed)) + place).astype(np.float64).reshape(-1, 2)
    return (((bits[:, 0] // 2**5) * 2.0**26 + bits[:, 1] // 2**6) * 2.0**-52 - 1.0).reshape(shape)


def choice(seed: int, values: list[float], *shape: int) -> Doubles:
    """Random choices from these values, each a hash of the seed and its index."""
    return np.array(values)[((uniform(seed, *shape) + 1) * 0.5 * len(values)).astype(int)]


def quads(rows: int, columns: int, wrap: bool = False) -> Faces:
    """Two triangles per cell of a grid of rows x columns vertices; ``wrap`` joins the borders to a torus."""
    i, j = np.meshgrid(np.arange(rows - (not wrap)), np.arange(columns - (not wrap)), indexing="ij")
    a, b = i * columns + j, (i + 1) % rows * columns + j
    c, d = (i + 1) % rows * columns + (j + 1) % columns, i * columns + (j + 1) % columns
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def grid(n: int) -> Mesh:
    """2 n^2 triangles over [0, n]^2 in the plane z = 0, facing +z; vertex (i, j) has number i (n + 1) + j."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    vertices = np.stack([i, j, 0 * i], axis=-1).reshape(-1, 3).astype(np.float64)
    return vertices, quads(n + 1, n + 1)


def cube() -> Mesh:
    """A closed cube of 12 triangles with corners at -1 and 1, facing outwards."""
    vertices = np.array(list(product((-1.0, 1.0), repeat=3)))
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return vertices, np.array([[s[0], s[i], s[i + 1]] for s in sides for i in (1, 2)])


def cubes(n: int) -> Mesh:
    """n^3 closed unit cubes that fill a large cube about the origin; neighbours touch but share no vertices."""
    vertices, faces = cube()
    middles = np.array(list(product(np.arange(n) - (n - 1) / 2, repeat=3)))
    corners = (vertices * 0.5 + middles[:, None]).reshape(-1, 3)
    return corners, (faces + 8 * np.arange(len(middles))[:, None, None]).reshape(-1, 3)


def icosphere(level: int) -> Mesh:
    """A closed sphere of 20 * 4^level triangles with vertices on the unit sphere."""
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
    """A closed torus: a tube of radius 0.4 around the circle of radius 1 in the plane z = 0."""
    f, t = np.meshgrid(np.arange(rings) * 2 * np.pi / rings, np.arange(sides) * 2 * np.pi / sides, indexing="ij")
    r = 1 + 0.4 * np.cos(t)
    vertices = np.stack([r * np.cos(f), r * np.sin(f), 0.4 * np.sin(t)], axis=-1).reshape(-1, 3)
    return vertices, quads(rings, sides, wrap=True)


def fan(n: int) -> Mesh:
    """A closed double cone; n triangles meet at the top, vertex 0."""
    angle = np.arange(n) * 2 * np.pi / n
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    i, j = np.arange(n) + 2, (np.arange(n) + 1) % n + 2
    faces = np.concatenate([np.stack([0 * i, i, j], 1), np.stack([0 * i + 1, j, i], 1)])
    return np.concatenate([[[0.1, -0.05, 0.7], [0.0, 0.0, -0.6]], rim]), faces


def strip(n: int, aspect: float) -> Mesh:
    """A square about the origin in the plane z = 0, with a band of 2 n slivers of this aspect ratio along x."""
    y = np.concatenate([[-0.5], np.arange(n + 1) / aspect, [0.5]])
    vertices = np.stack([np.stack([0 * y - 0.5, y, 0 * y], 1), np.stack([0 * y + 0.5, y, 0 * y], 1)])
    return vertices.reshape(-1, 3), quads(2, n + 3)


def flat(seed: int) -> Mesh:
    """12 triangles without area around the cube [-1, 1]^3: collinear corners, repeated corners, points."""
    a, b = choice(seed, [-1.0, -0.5, 0.0, 0.5, 1.0], 2, 12, 3)
    b = np.where(np.abs(a - b).sum(axis=1, keepdims=True) == 0, -a - 1.0, b)
    third = [(a + b) / 2, a, b, 2 * b - a]
    corners = np.stack([a, b, np.choose(np.arange(12)[:, None] % 4, third)], axis=1)
    corners[::6] = corners[::6, :1]
    return corners.reshape(-1, 3), np.arange(36).reshape(-1, 3)


def joined(*meshes: Mesh) -> Mesh:
    """Join several meshes into one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def turned(points: Doubles) -> Doubles:
    """Points rotated about an axis in general direction: the rotation of the quaternion (1, 2, 3, 4)."""
    rotation = np.array([[-20.0, 4.0, 22.0], [20.0, -10.0, 20.0], [10.0, 28.0, 4.0]]) / 30
    return points @ rotation.T


# Closed meshes, and points inside them: every ray from such a point must hit the mesh.
CLOSED: dict[str, tuple[Callable[[], Mesh], Doubles]] = {
    "cube": (cube, np.array([[0, 0, 0], [0.3, -0.7, 0.2], [0.999, 0.999, 0.999]])),
    "icosphere": (lambda: icosphere(3), np.array([[0, 0, 0], [0.1, 0.2, -0.3], [0.5, 0.5, 0.5]])),
    "torus": (lambda: torus(40, 20), np.array([[1, 0, 0], [0.6, 0.8, 0.1], [-0.7, -0.7, 0.2]])),
    "fan": (lambda: fan(1000), np.array([[0, 0, 0], [0.09, -0.04, 0.6], [0.5, 0.2, -0.1]])),
}
