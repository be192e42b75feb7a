"""Parts of a picture: every pixel once, along a Z curve; ranges of samples without a gap."""

import numpy as np
import pytest

from raytrace.parts import TILE, doubled, rounds, tiles
from raytrace.records import Window


@pytest.mark.parametrize(("width", "height"), [(1, 1), (TILE, TILE), (TILE + 1, 2 * TILE - 3), (5, 70)])
def test_tiles_hold_every_pixel_once(width, height):
    parts = tiles(Window(3, 4, width, height))
    assert sorted(np.concatenate(parts).tolist()) == list(range(width * height))
    assert max(map(len, parts)) <= TILE**2


def test_sixteen_pixels_that_follow_each_other_are_a_square():
    (tile,) = tiles(Window(0, 0, TILE, TILE))
    y, x = np.divmod(tile.reshape(-1, 16), TILE)
    assert (np.ptp(x, axis=1) == 3).all()
    assert (np.ptp(y, axis=1) == 3).all()


@pytest.mark.parametrize("spp", [1, 2, 3, 8, 100])
@pytest.mark.parametrize("hasty", [False, True])
def test_rounds_leave_no_sample_out(spp, hasty):
    ranges = rounds(spp, hasty)
    assert [s for first, last in ranges for s in range(first, last)] == list(range(spp))
    assert len(ranges) == (1 + (spp - 1).bit_length() if hasty else 1)


def test_doubled_parts_hold_pixels_of_one_number_of_samples_up_to_the_cap():
    pixels = np.arange(3000)
    samples = np.where(pixels % 3, 4, 16).astype(np.int32)
    parts = list(doubled(pixels, samples, 24))
    assert {(part.first, part.last) for part in parts} == {(4, 8), (16, 24)}
    assert all((samples[part.pixels] == part.first).all() for part in parts)
    assert max(len(part.pixels) for part in parts) <= TILE**2
    assert sorted(np.concatenate([part.pixels for part in parts]).tolist()) == pixels.tolist()
