"""Where samples go: least work for the target, caps kept, and pixels beside an edge not trusted."""

import numpy as np
import pytest

from raytrace.passes.estimate import MODELS, Model
from raytrace.passes.film import make_film
from raytrace.records import Window
from raytrace.rendering.adaptive import EDGE, LEAP, LUCK, AdaptiveSampler, choose
from raytrace.rendering.film_tiles import curve

ORDER = 1.5


def play(scale, target, cap=1 << 20):
    """Samples when the error is exactly scale samples^-ORDER, and how many rounds that took."""
    samples = np.full(len(scale), 4, np.int32)
    for rounds in range(100):
        doublings = choose(scale / samples**ORDER, samples, target, cap, ORDER)
        if not doublings.any():
            return samples, rounds
        assert doublings.min() >= 0
        assert doublings.max() <= LEAP
        samples = np.minimum(samples << doublings, cap)
    raise AssertionError("no end")


def test_nothing_is_chosen_where_the_target_is_met_or_nothing_is_known():
    samples = np.full(9, 4, np.int32)
    assert not choose(np.full(9, 0.5), samples, 0.75, 4096, ORDER).any()
    assert not choose(np.zeros(9), samples, 1e-9, 4096, ORDER).any()
    assert not choose(np.full(9, np.nan), samples, 0.75, 4096, ORDER).any()


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
    assert samples.sum() < 1.25 * least
    assert rounds <= np.log2(samples.max() / 4) / LEAP + 3


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


# --- what is known ---------------------------------------------------------------------------------------------------


def search_of(picture, error, target=1e-4, samples=4, model=MODELS["sobol"]):
    """A search that was shown a picture (h, w) of greys and given the pixels' errors, or one for all."""
    height, width = picture.shape
    window = Window(3, 5, width, height)
    x, y = curve(window)
    at = y * window.width + x
    film = make_film(len(at))
    film.samples[:] = samples
    film.error[: len(at)] = np.broadcast_to(error, picture.shape).ravel()[at]
    search = AdaptiveSampler(film, at, window, model, target, 4096)
    search.show(np.s_[: len(at)], np.tile(picture.ravel()[at], (3, 1)))
    return search


def pixels_of(search, parts, shape):
    """Which pixels (h, w) parts draw."""
    chosen = np.zeros(shape[0] * shape[1], bool)
    for part in parts:
        chosen[search._at[part.pixels]] = True
    return chosen.reshape(shape)


def test_the_error_is_that_of_the_pixels_where_all_is_flat():
    search = search_of(np.full((20, 40), 0.5), 4e-6, target=0.0021)
    assert not search.work_items()
    assert search.error == pytest.approx(0.002 * np.sqrt(1 / (1 + LUCK)), rel=1e-12)  # flat: luck is unlikely


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 2), (17, 33)])
def test_a_slope_is_no_edge_whatever_the_size(size):
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / 200
    search = search_of(0.3 + x + 0.5 * y, 0.0, target=1e-9)
    assert not search.work_items()
    assert search.error < 1e-10


def test_pixels_near_an_edge_are_not_trusted_though_their_samples_agree():
    picture = np.zeros((20, 40))
    picture[:, 21:] = 1.0
    search = search_of(picture, 0.0)
    chosen = pixels_of(search, search.work_items(), picture.shape)
    assert np.flatnonzero(chosen.all(axis=0)).tolist() == [20, 21]
    assert not np.delete(chosen, [20, 21], axis=1).any()
    assert search.error == pytest.approx(np.sqrt(2 / 40 / (3 * 4**3)), rel=1e-12)


def test_a_pixel_half_on_either_side_of_an_edge_is_not_taken_for_a_slope():
    picture = np.zeros((20, 40))
    picture[:, 20], picture[:, 21:] = 0.5, 1.0  # mirrored samples of an edge through the middle all agree
    search = search_of(picture, 0.0)
    chosen = pixels_of(search, search.work_items(), picture.shape)
    assert np.flatnonzero(chosen.all(axis=0)).tolist() == [19, 20, 21]
    share = LUCK * EDGE / (1 + LUCK) * 3 * 0.25 * 4.0 ** -MODELS["sobol"].order
    hidden = 3 * 0.25 / (9 * 4**3)
    assert search.error == pytest.approx(np.sqrt((share + 3 * hidden) / 40), rel=1e-6)


def test_what_may_be_hidden_is_at_least_what_edges_cost_that_evenly_spread_samples_miss():
    n, rng = 16, np.random.default_rng(2)
    area = rng.uniform(0, 1, 400_000)  # of the part of the pixel that is white, from the left; a sample in each n-th
    seen = (np.arange(n) + rng.uniform(0, 1, (len(area), n))) / n < area[:, None]
    missed = np.mean(np.where(seen.any(axis=1), 0.0, area) ** 2)
    picture = np.zeros((20, 40))
    picture[:, 21:] = 1.0
    search = search_of(picture, 0.0, samples=n)
    search.work_items()
    assert missed < search.error**2 * 40 / 2 < 6 * missed


def test_rounds_are_averaged_by_what_they_tell():
    model = Model(1.5, 2)
    search = search_of(np.full((16, 16), 0.5), 1e-4, model=model)
    assert search.work_items()
    search.film.samples[:], search.film.error[:] = 16, 0.0
    search.work_items()
    scale = (1 * 1e-4 * 4**1.5 + 3 * 0.0) / 4  # one contrast of pairs, then three
    assert search.error == pytest.approx(np.sqrt(4 * scale / (4 + LUCK) * 16**-1.5), rel=1e-9)
    search = search_of(np.full((16, 16), 0.5), 1e-4, model=Model(1.5, 1))
    assert search.work_items()
    search.film.samples[:], search.film.error[:] = 16, 0.0
    search.work_items()
    assert search.error == pytest.approx(np.sqrt(3 * 1e-4 * 4**1.5 / (6 + LUCK) * 16**-1.5), rel=1e-9)


def test_an_edge_that_was_seen_once_is_remembered():
    picture = np.zeros((20, 40))
    picture[8, 20] = 1.0
    search = search_of(picture, 0.0)
    assert search.work_items()
    search.show(np.s_[: picture.size], np.zeros((3, picture.size)))
    search.film.samples[:] = 8
    chosen = pixels_of(search, search.work_items(), picture.shape)
    assert chosen[7:10, 19:22].all()
    assert chosen.sum() == 9
