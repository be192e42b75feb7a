"""What rays cost in nodes visited and triangles tested: figures that no clock can blur."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.accel import query
from raytrace.accel.inputs import columns_of
from raytrace.accel.lanes import BITS
from raytrace.records import Hits, Rays
from shipped_scenes import SCENES, load

pytestmark = pytest.mark.engine

N = 4096
# (scene, split): nodes visited and triangles tested by one random ray from a surface
# (measured once, on 2026-11-22, to notice when a change of build or traversal moves them; a pool, which only looks for
# the nearest child and leaves the others unsorted, visits up to 6 % more)
SINGLE = {
    ("cornell-box", "sah"): (1.0, 19.92),
    ("cornell-box", "median"): (1.0, 29.41),
    ("bumpy", "sah"): (9.45, 20.54),
    ("bumpy", "median"): (12.63, 31.01),
}
# the same by a bundle of camera rays, of a block of 8 x 8 pixels (2026-11-25); a triangle counts once for each packet
BUNDLE = {
    ("cornell-box", "sah"): (1.0, 18.0),
    ("cornell-box", "median"): (1.0, 12.0),
    ("bumpy", "sah"): (18.28, 146.56),
    ("bumpy", "median"): (23.48, 126.66),
}


def load_shipped(name):
    return load(next(path for path in SCENES if path.stem == name))


def counts_of(bvh, origins, directions):
    arrays = [np.asarray(a, np.float32) for a in (origins, directions, 0.0, np.inf)]
    n = len(directions)
    hits = Hits(np.empty(n, np.float32), np.empty(n, np.int32), np.empty(n, np.float32), np.empty(n, np.float32))
    work = bvh.pool_work()
    query.closest_hit(bvh.tree, Rays(*(columns_of(a, n) for a in arrays)), hits, n, work)
    return work.counts


def tree_of(name, split):
    mesh = load_shipped(name).mesh
    return rt.BVH(mesh.vertices, mesh.faces, split=split)


@pytest.mark.parametrize(("name", "split"), SINGLE)
def test_single_rays_visit_as_few_nodes_as_ever(name, split):
    bvh = tree_of(name, split)
    rng = np.random.default_rng(5)
    start = rng.choice(np.flatnonzero(np.isfinite(bvh.triangles[:, 9])), N)
    middle = bvh.triangles[start, :9].reshape(-1, 3, 3).mean(axis=1)
    d = rng.normal(size=(N, 3))  # of all kinds, so that hardly any packet is alike
    counts = counts_of(bvh, middle + 1e-3 * bvh.triangles[start, 9:], d)
    np.testing.assert_allclose(counts / N, SINGLE[name, split], rtol=0.06)


@pytest.mark.skipif(BITS != 512, reason="bundles of 64 rays need 512 bits; these counts are of such")
@pytest.mark.parametrize(("name", "split"), BUNDLE)
def test_bundles_visit_as_few_nodes_as_ever(name, split):
    scene = load_shipped(name)
    y, x = np.mgrid[0:64, 0:64]
    block = np.argsort(((y // 8 * 8 + x // 8) * 64 + y % 8 * 8 + x % 8).ravel())
    spread = np.tan(np.radians(scene.camera.fov / 2)) / 8  # the middle of a film of 512 x 512
    forward = scene.camera.look_at - scene.camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, scene.camera.up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    across, along = (((k.ravel()[block] + 0.5) / 32 - 1) * spread for k in (x, y))
    d = forward + across[:, None] * right + along[:, None] * down
    counts = counts_of(tree_of(name, split), scene.camera.position[None], d)
    np.testing.assert_allclose(counts / (len(d) / 64), BUNDLE[name, split], rtol=0.05)
