"""Sums of samples: the same whatever the batch."""

import numpy as np
import pytest

import rays
from raytrace.passes.film import LUMINANCE, accumulate

PRECISIONS = ("float32", "float64")


def added(radiance, cuts, pixels):
    """Sums of radiance (samples, pixels, 3), added in pieces that begin at the cuts."""
    sums = np.zeros((4, pixels))
    for piece in np.split(radiance, cuts):
        accumulate(piece.transpose(2, 0, 1).ravel(), sums)
    return sums


@pytest.mark.nojit
@pytest.mark.parametrize("precision", PRECISIONS)
def test_sums_do_not_depend_on_the_batch(precision):
    radiance = np.random.default_rng(1).lognormal(0, 5, (8, 48, 3)).astype(precision)
    whole = added(radiance, [], 48)
    for cuts in ([3], [1, 2, 3, 4, 5, 6, 7], [7], [4, 6]):
        assert rays.same_bits(added(radiance, cuts, 48), whole)
    order = [5, 0, 1, 2, 3, 4, 6, 7]
    assert not rays.same_bits(added(radiance[order], [], 48), whole)  # their order is what counts


@pytest.mark.nojit
@pytest.mark.parametrize("precision", PRECISIONS)
def test_sums_are_of_channels_and_of_squared_luminance(precision):
    radiance = np.random.default_rng(2).uniform(0, 2, (5, 32, 3)).astype(precision)
    sums = added(radiance, [2], 32)
    exact = radiance.astype(np.float64)
    np.testing.assert_allclose(sums[:3], exact.sum(axis=0).T, rtol=1e-15)
    # luminance is computed in the precision of the samples or better
    np.testing.assert_allclose(sums[3], ((exact @ LUMINANCE) ** 2).sum(axis=0), rtol=8 * np.finfo(precision).eps)


def test_luminance_of_white_is_one():
    assert sum(LUMINANCE) == pytest.approx(1, abs=1e-15)


def test_small_samples_are_not_lost_beside_large_ones():
    radiance = np.full((2, 16, 3), 1e-3, np.float32)
    radiance[0] = 1e6  # float32 sums would stay at 1e6
    np.testing.assert_allclose(added(radiance, [], 16)[:3], 1e6 + 1e-3, rtol=1e-14)
