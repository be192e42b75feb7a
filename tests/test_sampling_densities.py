"""Chi-square tests of every sampling routine of path tracing against its density, with fixed seeds.

A routine of the unit square is called with independent random numbers as plain Python on arrays. A pass of kernels is
called on many paths that start at one point; the density is computed here, by other formulas than those of the kernels.
"""

import math

import numpy as np
import pytest
from scipy import stats

import raytrace as rt
from light_cases import GLASS, PLANE, diffuse, environment, scene
from light_techniques import sidak
from raytrace.passes import warp
from raytrace.passes.compaction import go_on
from raytrace.passes.paths import DEAD, ROULETTE_FROM, SURVIVE
from raytrace.rendering import path_wavefront
from raytrace.testing.samplers import pearson
from small_scenes import box, quad

N = 400_000
TESTS = 16  # of this file
LEVEL = sidak(1e-3, TESTS)


def p_value(counts, expected):
    """Pearson's chi-square test of all samples."""
    counts, expected = np.ravel(counts).astype(float), np.ravel(expected).astype(float)
    assert counts[expected == 0].sum() <= 1e-4 * counts.sum()  # bins that numerical integration barely misses
    assert expected.sum() == pytest.approx(counts.sum(), rel=1e-3)  # the density integrates to 1
    return pearson(counts, expected, counts.sum()).p_value


def binned(a, b, a_range, b_range, bins=16):
    return np.histogram2d(a, b, bins, (a_range, b_range))[0]


def square(seed):
    return np.random.default_rng(seed).random((2, N))


# --- the unit square to where samples are wanted ---------------------------------------------------------------------


def test_disc():
    x, y, rest = warp.disc(*square(1))
    counts = binned(x * x + y * y, np.arctan2(y, x), (0, 1), (-math.pi, math.pi))  # equal areas
    assert p_value(counts, np.full(counts.shape, N / counts.size)) > LEVEL
    np.testing.assert_allclose(rest, 1 - x * x - y * y, atol=1e-12)


def test_cosine_hemisphere():
    x, y, z = warp.cosine_hemisphere(*square(2))
    counts = binned(z, np.arctan2(y, x), (0, 1), (-math.pi, math.pi))
    edge = np.linspace(0, 1, 17)
    share = (edge[1:] ** 2 - edge[:-1] ** 2)[:, None] / 16  # the integral of z / pi over dz dphi
    assert p_value(counts, N * share * np.ones((1, 16))) > LEVEL


def test_sphere():
    x, y, z = warp.sphere(*square(3))
    counts = binned(z, np.arctan2(y, x), (-1, 1), (-math.pi, math.pi))  # equal areas [Archimedes]
    assert p_value(counts, np.full(counts.shape, N / counts.size)) > LEVEL


def test_triangle():
    u, v = warp.triangle(*square(4))
    assert (u >= 0).all()
    assert (v >= 0).all()
    assert (u + v <= 1 + 1e-12).all()
    counts = binned(u, v, (0, 1), (0, 1))
    i, j = np.indices(counts.shape)
    share = np.where(i + j < 15, 2.0, np.where(i + j == 15, 1.0, 0.0)) / 256  # of cells that the diagonal halves: half
    assert p_value(counts, N * share) > LEVEL


@pytest.mark.parametrize("seed", [5, 6])
def test_frames_are_rotations(seed):
    """Cosine-weighted directions around any normal, counted by their cosine and by their angle around it."""
    rng = np.random.default_rng(seed)
    n = rng.normal(size=3) * [1, 1, -1 if seed == 5 else 1]
    n /= np.linalg.norm(n)
    w = np.array(warp.around(tuple(np.full(N, c) for c in n), warp.cosine_hemisphere(*square(seed))))
    side = np.cross(n, [1, 0, 0]) / np.linalg.norm(np.cross(n, [1, 0, 0]))
    up = np.cross(n, side)
    counts = binned((n @ w) ** 2, np.arctan2(up @ w, side @ w), (0, 1), (-math.pi, math.pi))
    assert p_value(counts, np.full(counts.shape, N / counts.size)) > LEVEL


# --- passes of kernels -----------------------------------------------------------------------------------------------

SIDE, SPP = 64, 98
N_PATHS = SIDE * SIDE * SPP  # paths that meet a surface at nearly one point
VIEW = {"position": [0, 1e-3, 2], "look_at": [0, 0, 0], "fov": 1e-4}


class Recorder(path_wavefront.PathWavefront):
    """Keeps what the first surface of each path samples."""

    picked: list
    scattered: list

    def _pick_lights(self, here, n, depth):
        super()._pick_lights(here, n, depth)
        size, it = self._rows, self.incident
        if depth == 1:
            self.picked.append((it.light[:n].copy(), it.wi.reshape(3, size)[:, :n].copy(), it.pdf[:n].copy()))

    def _scatter(self, here, n, depth):
        super()._scatter(here, n, depth)
        if depth == 1:
            alive = (here.state[:n] & DEAD) == 0
            self.scattered.append((here.rays.d.reshape(3, self._rows)[:, :n][:, alive], here.pdf[:n][alive]))


@pytest.fixture
def record(monkeypatch):
    """Render a scene, and return what paths sampled at their first surface, in float64."""

    def run(given, seed=0):
        Recorder.picked, Recorder.scattered = [], []
        monkeypatch.setattr(path_wavefront, "PathWavefront", Recorder)
        rt.render(
            rt.load(given), spp=SPP, size=(SIDE, SIDE), sampler="independent", precision="float32", threads=1, seed=seed
        )
        return [
            [np.concatenate(parts, axis=-1) for parts in zip(*records, strict=True)]
            for records in (Recorder.picked, Recorder.scattered)
        ]

    return run


def test_lights_are_chosen_by_power(record):
    """Phi; the integral of a spot's intensity; pi A L of a lamp's triangles; pi R^2 E from far away."""
    rng = np.random.default_rng(8)
    flux = rng.exponential(size=20) * 1e8
    sources = [{"type": "point", "position": [k, 0, 5], "flux": [each] * 3} for k, each in enumerate(flux)]
    sources += [{"type": "spot", "position": [0, 0, 5], "look_at": [0, 0, 0], "intensity": [1e7] * 3, "cutoff": 60}]
    sources += [{"type": "directional", "direction": [0, 0, -1], "irradiance": [20] * 3}, *environment(9)]
    lamp = quad((0, 0, 4), (0, 2, 4), (3, 2, 4), (1, 0, 4)), diffuse(0.0, 4e6)
    (row, _, _), _ = record(scene([(PLANE, diffuse(0.5)), lamp], VIEW, 1, lights=sources))
    angle = np.linspace(0, math.radians(60), 10**5)
    falloff = np.clip((angle[-1] - angle) / (angle[-1] / 4), 0, 1)  # the beam is 3/4 of the cutoff
    spot = 1e7 * 2 * math.pi * np.trapezoid(np.sin(angle) * falloff, angle)
    disc = math.pi * (2000**2 + 2000**2 + 4**2) / 4
    areas = np.array([3.0, 1.0])
    power = np.array([*flux, spot, disc * 20, disc * math.pi * 9, *(math.pi * areas * 4e6)])
    assert p_value(np.bincount(row, minlength=len(power)), N_PATHS * power / power.sum()) > LEVEL


def test_points_of_lamps_have_the_density_of_their_directions(record):
    """A tilted lamp, seen from the floor: per solid angle, r^2 / (A cos)."""
    corners = np.array([[-0.5, -0.4, 1.0], [-0.2, 0.5, 1.6], [0.9, 0.7, 0.8], [0.6, -0.2, 0.2]])
    triangles = quad(*corners)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (cross @ [0, 0, 1] < 0).all()  # they face the floor
    below = {**VIEW, "position": [-1.5, 1e-3, 0.5]}
    (_, wi, pdf), _ = record(scene([(0.002 * PLANE, diffuse(0.5)), (triangles, diffuse(0.0, 1.0))], below, 1))
    area, normal = np.linalg.norm(cross, axis=1) / 2, cross / np.linalg.norm(cross, axis=1, keepdims=True)

    def density(w):
        """Per solid angle of unit vectors (3, n): where they meet either triangle, r^2 / (A cos)."""
        total = np.zeros(w.shape[1])
        for t, n in zip(triangles, normal, strict=True):
            inside = np.all([np.cross(t[k], t[(k + 1) % 3]) @ w <= 0 for k in range(3)], axis=0)
            cosine = -(n @ w)
            total += np.where(inside, ((t[0] @ n) / (n @ w)) ** 2 / (area.sum() * cosine), 0)
        return total

    there = density(wi.astype(float))
    assert (there > 0).mean() > 0.9999  # rounding puts a few beside an edge
    np.testing.assert_allclose((pdf / np.where(there > 0, there, pdf))[there > 0], 1, rtol=1e-3)
    bins, fine, low, high = 24, 24, -3.0, 4.0  # of x / z and y / z
    counts = np.histogram2d(wi[0] / wi[2], wi[1] / wi[2], bins, ((low, high), (low, high)))[0]
    middle = low + (np.arange(bins * fine) + 0.5) * (high - low) / (bins * fine)
    a, b = (grid.ravel() for grid in np.meshgrid(middle, middle, indexing="ij"))
    length = np.sqrt(a * a + b * b + 1)
    per_cell = density(np.array([a, b, np.ones_like(a)]) / length) / length**3 * ((high - low) / (bins * fine)) ** 2
    expected = per_cell.reshape(bins, fine, bins, fine).sum(axis=(1, 3))
    outside = N_PATHS - counts.sum()
    assert p_value(np.append(counts, outside), N_PATHS * np.append(expected, max(1 - expected.sum(), 0))) > LEVEL


def test_environment(record):
    (_, wi, pdf), _ = record(scene([(PLANE, diffuse(0.5))], VIEW, 1, lights=environment(1.0)))
    counts = binned(wi[2], np.arctan2(wi[1], wi[0]), (-1, 1), (-math.pi, math.pi))
    assert p_value(counts, np.full(counts.shape, N_PATHS / counts.size)) > LEVEL
    np.testing.assert_allclose(pdf, 1 / (4 * math.pi), rtol=1e-6)


def test_diffuse_surfaces(record):
    _, (d, pdf) = record(scene([(PLANE, diffuse(0.5))], VIEW, 2, lights=environment(1.0)))
    counts = binned(d[2] ** 2, np.arctan2(d[1], d[0]), (0, 1), (-math.pi, math.pi))
    assert p_value(counts, np.full(counts.shape, N_PATHS / counts.size)) > LEVEL
    np.testing.assert_allclose(pdf, d[2] / math.pi, rtol=2e-5, atol=1e-7)


@pytest.mark.parametrize("degrees", [0, 35, 60, 80, -30])  # -30: from inside
def test_dielectrics_reflect_fresnels_share(record, degrees):
    angle, n = math.radians(abs(degrees)), 1.5 if degrees >= 0 else 1 / 1.5
    glass = box((-100, -100, -9), (100, 100, 0)) if degrees >= 0 else box((-100, -100, 0), (100, 100, 9))
    start = [2 * math.sin(angle), 1e-3, 2 * math.cos(angle)]
    given = scene([(glass, GLASS)], {**VIEW, "position": start}, 2, lights=environment(1.0))
    _, (d, _) = record(given, seed=abs(degrees))
    cos_i, cos_t = math.cos(angle), math.sqrt(1 - (math.sin(angle) / n) ** 2)
    r = ((cos_i - n * cos_t) / (cos_i + n * cos_t)) ** 2 / 2 + ((n * cos_i - cos_t) / (n * cos_i + cos_t)) ** 2 / 2
    back = int((d[2] > 0).sum())
    assert len(d[2]) == N_PATHS
    assert p_value([back, N_PATHS - back], [N_PATHS * r, N_PATHS * (1 - r)]) > LEVEL


def test_roulette():
    """Survivors by their throughput: a share of that, at least ``SURVIVE``; they are divided by it."""
    n = 2**17
    made = []

    class Front(path_wavefront.PathWavefront):
        def __init__(self, *given):
            super().__init__(*given[:3], n)
            made.append(self)

        def add_samples(self, *given):
            pass

    original, path_wavefront.PathWavefront = path_wavefront.PathWavefront, Front
    try:
        rt.render(rt.load(scene([(PLANE, diffuse(0.5))], VIEW, 1, lights=environment(1.0))), size=(8, 8), spp=1)
    finally:
        path_wavefront.PathWavefront = original
    made[0].resize(n)
    here, out, rng = made[0].paths, made[0].others, np.random.default_rng(9)
    size = len(here.pdf)
    brightest = rng.uniform(0, 1.25, size).astype(here.pdf.dtype)
    scale = rng.choice([1.0, 2.25], size).astype(here.pdf.dtype)  # what radiance gains in glass does not count
    here.throughput.reshape(3, size)[:] = brightest * scale * np.array([[0.5], [1.0], [0.25]])
    here.state[:], here.sample[:], here.scale[:] = 0, np.arange(size), scale
    here.key[:], here.rays.slot[:] = rng.integers(0, 2**32, size, np.uint32), np.arange(size)
    before = here.throughput.reshape(3, size)[1].copy()
    sent = go_on(here, n, ROULETTE_FROM, made[0].grid, made[0].order, out)
    kept = out.rays.slot[:sent]
    chance = np.clip(brightest[:n].astype(float), SURVIVE, 1)
    bins = np.minimum((brightest[:n] * 40).astype(int), 49)
    alive, share = np.bincount(bins[kept], minlength=50), np.bincount(bins, chance, 50)
    total = np.bincount(bins, minlength=50)
    variance = np.maximum(np.bincount(bins, chance * (1 - chance), 50), 1e-9)
    some = chance.mean() < 1 and share < total - 1e-9
    assert stats.chi2.sf(((alive - share)[some] ** 2 / variance[some]).sum(), some.sum()) > LEVEL
    np.testing.assert_array_equal(alive[~some], total[~some])  # a throughput of 1 or more always survives
    expected = before[kept] / chance[kept]
    np.testing.assert_allclose(out.throughput.reshape(3, size)[1, :sent], expected, rtol=1e-5)
