"""Differences of pixels from their neighbours: the kernel against slices of NumPy."""

import numpy as np
import pytest

import rays
from raytrace.accel.lanes import PACKET
from raytrace.passes.edges import edges, weigh

pytestmark = pytest.mark.engine

COLUMNS, ROWS = 32, 9
INNER = np.s_[2:-2, 1:-1]


def found(picture, held=0.0):
    """Steps, bends and what lies between neighbours (3, rows - 4, columns - 2), of a picture (rows, columns, 3)."""
    out = np.full((3, ROWS * COLUMNS), held)
    edges(np.ascontiguousarray(picture.transpose(2, 0, 1)).ravel(), COLUMNS, *out)
    return out.reshape(3, ROWS, COLUMNS)[:, *INNER]


@pytest.mark.nojit
def test_differences_are_those_of_slices():
    picture = np.random.default_rng(1).uniform(0, 1, (ROWS, COLUMNS, 3))
    directions = [(0, 1), (1, -1), (1, 0), (1, 1)]
    steps, bends, between = np.zeros((3, len(directions), ROWS - 4, COLUMNS - 2))
    for k, (dy, dx) in enumerate(directions):
        before, after = (np.roll(picture, (s * dy, s * dx), axis=(0, 1))[INNER] - picture[INNER] for s in (1, -1))
        x, y = (before**2).sum(axis=-1), (after**2).sum(axis=-1)
        steps[k], between[k], bends[k] = np.maximum(x, y), np.minimum(x, y), ((before + after) ** 2).sum(axis=-1)
    expected = [a.max(axis=0) for a in (steps, bends, between)]
    np.testing.assert_allclose(found(picture), expected, rtol=1e-12)
    assert (found(picture, held=9.0) == 9.0).all()  # what is larger stays


@pytest.mark.nojit
@pytest.mark.parametrize("width", [1, 13, 16, 17, 30])
def test_errors_are_weighed_by_what_bends_near_them(width):
    rng = np.random.default_rng(2)
    steps, bends, between = marks = rng.uniform(0, 1, (3, ROWS, COLUMNS))
    height = ROWS - 4
    known, error = np.zeros((3, height * width + PACKET)), np.empty(height * width + PACKET)
    known[:, : height * width] = rng.uniform(0, 1, (3, height * width))
    weigh(marks.ravel(), COLUMNS, known.ravel(), width, error)
    for y in range(height):
        for x in range(width):
            at = y + 2, x + 1
            bent = bends[at[0] - 1 : at[0] + 2, at[1] - 1 : at[1] + 2].max()
            own, half, hidden = known[:, y * width + x]
            expected = own + half * min(between[at], bent) + hidden * min(steps[at], bent)
            assert error[y * width + x] == pytest.approx(expected, rel=1e-14)


@pytest.mark.nojit
def test_a_slope_has_steps_and_no_bends_and_an_edge_has_both():
    y, x = np.mgrid[0:ROWS, 0:COLUMNS] / 8
    steps, bends, between = found(np.stack([x, y, x + y], axis=-1))
    assert bends.max() < 1e-30
    assert steps.min() > 1 / 64
    assert rays.same_bits(steps, between)
    cut = np.zeros((ROWS, COLUMNS, 3))
    cut[:, 16:] = 1.0
    steps, bends, between = found(cut)
    assert np.flatnonzero(steps[0]).tolist() == np.flatnonzero(bends[0]).tolist() == [14, 15]
    assert not between.any()
    cut[:, 15] = 0.25  # a pixel that the edge crosses
    steps, bends, between = found(cut)
    assert np.flatnonzero(between[0]).tolist() == [14]
    assert between[0, 14] == 3 * 0.25**2
