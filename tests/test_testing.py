"""``rt.testing``: its probabilities against SciPy, and that it accepts what is right and rejects what is wrong."""

import contextlib
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import raytrace as rt
from raytrace.errors import OptionError
from raytrace.testing.distributions import chi_square_tail, sidak, student_tails
from raytrace.testing.outcome import uniform
from raytrace.testing.samplers import pearson

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize("degrees", [1, 2, 7.5, 100, 4321, 1e5])
def test_probabilities_are_those_of_scipy(degrees):
    for share in (1e-12, 1e-6, 0.01, 0.4, 0.5, 0.9, 1 - 1e-9):
        x = stats.chi2.isf(share, degrees)
        assert chi_square_tail(x, degrees) == pytest.approx(stats.chi2.sf(x, degrees), rel=1e-9)
        t = stats.t.isf(share / 2, degrees)
        assert student_tails(-t, degrees) == pytest.approx(2 * stats.t.sf(t, degrees), rel=1e-9)
    assert (chi_square_tail(0, degrees), chi_square_tail(math.inf, degrees)) == (1, 0)
    assert (student_tails(0, degrees), student_tails(math.inf, degrees)) == (1, 0)


def test_sidak():
    level = sidak(0.01, 50)
    assert 1 - (1 - level) ** 50 == pytest.approx(0.01)
    assert sidak(1e-3, 1) == pytest.approx(1e-3)


def test_random_numbers_are_uniform_and_independent():
    u = uniform(100_000, 3, 5)
    assert u.shape == (100_000, 3)
    for a, b in ((0, 1), (1, 2), (0, 2)):
        counts = np.histogram2d(u[:, a], u[:, b], 16, ((0, 1), (0, 1)))[0]
        assert pearson(counts, np.full(256, 1e5 / 256), 100_000).p_value > 1e-3
    assert not np.array_equal(u, uniform(100_000, 3, 6))


# chi_square -----------------------------------------------------------------------------------------------------------


def cosine(u):
    r, phi = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r * r)], axis=1)


def lobe(u, sharpness=200):
    """A von Mises-Fisher lobe about (0.6, 0, 0.8)."""
    z = 1 + np.log1p(u[:, 0] * np.expm1(-2 * sharpness)) / sharpness
    s, phi = np.sqrt(np.maximum(1 - z * z, 0)), 2 * np.pi * u[:, 1]
    d = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1)
    return d @ np.array([[0.8, 0, -0.6], [0, 1, 0], [0.6, 0, 0.8]])


def lobe_density(d, sharpness=200):
    return sharpness / (2 * np.pi * -np.expm1(-2 * sharpness)) * np.exp(sharpness * (d @ [0.6, 0, 0.8] - 1))


def test_right_samplers_pass():
    found = rt.testing.chi_square(cosine, lambda d: np.maximum(d[:, 2], 0) / np.pi)
    assert found.p_value > 1e-3
    assert found.integral == pytest.approx(1)
    assert found.observed.sum() == 100_000
    chart = rt.testing.Chart((0.6, 0, 0.8), 0.1)
    assert rt.testing.chi_square(lobe, lobe_density, charts=[chart]).degrees > 80
    rt.testing.chi_square(lobe, lobe_density)  # without its chart, most cells are empty

    def rejected(u):  # a third of the samples carry nothing
        d = cosine(u)
        d[u[:, 2] < 1 / 3] = np.nan
        return d

    found = rt.testing.chi_square(rejected, lambda d: np.maximum(d[:, 2], 0) * 2 / 3 / np.pi, dimensions=3)
    assert found.integral == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("sample", "pdf", "text"),
    [
        (cosine, lambda d: (d[:, 2] > 0) / (2 * np.pi), "do not have the density"),
        (lambda u: cosine(u) * [1, 1, -1], lambda d: np.maximum(d[:, 2], 0) / np.pi, "do not have the density"),
        (cosine, lambda d: np.maximum(d[:, 2], 0), "more than 1"),
        (lambda u: lobe(u, 150), lobe_density, "do not have the density"),
        (lambda u: cosine(np.stack([0.99 * u[:, 0], u[:, 1]], 1)), lambda d: np.maximum(d[:, 2], 0) / np.pi, "p = "),
    ],
)
def test_wrong_samplers_fail(sample, pdf, text):
    with pytest.raises(rt.testing.StatisticalError, match=text) as caught:
        rt.testing.chi_square(sample, pdf, charts=[rt.testing.Chart((0.6, 0, 0.8), 0.5)])
    assert isinstance(caught.value, AssertionError)
    assert caught.value.result.degrees > 0


def test_the_share_of_false_alarms_is_the_level():
    """p-values of right samples are uniform: of 200, about 20 are below 0.1."""
    expected = np.full(64, 5000 / 64)
    p = np.array(
        [pearson(np.histogram(uniform(5000, 1, k), 64, (0, 1))[0], expected, 5000).p_value for k in range(200)]
    )
    assert 8 <= (p < 0.1).sum() <= 35
    assert stats.kstest(p, "uniform").pvalue > 1e-3


# t_test ---------------------------------------------------------------------------------------------------------------


def test_unbiased_means_pass_and_biased_ones_fail():
    images = 1 + 0.1 * np.random.default_rng(0).standard_normal((16, 8, 8, 3))
    found = rt.testing.t_test(images, 1.0)
    assert found.degrees == 15
    assert found.mean.shape == (8, 8, 3)
    assert found.level == pytest.approx(sidak(1e-3, 192))
    images[:, 3, 5, 1] += 0.2
    with pytest.raises(AssertionError, match=r"biased at \(3, 5, 1\): \+0\.\d+ \(\+\d+\.\d+ %\)") as caught:
        rt.testing.t_test(images, 1.0)
    assert caught.value.result.at == (3, 5, 1)
    rt.testing.t_test(images, 1.0, tolerance=0.2)


def test_t_is_that_of_scipy():
    values = 0.3 + np.random.default_rng(2).random(7)
    found = rt.testing.t_test(values, 0.75)
    other = stats.ttest_1samp(values, 0.75)
    assert (found.t, found.p_value) == pytest.approx((other.statistic, other.pvalue))
    assert found.error == pytest.approx(values.mean() - 0.75)


def test_given_variances():
    assert rt.testing.t_test(1.03, 1.0, variance=1e-4).p_value == pytest.approx(math.erfc(3 / math.sqrt(2)))
    with pytest.raises(AssertionError, match=r"4\.0 standard errors"):
        rt.testing.t_test([1.0, 1.04], 1.0, variance=1e-4)
    assert rt.testing.t_test([1.0, 1.04], 1.0, variance=1e-4, reference_variance=3e-4).t == pytest.approx(2)
    assert rt.testing.t_test([2.0, 2.0], 2.0).p_value == 1
    with pytest.raises(AssertionError):
        rt.testing.t_test([2.0, 2.0], 1.0)  # without noise any error is a bias


# furnace --------------------------------------------------------------------------------------------------------------


class Lambert:
    """Somebody's diffuse surface, with mistakes on request."""

    def __init__(self, scale=1.0, weight=0.5, density=1.0):
        self.scale, self.weight, self.density = scale, weight, density

    def eval(self, wo, wi):
        return np.where(wi[:, 2] > 0, self.scale * 0.5 / np.pi, 0)

    def pdf(self, wo, wi):
        return np.maximum(wi[:, 2], 0) / np.pi * self.density

    def sample(self, wo, u):
        wi = cosine(u)
        return wi, np.full(len(u), self.weight), self.pdf(wo, wi)


def test_a_right_surface_passes():
    found = rt.testing.furnace(Lambert(), expected=0.5, n=20_000)
    np.testing.assert_allclose(found.sampled, 0.5)
    assert (np.abs(found.evaluated - 0.5) < 4 * found.stderr[1]).all()


@pytest.mark.parametrize(
    ("surface", "options", "text"),
    [
        (Lambert(scale=np.pi), {}, "weight times pdf is not f cos"),
        (Lambert(weight=0.55), {}, "weight times pdf is not f cos"),
        (Lambert(scale=2.2, weight=1.1), {}, "more light leaves than arrives"),
        (Lambert(density=1.2, weight=0.5 / 1.2), {}, "sampling and eval disagree"),
        (Lambert(), {"expected": 0.52}, "is not the expected one"),
    ],
)
def test_wrong_surfaces_fail(surface, options, text):
    with pytest.raises(rt.testing.StatisticalError, match=text):
        rt.testing.furnace(surface, n=20_000, **options)


@pytest.mark.parametrize(
    ("material", "options"),
    [
        ({"type": "diffuse", "albedo": [0.2, 0.5, 0.8]}, {"expected": [[0.2, 0.5, 0.8]]}),
        ({"type": "mirror", "reflectance": [0.2, 0.5, 0.8]}, {"expected": [[0.2, 0.5, 0.8]]}),
        ({"type": "conductor", "metal": "gold"}, {}),
        ({"type": "conductor", "metal": "gold", "alpha": 0.4}, {}),
        ({"type": "dielectric", "ior": 1.5}, {}),
        ({"type": "dielectric", "ior": 1.5, "alpha": 0.5}, {}),
        ({"type": "plastic", "albedo": [1, 1, 1], "ior": 1.5}, {"expected": 1.0}),
        ({"type": "refractive", "ior": 1.5}, {}),
    ],
)
def test_our_materials_pass(material, options):
    rt.testing.furnace(material, n=20_000, tests=8, **options)


def test_the_examples_of_the_documents_work():
    text = (Path(__file__).parents[1] / "docs" / "testing.md").read_text("utf-8")
    program = "".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    lines = out.getvalue().splitlines()
    assert [*lines[:2], lines[2][:5]] == ["the samples do not have the density", "True True", "[0.5 "]


# Arguments ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: rt.testing.chi_square(lambda u: u, lambda d: d[:, 0]), r"expected directions of shape \(100000, 3\)"),
        (lambda: rt.testing.chi_square(cosine, lambda d: d), "pdf: expected"),
        (lambda: rt.testing.chi_square(cosine, lambda d: d[:, 2]), "at least 0"),
        (lambda: rt.testing.chi_square(cosine, len, level=0), "level: expected"),
        (lambda: rt.testing.chi_square(cosine, len, tests=0), "tests: expected"),
        (lambda: rt.testing.chi_square(cosine, len, charts=[((0, 0, 0), 1)]), "axis: expected"),
        (lambda: rt.testing.chi_square(np.ones((5, 3)), len), "n: expected from 100"),
        (lambda: rt.testing.t_test([1.0], 1.0), "at least two"),
        (lambda: rt.testing.t_test([[1.0, 2.0], [1.0, 2.0]], [1.0, 2.0, 3.0]), "broadcast"),
        (lambda: rt.testing.t_test([1.0, np.nan], 1.0), "finite"),
        (lambda: rt.testing.furnace(Lambert(), degrees=90), "degrees: expected"),
        (lambda: rt.testing.furnace(Lambert(), n=3), "n: expected"),
    ],
)
def test_mistakes_are_named(call, text):
    with pytest.raises(OptionError, match=text):
        call()


def test_what_is_wrong_with_a_density_or_a_scattering_function_is_named():
    up = np.array([0.0, 0.0, 1.0])
    for value in (np.nan, -1.0):
        with pytest.raises(rt.OptionError, match=f"got {value:g} at"):
            rt.testing.chi_square(lambda u: np.tile(up, (len(u), 1)), lambda d, value=value: np.full(len(d), value))
    with pytest.raises(rt.OptionError, match="eval, pdf and sample; no eval"):
        rt.testing.furnace("diffuse")
