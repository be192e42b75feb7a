"""``Render.var``: against its definition, the spread of many seeds, and in files and incomplete images."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.image import files
from raytrace.passes.estimate import MODELS, weights_of
from raytrace.passes.film import LUMINANCE, MAX_RADIANCE, bin_counts, develop, make_film, make_frame
from raytrace.rendering import run

BOX = Path(__file__).parents[1] / "scenes" / "cornell-box.json"
ROOM = {
    "camera": {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 60},
    "render": {"integrator": "path", "max_depth": 3},
    "materials": {
        "lamp": {"type": "diffuse", "albedo": [0.7, 0.4, 0.1], "emission": [0.1, 0.3, 0.5]},
        "wall": {"type": "diffuse", "albedo": [0.8, 0.5, 0.2], "two_sided": True},
    },
    "objects": [
        {"rectangle": {}, "material": "wall", "scale": 4, "translate": [0, 0, -1]},
        {"box": {}, "material": "lamp", "scale": 0.6, "rotate": {"axis": [1, 1, 0], "angle": 40}},
    ],
}


def developed(samples, model):
    """Variances of the means of samples (n, m, 3), from bins that are filled by their definition."""
    n, m = samples.shape[:2]
    bounds = np.concatenate([[0], np.cumsum(bin_counts([n])[:, 0])])
    film, frame = make_film(m), make_frame(m)
    film.sums[:] = np.concatenate([samples[a:b].sum(axis=0).T for a, b in pairwise(bounds)])
    film.samples[:] = n
    develop(film, np.arange(m), 0, n, weights_of({n}, model), frame)
    return frame.var


@pytest.mark.parametrize("n", [2, 3, 4, 5, 7, 8, 12, 31, 64])
def test_independent_samples_by_the_formula_of_batch_means(n):
    """Each pair of bins estimates sigma^2 as na nb / (na + nb) (mean a - mean b)^2; the mean of all, over n."""
    samples = np.random.default_rng(n).normal(0.4, 0.1, (n, 16, 3))
    a, b, c, d = np.split(samples, np.cumsum(bin_counts([n])[:, 0])[:-1])
    pairs = [pair for pair in ((np.concatenate([a, b]), np.concatenate([c, d])), (a, b), (c, d)) if min(map(len, pair))]
    squares = [len(x) * len(y) / (len(x) + len(y)) * (x.mean(axis=0) - y.mean(axis=0)) ** 2 for x, y in pairs]
    np.testing.assert_allclose(developed(samples, MODELS["independent"]), np.mean(squares, axis=0) / n, rtol=1e-6)


@pytest.mark.parametrize("sampler", MODELS)
def test_the_variance_of_grey_light_is_that_of_its_luminance(sampler):
    """The channels have the model of ``stderr``: contrasts, and the order of convergence of the sampler."""
    grey = rt.load(BOX)
    grey.lights.flux[:], grey.materials.albedo[:] = 12.0, 0.5
    image = rt.render(grey, spp=12, size=(24, 24), sampler=sampler)
    assert (image.var > 0).any()
    for c in range(3):
        np.testing.assert_allclose(image.var[..., c] * sum(LUMINANCE) ** 2, image.stderr**2, rtol=2e-5, atol=1e-14)


def many(scene, sampler):
    """Over 64 seeds: the variance of the means, and the mean of the stated variances; (h, w, 3) each."""
    images = [rt.render(scene, spp=16, size=(16, 16), seed=seed, sampler=sampler, threads=1) for seed in range(64)]
    spread = np.var([image.rgb for image in images], axis=0, ddof=1, dtype=np.float64)
    return spread, np.mean([image.var for image in images], axis=0, dtype=np.float64)


def test_variances_of_independent_samples_are_the_spread_over_seeds():
    """4.5 standard errors of the sum over pixels, which find factors of 0.7 and 1.5 in each channel."""
    spread, stated = many(ROOM, "independent")
    for c in range(3):

        def deviation(factor, c=c):
            miss = (spread - factor * stated)[..., c]  # independent from pixel to pixel, with mean 0 for factor 1
            return miss.sum() / np.sqrt((miss**2).sum())

        assert abs(deviation(1.0)) < 4.5
        assert deviation(0.7) > 4.5
        assert deviation(1.5) < -4.5


def test_variances_of_a_net_are_the_spread_over_seeds_within_the_model():
    """The order of convergence is a model: the sums over pixels agree within a factor of three."""
    spread, stated = many(BOX, "sobol")
    ratio = stated.sum(axis=(0, 1)) / spread.sum(axis=(0, 1))
    assert (ratio > 1 / 3).all()
    assert (ratio < 3).all()


def test_fewer_than_two_samples_have_no_variance():
    assert np.isnan(rt.render(BOX, spp=1, size=(8, 8)).var).all()
    assert np.isfinite(rt.render(BOX, spp=2, size=(8, 8)).var).all()
    stopped = rt.render(BOX, spp=4, size=(8, 8), time_limit=0)
    assert stopped.provenance["samples"] == 0
    assert stopped.var.shape == (8, 8, 3)
    assert np.isnan(stopped.var).all()


def test_variances_stay_within_float32():
    samples = np.zeros((4, 16, 3))
    samples[0] = 1e30
    assert (developed(samples, MODELS["independent"]) == np.float32(MAX_RADIANCE)).all()


def test_adaptive_and_cropped_images_have_the_variances_of_their_own_samples(monkeypatch):
    size = (40, 36)
    image = rt.render(BOX, size=size, target_error=4e-3, spp=64)
    numbers = image.aov["samples"]
    assert len(np.unique(numbers)) > 2
    for n in np.unique(numbers):
        alone = rt.render(BOX, size=size, spp=int(n))
        assert np.array_equal(image.var[numbers == n], alone.var[numbers == n])
    crop = rt.render(BOX, size=size, spp=8, crop=(3, 5, 20, 17))
    whole = rt.render(BOX, size=size, spp=8)
    assert np.array_equal(crop.var, whole.var[5:22, 3:23])
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 1)
    assert np.array_equal(rt.render(BOX, size=size, spp=8).var, whole.var)


@pytest.mark.parametrize("suffix", ["exr", "npz"])
def test_files_keep_it_and_files_without_it_are_read(suffix, tmp_path):
    if suffix == "exr":
        openexr = pytest.importorskip("OpenEXR")
    image = rt.render(BOX, spp=2, size=(9, 5))
    path = image.save(tmp_path / f"a.{suffix}")
    assert np.array_equal(files.load(path).var, image.var)
    if suffix == "exr":
        with openexr.File(str(path), separate_channels=True) as file:
            assert {"variance.R", "variance.G", "variance.B"} <= file.channels().keys()
    assert files.load(files.save(tmp_path / f"b.{suffix}", image.rgb, stderr=image.stderr)).var is None
