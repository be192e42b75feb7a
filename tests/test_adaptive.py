"""Where samples go: least work for the target, caps kept, and pixels beside an edge not trusted."""

import numpy as np
import pytest

from raytrace.adaptive import choose, hidden

ORDER = 1.5


def play(scale, target, cap=1 << 20):
    """Samples when the error is exactly scale samples^-ORDER, and how many rounds that took."""
    samples = np.full(len(scale), 4, np.int32)
    for rounds in range(100):
        error = scale / samples**ORDER
        chosen = choose(error, samples, target, cap, ORDER)
        if not len(chosen):
            return samples, rounds
        samples[chosen] = np.minimum(2 * samples[chosen], cap)
    raise AssertionError("no end")


def test_nothing_is_chosen_where_the_target_is_met():
    assert len(choose(np.full(9, 0.5), np.full(9, 4, np.int32), 0.75, 4096, ORDER)) == 0
    assert len(choose(np.zeros(9), np.full(9, 4, np.int32), 1e-9, 4096, ORDER)) == 0


@pytest.mark.parametrize("target", [0.3, 0.03, 0.003])
def test_the_target_is_met_with_hardly_more_samples_than_the_least(target):
    scale = np.random.default_rng(1).lognormal(0, 3, 4000)
    samples, rounds = play(scale, target)
    assert np.mean(scale / samples**ORDER) <= target**2
    level = np.geomspace(1e-9, 1e9, 20001)  # of a continuous number of samples: the bound of all that can be done
    low, high = 0, len(level) - 1
    while high - low > 1:
        middle = (low + high) // 2
        n = np.maximum((scale / level[middle]) ** (1 / (ORDER + 1)), 4)
        low, high = (middle, high) if np.mean(scale / n**ORDER) <= target**2 else (low, middle)
    least = np.maximum((scale / level[low]) ** (1 / (ORDER + 1)), 4).sum()
    assert samples.sum() < 1.2 * least
    assert rounds <= np.log2(samples.max() / 4) + 3


def test_pixels_of_equal_error_get_equal_samples_but_for_the_last_doubling():
    samples, _ = play(np.ones(64), 0.01)
    assert samples.max() <= 2 * samples.min()


def test_a_capped_pixel_stays_and_the_others_meet_the_target_alone():
    scale = np.concatenate([[1e4], np.ones(99)])
    samples, _ = play(scale, 0.05, cap=256)
    assert samples[0] == 256
    assert np.mean(1 / samples[1:] ** ORDER) <= 0.05**2
    assert samples[1:].max() == 64


def test_no_pixel_exceeds_a_cap_that_is_no_power_of_two():
    assert play(np.ones(9), 1e-6, cap=37)[0].tolist() == [37] * 9


def test_pixels_beside_an_edge_may_hide_an_error_and_flat_ones_not():
    picture = np.zeros((6, 8, 3))
    picture[:, 4:] = 1.0
    unseen = hidden(picture, np.full((6, 8), 4, np.int32))
    np.testing.assert_allclose(unseen[:, 3:5], 1 / 192)
    assert not unseen[:, :3].any()
    assert not unseen[:, 5:].any()
    assert (hidden(picture, np.full((6, 8), 8, np.int32))[:, 3:5] < unseen[:, 3:5]).all()


def test_what_may_be_hidden_is_the_mean_over_edges_that_evenly_spread_samples_miss():
    n, rng = 16, np.random.default_rng(2)
    area = rng.uniform(0, 1, 400_000)  # of the part of the pixel that is white, from the left; a sample in each n-th
    seen = (np.arange(n) + rng.uniform(0, 1, (len(area), n))) / n < area[:, None]
    error = np.where(seen.any(axis=1), 0.0, area) ** 2
    picture = np.zeros((1, 2, 3))
    picture[0, 1] = 1
    assert error.mean() < hidden(picture, np.full((1, 2), n, np.int32))[0, 0]
