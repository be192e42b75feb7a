"""Meshes, and the rays that an image of each needs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from building import temple
from harness import ROOT

import raytrace as rt

SIDE = 1024  # camera rays along each side of the film
BLOCK = 4  # pixels: side of a block, which is one packet of 16 rays


class Mesh(NamedTuple):
    """A mesh, a camera and a point light."""

    name: str
    vertices: np.ndarray  # (v, 3) f4
    faces: np.ndarray  # (m, 3) i4
    eye: tuple[float, float, float]  # the camera looks along -z
    slope: float  # half the film's side at distance 1
    light: tuple[float, float, float]


class RaySet(NamedTuple):
    """Rays o + t d for t in (0, tmax)."""

    name: str
    any_hit: bool  # whether they hit anything, instead of the closest hit
    o: np.ndarray  # (n, 3) f4
    d: np.ndarray  # (n, 3) f4; the light is at t = 1 of shadow rays
    tmax: float


def box() -> Mesh:
    mesh = rt.load(ROOT / "scenes/cornell-box.json").mesh
    return _mesh("box", mesh.vertices, mesh.faces, (0, 1, 6.8), np.tan(np.radians(19.5 / 2)), (0, 1.5, 0.5))


def sphere() -> Mesh:
    """Return the displaced sphere of scenes/bumpy.json: its object with the most triangles."""
    mesh = rt.load(ROOT / "scenes/bumpy.json").mesh
    faces = mesh.faces[mesh.object_id == np.bincount(mesh.object_id).argmax()]
    used, faces = np.unique(faces, return_inverse=True)
    vertices = mesh.vertices[used]
    vertices -= (vertices.max(0) + vertices.min(0)) / 2
    return _mesh("sphere", vertices / np.abs(vertices).max(), faces.reshape(-1, 3), (0, 0, 3), 0.36, (-2, 3, 4))


def soup(count: int = 1_000_000) -> Mesh:
    """Return random small triangles, with edges of about 0.02, in a cube of side 2."""
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(0, 0.01, (count, 3, 3))
    return _separate("soup", corners)


def slivers(count: int = 20_000) -> Mesh:
    """Return random triangles, 0.2 long and 0.001 wide, in every direction."""
    rng = np.random.default_rng(2)
    centre, along, across = rng.uniform(-1, 1, (count, 3)), *rng.normal(0, 1, (2, count, 3))
    along *= 0.1 / np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, across)
    across *= 0.001 / np.linalg.norm(across, axis=1, keepdims=True)
    return _separate("slivers", centre[:, None] + np.stack([-along, along, across - along], 1))


def building(count: int = 350_000) -> Mesh:
    """Return a temple of about so many triangles, long thin ones beside small ones."""
    return _mesh("building", *temple(count), (4, 3, 52), 0.42, (-30, 40, 60))


MESHES: dict[str, Callable[[], Mesh]] = {
    "box": box,
    "sphere": sphere,
    "soup": soup,
    "slivers": slivers,
    "building": building,
}


def _separate(name: str, corners: np.ndarray) -> Mesh:
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    return _mesh(name, corners.reshape(-1, 3), faces, (0, 0, 4), 0.36, (-2, 3, 4))


def _mesh(name: str, vertices: np.ndarray, faces: np.ndarray, eye: tuple, slope: float, light: tuple) -> Mesh:
    return Mesh(name, np.ascontiguousarray(vertices, "f4"), np.ascontiguousarray(faces, "i4"), eye, slope, light)


def ray_sets(mesh: Mesh) -> list[RaySet]:
    """Return camera rays and shadow rays of their hits, in rows and in blocks of 4 x 4 pixels, and diffuse bounces."""
    bvh = rt.BVH(mesh.vertices, mesh.faces)
    sets = []
    for order, pixels in (("rows", np.arange(SIDE**2)), ("blocks", _blocks())):
        o, d = camera_rays(mesh, pixels)
        p, ng = _landed(mesh, bvh, o, d)
        sets += [RaySet(f"camera, {order}", False, o, d, np.inf)]
        sets += [RaySet(f"shadow, {order}", True, p, np.float32(mesh.light) - p, 1.0)]
    rng = np.random.default_rng(3)
    shuffled = rng.permutation(len(p))
    p, ng = p[shuffled], ng[shuffled]
    d = rng.normal(0, 1, p.shape)
    d = ng + d / np.linalg.norm(d, axis=1, keepdims=True)  # a unit normal plus a uniform unit vector: cosine-weighted
    return [*sets, RaySet("bounce, random", False, p, d.astype("f4"), np.inf)]


def _blocks() -> np.ndarray:
    """Return the numbers of the pixels, block after block."""
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    key = ((y // BLOCK * (SIDE // BLOCK) + x // BLOCK) * BLOCK + y % BLOCK) * BLOCK + x % BLOCK
    return np.argsort(key.ravel())


def camera_rays(mesh: Mesh, pixels: np.ndarray, side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """Return the rays through pixels, given by their numbers in rows, of an image with so many pixels on each side."""
    x, y = ((pixels % side + 0.5) / side * 2 - 1), (1 - (pixels // side + 0.5) / side * 2)
    d = np.stack([x * mesh.slope, y * mesh.slope, -np.ones(len(x))], 1)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return np.tile(np.float32(mesh.eye), (len(d), 1)), d.astype("f4")


def _landed(mesh: Mesh, bvh: rt.BVH, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return hit points and normals that face the viewer.

    The points are offset along the normal by more than the rounding error of any tracer.
    """
    hits = bvh.closest_hit(o, d)
    hit = hits.prim_id >= 0
    surface = bvh.surface(hits)
    ng = surface.ng[hit] * -np.sign(np.sum(surface.ng[hit] * d[hit], 1, keepdims=True))
    return surface.p[hit] + np.float32(1e-4) * ng, ng
