"""Sums of samples in four bins: the same whatever the batch."""

from itertools import pairwise

import numpy as np
import pytest

import rays
from raytrace.passes.estimate import MODELS, weights_of
from raytrace.passes.film import BINS, LUMINANCE, accumulate, bin_counts, develop, make_film, make_frame, put, taken
from raytrace.rendering.film_tiles import ALL

pytestmark = pytest.mark.engine

PRECISIONS = ("float32", "float64")


def added(radiance, cuts, pixels):
    """Sums (bins, 3, pixels) of radiance (samples, pixels, 3), added in pieces that begin at the cuts."""
    sums, first = np.zeros((3 * BINS, pixels)), 0
    for piece in np.split(radiance, cuts):
        last = first + len(piece)
        accumulate(piece.transpose(2, 0, 1).ravel(), first, last, sums, 0, pixels)
        first = last
    return sums.reshape(BINS, 3, pixels)


@pytest.mark.nojit
@pytest.mark.parametrize("precision", PRECISIONS)
def test_sums_do_not_depend_on_the_batch(precision):
    radiance = np.random.default_rng(1).lognormal(0, 5, (8, 48, 3)).astype(precision)
    whole = added(radiance, [], 48)
    for cuts in ([3], [1, 2, 3, 4, 5, 6, 7], [7], [4, 6]):
        assert rays.same_bits(added(radiance, cuts, 48), whole)


@pytest.mark.nojit
@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 7, 8, 9, 12, 16, 17])
def test_bins_hold_samples_in_their_order_and_quarters_where_they_are_a_power_of_two(samples):
    radiance = np.random.default_rng(2).uniform(0, 2, (samples, 16, 3)).astype(np.float32)
    counts = bin_counts([samples])[:, 0]
    assert counts.sum() == samples
    bounds = np.concatenate([[0], np.cumsum(counts)])
    expected = [radiance[a:b].astype(np.float64).sum(axis=0).T for a, b in pairwise(bounds)]
    np.testing.assert_allclose(added(radiance, [samples // 2], 16), expected, rtol=1e-14)
    if samples in (4, 8, 16):
        assert (counts == samples // 4).all()


def test_counts_are_those_of_each_pixel():
    np.testing.assert_array_equal(
        bin_counts([0, 1, 2, 5, 9]).T, [[0] * 4, [1, 0, 0, 0], [1, 1, 0, 0], [2, 2, 1, 0], [4, 4, 1, 0]]
    )


def test_luminance_of_white_is_one():
    assert sum(LUMINANCE) == pytest.approx(1, abs=1e-15)


def test_small_samples_are_not_lost_beside_large_ones():
    radiance = np.full((2, 16, 3), 1e-3, np.float32)
    radiance[0] = 1e6  # float32 sums would stay at 1e6
    np.testing.assert_allclose(added(radiance, [], 16).sum(axis=0), 1e6 + 1e-3, rtol=1e-14)


@pytest.mark.nojit
@pytest.mark.parametrize("precision", PRECISIONS)
def test_only_the_pixels_of_a_batch_are_touched(precision):
    radiance = np.random.default_rng(3).uniform(0, 2, (5, 16, 3)).astype(precision)
    sums = np.full((3 * BINS, 48), 7.0)
    sums[:, 16:32] = 0
    accumulate(radiance.transpose(2, 0, 1).ravel(), 0, 5, sums, 16, 16)
    assert rays.same_bits(sums[:, 16:32].reshape(BINS, 3, 16), added(radiance, [], 16))
    assert (np.delete(sums, np.s_[16:32], axis=1) == 7).all()


def developed(film, at):
    picture = make_frame(len(at))
    weights = weights_of(set(film.samples.tolist()), MODELS["sobol"])
    develop(film, at, 0, ALL, weights, picture)
    return picture


@pytest.mark.nojit
def test_a_picture_has_every_pixel_of_the_film_in_its_place():
    film, at = make_film(20), np.random.default_rng(6).permutation(20)
    for seed, column in enumerate(film):
        column[...] = 100 * np.random.default_rng(seed).random(column.shape)
    picture = developed(film, at)
    bins = film.sums.reshape(BINS, 3, -1)[..., :20]
    means = (bins[0] + bins[1] + (bins[2] + bins[3])) / np.maximum(film.samples[:20], 1)
    assert rays.same_bits(picture.rgb[at], means.T.astype(np.float32))
    for name in ("samples", "variance", "error"):
        assert rays.same_bits(getattr(picture, name)[at], getattr(film, name)[:20])


def test_a_film_has_whole_packets_and_knows_nothing():
    film = make_film(33)
    assert film.sums.shape == (12, 48)
    assert not film.sums.any()
    assert not film.samples.any()
    assert np.isnan(film.variance).all()
    assert np.isnan(film.error).all()
    picture = developed(film, np.arange(33))
    assert picture.rgb.tolist() == np.zeros((33, 3)).tolist()
    assert not picture.samples.any()
    assert np.isnan(picture.var).all()
    assert np.isnan(picture.variance).all()
    assert np.isnan(picture.error).all()


def test_pixels_are_taken_and_put_back_and_means_are_those_of_their_samples():
    film = make_film(64)
    radiance = np.random.default_rng(4).uniform(0, 2, (6, 64, 3))
    accumulate(radiance.transpose(2, 0, 1).ravel(), 0, 6, film.sums, 0, 64)
    film.samples[:] = 6
    np.testing.assert_allclose(developed(film, np.arange(60)).rgb, radiance.mean(axis=0)[:60], rtol=1e-7)
    pixels = np.array([3, 5, 60])
    part = taken(film, np.pad(pixels, (0, 13), "edge"))
    for column in part:
        column += np.arange(1, 17).astype(column.dtype)
    put(film, pixels, part)
    assert film.samples[pixels].tolist() == [7, 8, 9]
    assert (np.delete(film.samples, pixels) == 6).all()
    expected = radiance.sum(axis=0).T.copy()
    expected[:, pixels] += BINS * np.array([1, 2, 3])
    np.testing.assert_allclose(film.sums.reshape(BINS, 3, 64).sum(axis=0), expected, rtol=1e-14)
