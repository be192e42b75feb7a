"""Closed meshes that are hard for counts of crossings, and rays and points aimed at them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import DTypeLike

from raytrace.hardcases.aiming import Reals, edge_points, lattice, signed_axes
from raytrace.hardcases.meshes import Mesh, choice, cube, cubes, fan, grid, icosphere, joined, torus, turned, uniform


def grid_box(n: int) -> Mesh:
    """A closed cube [0, 1]^3 whose sides are grids: many coplanar triangles; vertices are not shared by sides."""
    vertices, faces = grid(n)
    return joined(*((np.roll(vertices / n + [0, 0, z], k, axis=1), faces) for k in range(3) for z in (0.0, 1.0)))


def sliver_box(aspect: float) -> Mesh:
    """A closed box with a band of slivers of this aspect ratio around it."""
    heights = np.array([0.0, 0.3, 0.3 + 1 / aspect, 0.3 + 2 / aspect, 1.0])
    ring = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    vertices = np.concatenate([np.column_stack([ring, np.full(4, z)]) for z in heights])
    faces = []
    for level in range(len(heights) - 1):
        for k in range(4):
            a, b = 4 * level + k, 4 * level + (k + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    top = 4 * (len(heights) - 1)
    faces += [[0, 2, 1], [0, 3, 2], [top, top + 1, top + 2], [top, top + 2, top + 3]]
    return vertices, np.array(faces)


def filled_junctions(seed: int) -> Mesh:
    """Tetrahedra whose edges have a vertex in the middle on one side; triangles of almost no area fill the gaps."""
    corners, faces = [], []
    for k in range(12):
        a, b, c, d = uniform(seed + k, 4, 3)
        start = 5 * k
        corners += [a, b, c, d, (a + b) / 2]
        faces += [[0, 4, 2], [4, 1, 2], [0, 1, 3], [0, 1, 4], [0, 2, 3], [1, 2, 3]]
        faces[-6:] = [[start + i for i in face] for face in faces[-6:]]
    return np.array(corners), np.array(faces)


def thrice(mesh: Mesh) -> Mesh:
    """A mesh three times: with shared vertices, with its own, and turned round."""
    vertices, faces = mesh
    return joined((vertices, np.concatenate([faces, faces[:, [1, 2, 0]]])), (vertices, faces[:, ::-1]))


def with_points(mesh: Mesh) -> Mesh:
    """A mesh and triangles without area: repeated corners."""
    vertices, faces = mesh
    return vertices, np.concatenate([faces, faces[:, [0, 1, 1]], faces[:, [2, 2, 2]]])


CLOSED_MESHES: dict[str, Callable[[], Mesh]] = {
    "cube": cube,
    "cubes that touch": lambda: cubes(2),
    "icosphere": lambda: icosphere(1),
    "torus": lambda: torus(16, 10),
    "fan": lambda: fan(60),
    "coplanar faces": lambda: grid_box(4),
    "slivers": lambda: sliver_box(1e6),
    "turned slivers": lambda: (turned(sliver_box(1e8)[0]), sliver_box(1e8)[1]),
    "filled junctions": lambda: filled_junctions(50),
    "three times": lambda: thrice(icosphere(1)),
    "triangles without area": lambda: with_points(cube()),
    "far away": lambda: (icosphere(1)[0] + [1000.0, -2000.0, 500.0], icosphere(1)[1]),
}


def aimed_points(mesh: Mesh, dtype: DTypeLike, seed: int, n: int) -> Reals:
    """About n points: on vertices and edges and a few ulps off, with coordinates of vertices, on faces, anywhere."""
    vertices, faces = mesh[0].astype(dtype), mesh[1]
    corners = vertices[faces]
    share = (uniform(seed, 2, len(faces), 1) + 1) / 3
    on_faces = corners[:, 0] + share[0] * (corners[:, 1] - corners[:, 0]) + share[1] * (corners[:, 2] - corners[:, 0])
    number = ((uniform(seed + 1, n // 4, 3) + 1) / 2 * len(vertices)).astype(int)
    mixed = np.stack([vertices[number[:, axis], axis] for axis in range(3)], axis=1)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    anywhere = low + (uniform(seed + 2, n // 4, 3) + 1) / 2 * (high - low)
    edges = edge_points(mesh, dtype, seed + 3)
    points = np.concatenate(
        [part.astype(dtype) for part in (edges[:: max(1, 2 * len(edges) // n)], on_faces, mixed, anywhere)]
    )
    return np.resize(points, (n, 3))


def aimed_rays(mesh: Mesh, dtype: DTypeLike, seed: int, n: int) -> tuple[Reals, Reals]:
    """About n rays: from aimed points and from afar to others, along edges, in faces, along axes, on a lattice."""
    vertices, faces = mesh[0].astype(dtype), mesh[1]
    targets, part = aimed_points(mesh, dtype, seed + 9, n), n // 5
    size = vertices.max(axis=0) - vertices.min(axis=0)
    afar = (vertices.mean(axis=0) + 3 * size * uniform(seed, part, 3)).astype(dtype)
    near = targets[np.arange(part) * 7 % n]
    number = ((uniform(seed + 1, part) + 1) / 2 * len(faces)).astype(int)
    start, end, third = (vertices[faces[number, k]] for k in range(3))
    along = end - start
    back = start - along * choice(seed + 2, [0.0, 0.5, 1.0, 2.0], part, 1).astype(dtype)
    weight = choice(seed + 3, [-1.0, 0.0, 0.5, 2.0], part, 1).astype(dtype)
    axes = signed_axes()[np.arange(part) % 24].astype(dtype)
    o = [afar, near, back, start + weight * along, targets[:part] - axes * size.max() * 2]
    d = [targets[:part] - afar, targets[part : 2 * part] - near, along, third - start, axes]
    if size.max() < 10:
        o_lattice, d_lattice = lattice(part, seed + 4)
        o, d = [*o, (o_lattice / 4).astype(dtype)], [*d, d_lattice.astype(dtype)]
    origins, directions = np.concatenate(o).astype(dtype), np.concatenate(d).astype(dtype)
    keep = (directions != 0).any(axis=1) & np.isfinite(directions).all(axis=1)
    return origins[keep], directions[keep]
