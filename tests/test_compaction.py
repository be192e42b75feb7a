"""Packing of paths: none is lost, none is doubled, and all columns of a path stay together."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.passes import compaction
from raytrace.passes.camera import make_view
from raytrace.passes.paths import DEAD
from raytrace.passes.sampling import make_sampler
from raytrace.rendering.compiled_scene import compiled_of, paths_of, plan_of
from raytrace.rendering.path_wavefront import PathWavefront

SCENE = {
    "camera": {"position": [0, 0, 4], "look_at": [0, 0, 0], "fov": 40},
    "render": {"integrator": "path"},
    "lights": [{"type": "environment", "radiance": [1, 1, 1]}],
    "materials": {"grey": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
    "objects": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}],
}
SIZE, N = (16, 16), 768


@pytest.fixture(scope="module", params=["float32", "float64"])
def front(request):
    """A wavefront of paths for N samples, with random numbers in all columns of its paths."""
    scene = rt.load(SCENE)
    compiled = compiled_of(scene, plan_of(scene), request.param)
    view = make_view(scene.camera, SIZE, np.dtype(request.param))
    made = PathWavefront(paths_of(scene, compiled, "path"), view, make_sampler("sobol", 0, 16), N)
    return made


def fill(front, seed):
    """Random paths, a third of them ended."""
    rng, paths = np.random.default_rng(seed), front.paths
    for column in (paths.rays.o, paths.rays.d, paths.throughput, paths.scale, paths.pdf):
        column[:] = rng.uniform(-1, 1, len(column))
    for column in (paths.key, paths.sample, paths.rays.slot):
        column[:] = rng.integers(0, 2**31, len(column))
    paths.state[:] = rng.choice([0, 1, DEAD], len(paths.state))


def keys(o, d, grid):
    """Octant, dominant axis and cell of each ray, by NumPy; (3, n) arrays."""
    size = np.abs(d)
    kind = np.where((size[0] >= size[1]) & (size[0] >= size[2]), 0, np.where(size[1] >= size[2], 8, 16))
    kind += ((d < 0) * np.array([[1], [2], [4]])).sum(axis=0)
    cell = np.zeros(o.shape[1], int)
    for axis in range(3):
        at = np.clip((o[axis] - grid.low[axis]) * grid.scale[axis], 0, 2**grid.bits - 1).astype(int)
        for bit in range(grid.bits):
            cell |= (at >> bit & 1) << (3 * bit + axis)
    return (kind << 3 * grid.bits) + cell


def rows(front, column, n):
    """The first n rows of a column, or of three."""
    size = len(front.paths.pdf)
    return column.reshape(-1, size)[:, :n]


@pytest.mark.parametrize("n", [N, 301, 16, 1, 0])
def test_paths_that_go_on_keep_their_columns_and_are_sorted(front, n):
    fill(front, n)
    before = type(front.paths)(*(c if isinstance(c, tuple) else c.copy() for c in front.paths))
    alive = np.flatnonzero((before.state[:n] & DEAD) == 0)
    order = keys(rows(front, before.rays.o, n)[:, alive], rows(front, before.rays.d, n)[:, alive], front.grid)
    expected = alive[np.argsort(order, kind="stable")]
    assert compaction.go_on(front.paths, n, 1, front.grid, front.order, front.others) == len(alive)
    pairs = [(before.rays.o, front.others.rays.o), (before.rays.d, front.others.rays.d)]
    pairs += [(before.rays.slot, front.others.rays.slot), *zip(before[1:], front.others[1:], strict=True)]
    for column, out in pairs:
        assert np.array_equal(rows(front, out, len(alive)), rows(front, column, n)[:, expected])


@pytest.mark.parametrize("n", [N, 301, 1, 0])
def test_shadow_rays_that_exist_are_packed_and_their_light_finds_its_sample(front, n):
    fill(front, 100 + n)
    rng, incident, size = np.random.default_rng(n), front.incident, len(front.paths.pdf)
    for column in (incident.o, incident.d, incident.radiance):
        column[:] = rng.uniform(-1, 1, len(column))
    incident.tmax[:] = rng.choice([-1, 1, np.inf], size)
    there = np.flatnonzero(incident.tmax[:n] > 0)
    order = keys(rows(front, incident.o, n)[:, there], rows(front, incident.d, n)[:, there], front.grid)
    expected = there[np.argsort(order, kind="stable")]
    packed = compaction.pack_shadow_rays(incident, n, front.grid, front.order, front.others)
    assert packed == len(there)
    for column, out in ((incident.o, front.others.rays.o), (incident.d, front.others.rays.d)):
        assert np.array_equal(rows(front, out, packed), rows(front, column, n)[:, expected])
    assert np.array_equal(front.others.pdf[:packed], incident.tmax[expected])

    slots = rng.permutation(size).astype(np.int32)
    front.paths.rays.slot[:] = slots
    incident.occluded[:size] = rng.random(size) < 0.5
    front.radiance[:] = 0
    compaction.add_light(front.paths, packed, incident, front.order, front.radiance)
    wanted = np.zeros((3, size), front.radiance.dtype)
    lit = expected[~incident.occluded[:packed]]
    wanted[:, slots[lit]] = rows(front, incident.radiance, n)[:, lit]
    assert np.array_equal(front.radiance.reshape(3, -1), wanted)


def test_the_packing_changes_no_bit_of_an_image(monkeypatch):
    scene = rt.load(SCENE)
    images = []
    for bits in (0, 1, 2):
        monkeypatch.setattr(compaction, "CELL_BITS", bits)
        images.append(rt.render(scene, spp=4, size=SIZE, threads=1).rgb)
    assert np.array_equal(images[0], images[1])
    assert np.array_equal(images[0], images[2])
