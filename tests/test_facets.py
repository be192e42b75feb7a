"""The search for coincident triangles, against the test of every pair; and how many pairs it looks at."""

import numpy as np
import pytest

from raytrace.scene import facets
from raytrace.scene.facets import coincident_pairs, make_facets, overlapping

UNIT = 2.0**-24
MARGIN = 4e-6


def columns(triangles):
    return make_facets(np.ascontiguousarray(np.asarray(triangles, np.float64).transpose(1, 2, 0)), UNIT)


def sheet(rng, count, low, high, flip=False):
    """A square of the plane z = 0 in triangles of all shapes: a grid with moved inner corners."""
    x = np.linspace(low, high, count + 1)
    p = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((count + 1, count + 1))], axis=-1)
    step = (high - low) / count
    p[1:-1, 1:-1, :2] += rng.uniform(-0.3, 0.3, (count - 1, count - 1, 2)) * step
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    triangles = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    return triangles[:, ::-1] if flip else triangles


def turned(triangles, rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return triangles @ q.T


def found(a, b):
    pairs = [np.stack(pair, axis=1) for pair in coincident_pairs(a, b, MARGIN)]
    return {tuple(pair) for pair in np.concatenate(pairs).tolist()} if pairs else set()


def every(a, b):
    i, j = np.divmod(np.arange(len(a.bound) * len(b.bound)), len(b.bound))
    return set(zip(*(rows.tolist() for rows in overlapping(a, b, i, j, MARGIN)), strict=True))


@pytest.mark.parametrize("counts", [(10, 10), (10, 13), (30, 3), (3, 31), (40, 1)])
@pytest.mark.parametrize("seed", range(4))
def test_the_search_finds_what_the_test_of_every_pair_finds(monkeypatch, seed, counts):
    monkeypatch.setattr(facets, "MOST_PARTNERS", 10_000)
    rng = np.random.default_rng(seed)
    parts = sheet(rng, counts[0], -0.5, 0.6), sheet(rng, counts[1], -0.3, 1.0, flip=True)
    both = turned(np.concatenate(parts), rng)
    a, b = columns(both[: len(parts[0])]), columns(both[len(parts[0]) :])
    expected = every(a, b)
    assert len(expected) > max(len(parts[0]), len(parts[1])) / 4
    assert found(a, b) == expected


@pytest.mark.parametrize("gap", [0.0, 1e-7, 1e-5, 1e-2])
def test_sheets_coincide_within_the_bound_and_not_beyond_it(gap):
    rng = np.random.default_rng(1)
    z = np.array([0.0, 0.0, 0.7])  # in the plane z = 0 nothing is rounded, and there is no bound
    a, b = columns(sheet(rng, 20, -0.5, 0.5) + z), columns(sheet(rng, 30, -0.5, 0.5) + z + (0, 0, gap))
    bound = a.bound.max() + b.bound.max()
    assert 3e-7 < bound < 3e-6
    assert bool(found(a, b)) == (gap <= bound)


def test_the_search_looks_at_few_pairs(monkeypatch):
    looked = []
    monkeypatch.setattr(facets, "overlapping", lambda a, b, i, j, margin: looked.append(len(i)) or (i[:0], j[:0]))
    rng = np.random.default_rng(2)
    for count in (40, 160):
        looked.clear()
        a, b = columns(sheet(rng, count, -0.5, 0.5)), columns(sheet(rng, count, -0.5, 0.5))
        assert sum(1 for _ in coincident_pairs(a, b, MARGIN)) == len(looked) > 0
        assert sum(looked) < 500 * len(a.bound)  # of the 3,200 and 51,200 that there are for each
        assert max(looked) <= facets.AT_ONCE + facets.MOST_PARTNERS


def test_what_is_near_but_crosses_is_not_looked_at(monkeypatch):
    looked = []
    monkeypatch.setattr(facets, "overlapping", lambda a, b, i, j, margin: looked.append(len(i)) or (i[:0], j[:0]))
    rng = np.random.default_rng(3)
    clouds = [rng.random((20_000, 1, 3)) + rng.normal(size=(20_000, 3, 3)) * 0.02 for _ in range(2)]
    list(coincident_pairs(columns(clouds[0]), columns(clouds[1]), MARGIN))
    assert sum(looked) < 40_000


def test_triangles_without_area_are_left_out():
    assert len(columns([np.zeros((3, 3)), np.eye(3), [[0, 0, 0], [1, 1, 1], [2, 2, 2]]]).bound) == 1
