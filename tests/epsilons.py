"""A renderer with magic constants, as courses teach it: right at one size, wrong at all others.

Triangles vanish where |det| < 1e-5, and rays count hits only past 1e-4, from a point that is o + t d. Diffuse surfaces
and point lights, in float32. ``python tests/epsilons.py`` draws the scenes of ``scenes/hard`` into ``docs/pictures``:
on the left with these constants, on the right as the package does.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import raytrace as rt
from raytrace.image.files import png_bytes
from raytrace.passes.camera import make_view
from raytrace.records import Scene

ROOT = Path(__file__).parents[1]
HARD = sorted((ROOT / "scenes/hard").glob("*.json"))

OFFSET = np.float32(1e-4)  # world units, whatever the scene's size
GRID = 2  # samples along each side of a pixel


def render(scene: Scene, size: tuple[int, int]) -> NDArray[np.float32]:
    """Linear picture (h, w, 3)."""
    bvh = rt.BVH(scene.mesh.vertices, scene.mesh.faces, "float32", triangle="moller-trumbore")
    width, height = size
    samples = [_radiance(scene, bvh, _directions(scene, size, k)) for k in range(GRID * GRID)]
    return np.mean(samples, axis=0, dtype=np.float32).reshape(height, width, 3)


def _directions(scene: Scene, size: tuple[int, int], sample: int) -> NDArray[np.float32]:
    """Unit directions through one point of the grid of each pixel."""
    view = make_view(scene.camera, size, np.dtype(np.float32))
    y, x = np.mgrid[0 : size[1], 0 : size[0]].reshape(2, -1, 1).astype(np.float32)
    x += np.float32((sample % GRID + 0.5) / GRID) - view.centre[0]
    y += np.float32((sample // GRID + 0.5) / GRID) - view.centre[1]
    return _unit(view.forward + x * view.right + y * view.down)


def _unit(a: NDArray[np.float32]) -> NDArray[np.float32]:
    return a / np.linalg.norm(a, axis=1, keepdims=True)


def _radiance(scene: Scene, bvh: rt.BVH, d: NDArray[np.float32]) -> NDArray[np.float32]:
    origin = scene.camera.position.astype(np.float32)
    hits = bvh.closest_hit(origin, d)
    found = np.flatnonzero(hits.prim_id >= 0)
    d, prim = d[found], hits.prim_id[found]
    p = origin + hits.t[found, None] * d
    ng = bvh.surface(hits).ng[found]
    result = np.tile(scene.background.astype(np.float32), (len(hits.t), 1))
    result[found] = 0
    for position, flux in zip(scene.lights.position.astype(np.float32), scene.lights.flux, strict=True):
        to_light = position - p
        distance = np.linalg.norm(to_light, axis=1)
        wi = to_light / distance[:, None]
        cosine = (wi * ng).sum(axis=1)
        lit = np.flatnonzero((cosine > 0) & ((d * ng).sum(axis=1) < 0))
        lit = lit[~bvh.any_hit(p[lit], wi[lit], OFFSET, distance[lit] - OFFSET)]
        arriving = cosine[lit] / (4 * np.pi * distance[lit] ** 2)
        albedo = scene.materials.albedo[scene.mesh.material_id[prim[lit]]]
        result[found[lit]] += (albedo / np.pi * flux * arriving[:, None]).astype(np.float32)
    return result


def draw(path: Path, side: int = 256) -> bytes:
    """PNG of a scene, both ways side by side."""
    scene = rt.load(path)
    pictures = render(scene, (side, side)), rt.render(scene, size=(side, side)).rgb
    return png_bytes(np.concatenate([pictures[0], np.ones((side, 4, 3), np.float32), pictures[1]], axis=1))


if __name__ == "__main__":
    for scene_file in HARD:
        (ROOT / f"docs/pictures/hard-{scene_file.stem}.png").write_bytes(draw(scene_file))
