"""Parts of a picture: every pixel once, along a Z curve; ranges of samples without a gap."""

from itertools import pairwise

import numpy as np
import pytest

from raytrace.records import Window
from raytrace.rendering.film_tiles import TILE, curve, grown, inverse, pieces, rounds


def numbers(window):
    """Pixels along the curve, numbered row by row."""
    x, y = curve(window)
    return y * window.width + x


@pytest.mark.parametrize(("width", "height"), [(1, 1), (TILE, TILE), (TILE + 1, 2 * TILE - 3), (5, 70)])
def test_the_curve_holds_every_pixel_once(width, height):
    assert sorted(numbers(Window(3, 4, width, height)).tolist()) == list(range(width * height))


def test_the_curve_goes_through_one_tile_after_the_other():
    y, x = np.divmod(numbers(Window(0, 0, 3 * TILE, 2 * TILE)).reshape(6, -1), 3 * TILE)
    assert [*zip(y.min(axis=1).tolist(), x.min(axis=1).tolist(), strict=True)] == [
        (top, left) for top in (0, TILE) for left in (0, TILE, 2 * TILE)
    ]
    assert (np.ptp(y, axis=1) == TILE - 1).all()
    assert (np.ptp(x, axis=1) == TILE - 1).all()


def test_sixteen_pixels_that_follow_each_other_are_a_square():
    y, x = np.divmod(numbers(Window(0, 0, TILE, TILE)).reshape(-1, 16), TILE)
    assert (np.ptp(x, axis=1) == 3).all()
    assert (np.ptp(y, axis=1) == 3).all()


def test_an_inverse_undoes():
    order = np.random.default_rng(1).permutation(50)
    assert inverse(order)[order].tolist() == order[inverse(order)].tolist() == list(range(50))


@pytest.mark.parametrize("pixels", [16, TILE**2, TILE**2 + 16, 5 * TILE**2])
@pytest.mark.parametrize(("at_least", "tiles"), [(0, 1), (TILE**2, 1), (3 * TILE**2 + 5, 3)])
def test_pieces_hold_every_pixel_once(pixels, at_least, tiles):
    slices = pieces(pixels, at_least)
    assert np.concatenate([np.arange(pixels)[piece] for piece in slices]).tolist() == list(range(pixels))
    assert max(piece.stop - piece.start for piece in slices) == min(pixels, tiles * TILE**2)


@pytest.mark.parametrize("spp", [1, 2, 3, 8, 100])
@pytest.mark.parametrize("first", [0, 1, 4])
def test_rounds_leave_no_sample_out(spp, first):
    ranges = rounds(spp, first)
    assert [s for first, last in ranges for s in range(first, last)] == list(range(spp))
    ends = [last for _, last in ranges]
    assert ends[0] == (min(first, spp) or spp)
    assert all(later == min(2 * end, spp) for end, later in pairwise(ends))


def test_grown_parts_hold_pixels_of_one_number_of_samples_that_want_the_same():
    pixels = np.arange(7, 3007)
    samples = np.where(pixels % 3, 4, 16).astype(np.int32)
    wanted = np.where(pixels % 2, 16, 24).astype(np.int32)
    wanted[samples == 16] = 24
    parts = list(grown(pixels, samples, wanted))
    assert {(part.first, part.last) for part in parts} == {(4, 16), (4, 24), (16, 24)}
    for part in parts:
        assert (samples[part.pixels - 7] == part.first).all()
        assert (wanted[part.pixels - 7] == part.last).all()
        assert (np.diff(part.pixels) > 0).all()
        assert len(part.pixels) <= TILE**2
    assert sorted(np.concatenate([part.pixels for part in parts]).tolist()) == pixels.tolist()
