"""FLIP and HDR-FLIP against a plain twin, published values, and what happens where flip-evaluator is missing."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import naive_flip
from raytrace.cli import main
from raytrace.errors import OptionError
from raytrace.golden.gates import Gates, judge
from raytrace.golden.store import GoldenImage
from raytrace.image import flip
from raytrace.image.files import load, save
from raytrace.image.metrics import Limits, compare, violations

PUBLISHED = {"png": (flip.flip, 0.159691), "exr": (flip.hdr_flip, 0.283478)}  # src/tests/test.py of NVlabs/flip
PAIR = os.environ.get("RAYTRACE_FLIP_PAIR", "")
WITHOUT = "flip-evaluator is not installed; it has wheels for Python 3.11 to 3.13 on Linux, Windows and macOS"
needs_flip = pytest.mark.skipif(not flip.available(), reason=WITHOUT)


@pytest.fixture
def not_installed(monkeypatch):
    monkeypatch.setattr(flip, "find_spec", lambda _name: None)


def pair():
    """A reference with an edge, and an image with noise, a wrong level and a bright pixel: light, (26, 24, 3)."""
    y, x = np.mgrid[0:26, 0:24] / 26
    reference = np.stack([0.8 * x, 0.3 + 0.2 * np.sin(9 * x * y), 0.7 * y], axis=-1)
    reference[8:16, 8:18] = 0.9, 0.1, 0.05
    image = np.clip(1.05 * reference + np.random.default_rng(3).normal(0, 0.03, reference.shape), 0, 1)
    image[20, 20] = 1.0
    return image, reference


@needs_flip
def test_flip_is_that_of_a_plain_twin():
    image, reference = pair()
    expected = naive_flip.ldr_flip(
        image, reference, 0.7 * (3840 / 0.7) * np.pi / 180
    )  # 0.7 m away, 3840 pixels on 0.7 m
    assert flip.flip_map(image, reference) == pytest.approx(expected, abs=1e-5)
    assert compare(image, reference).flip == pytest.approx(expected.mean(), abs=1e-6)
    assert expected.mean() > 0.1
    clipped = compare(np.where(image == 1.0, 7.0, image), reference - (reference == 0.0))
    assert clipped.flip == pytest.approx(expected.mean(), abs=1e-6)  # a screen shows 0 .. 1


@needs_flip
def test_hdr_flip_is_that_of_a_plain_twin():
    image, reference = (4 * light for light in pair())
    reference[3:6, 3:6] *= 9
    expected = naive_flip.hdr_flip(image, reference, flip.PIXELS_PER_DEGREE)
    assert flip.hdr_flip_map(image, reference) == pytest.approx(expected, abs=1e-5)
    assert compare(image, reference).hdr_flip == pytest.approx(expected.mean(), abs=1e-6)
    negative = compare(image - (image == 0.0), reference)
    assert negative.hdr_flip == pytest.approx(expected.mean(), abs=1e-6)


@needs_flip
def test_green_and_blue_have_the_largest_difference():
    green, blue = np.zeros((2, 9, 9, 3))
    green[..., 1] = blue[..., 2] = 1.0
    assert flip.flip(green, blue) == pytest.approx(1.0, abs=1e-6)  # by definition [Andersson2020, section 4.1.3]


@pytest.mark.skipif(not PAIR, reason="set RAYTRACE_FLIP_PAIR to the folder images/ of github.com/NVlabs/flip")
@pytest.mark.parametrize("kind", PUBLISHED)
def test_the_published_pair_has_the_published_mean(kind):
    reference, image = (load(Path(PAIR) / f"{name}.{kind}").rgb.astype(float) for name in ("reference", "test"))
    measure, published = PUBLISHED[kind]
    assert measure(image, reference) == pytest.approx(published, abs=2e-6)


@needs_flip
def test_equal_images_have_none_and_black_references_no_exposure():
    _, reference = pair()
    same = compare(reference, reference)
    assert (same.flip, same.hdr_flip, same.mrse) == (0.0, 0.0, 0.0)
    black = np.zeros((4, 4, 3))
    assert compare(black, black).hdr_flip == 0.0
    found = compare(black + 0.5, black)  # the package itself would end the process
    assert np.isnan(found.hdr_flip)
    assert found.flip > 0.5
    assert violations(found, Limits(max_hdr_flip=1.0)) == ["hdr_flip nan is above 1"]


@needs_flip
@pytest.mark.filterwarnings("error")
def test_pixels_that_are_not_finite_and_large_values_are_no_problem():
    image, reference = pair()
    expected = compare(image, reference).flip
    image[2, 2], reference[2, 3] = np.nan, np.inf
    assert compare(image, reference).flip == pytest.approx(expected, rel=0.1)
    assert 0 < compare(np.full((3, 1, 3), 1e300), np.full((3, 1, 3), 0.1)).hdr_flip <= 1


def test_mrse_is_the_mean_of_a_plain_loop():
    image, reference = pair()
    reference[0] *= -1
    each = [(a - b) ** 2 / (abs(b) + 0.01) ** 2 for a, b in zip(image.ravel(), reference.ravel(), strict=True)]
    assert compare(image, reference).mrse == pytest.approx(sum(each) / len(each), rel=1e-12)
    assert violations(compare(image, reference), Limits(max_mrse=1e-3))[0].startswith("mrse ")


def test_nothing_is_measured_where_flip_is_not_asked_for():
    found = compare(*pair(), flip=False)
    assert (found.flip, found.hdr_flip) == (None, None)
    assert found[:-2] == compare(*pair())[:-2]


def test_without_the_package_only_flip_is_missing(not_installed):
    found = compare(*pair())
    assert (found.flip, found.hdr_flip) == (None, None)
    assert found.ssim < 1
    with pytest.raises(OptionError, match=r"^flip: needs flip-evaluator: pip install flip-evaluator$"):
        compare(*pair(), flip=True)


@pytest.fixture
def files(tmp_path):
    for name, light in zip("ab", pair(), strict=True):
        save(tmp_path / f"{name}.npz", light)
    return [str(tmp_path / f"{name}.npz") for name in "ab"]


@needs_flip
def test_the_command_measures_flip_and_has_limits(files, capsys):
    assert (
        main.main(["compare", *files, "--json", "--max-flip", "0.01", "--max-hdr-flip", "0.9", "--max-mrse", "99"]) == 5
    )
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert found["flip"] == pytest.approx(compare(*files).flip)
    assert 0 < found["hdr_flip"] < 0.9
    assert found["violations"] == printed.err.splitlines() == [f"flip {found['flip']:.6g} is above 0.01"]
    assert main.main(["compare", *files, "--no-flip"]) == 0
    assert "flip" not in capsys.readouterr().out
    assert main.main(["compare", *files, "--no-flip", "--max-flip", "1"]) == 2


def test_without_the_package_the_command_says_once_what_to_install(files, capsys, not_installed):
    assert main.main(["compare", *files]) == 0
    printed = capsys.readouterr()
    assert "flip" not in printed.out
    assert printed.err.splitlines() == [flip.MISSING]
    assert "pip install flip-evaluator" in flip.MISSING
    for option in (["--flip"], ["--max-flip", "0.1"], ["--max-hdr-flip", "0.1"]):
        assert main.main(["compare", *files, *option]) == 2
        assert capsys.readouterr().err == f"{option[0]}: needs flip-evaluator: pip install flip-evaluator\n"


@needs_flip
def test_flip_is_a_gate_of_golden_images_that_is_off_by_default():
    image, reference = pair()
    golden, others = GoldenImage(reference, None, 1), Gates(*[None] * len(Gates._fields))
    assert Gates().max_flip is None
    assert judge(image, golden, others)
    assert "flip" not in str(judge(image, golden, others))
    expected = flip.flip(image, reference)
    assert judge(image, golden, others._replace(max_flip=1.01 * expected))
    failed = judge(image, golden, others._replace(max_flip=0.99 * expected))
    assert failed.broken == (f"flip {expected:.6g} is above {0.99 * expected:g}",)
    assert f"flip {expected:.3g}" in str(failed)


def test_the_gate_is_an_error_without_the_package(not_installed):
    image, reference = pair()
    with pytest.raises(OptionError, match=r"^max_flip: needs flip-evaluator: pip install flip-evaluator$"):
        judge(image, GoldenImage(reference, None, 1), Gates(max_flip=0.1))
