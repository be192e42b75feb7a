"""Metrics against hand values and slow plain twins."""

import sys
import warnings

import numpy as np
import pytest

from raytrace.errors import FileError, PackageError
from raytrace.image import files
from raytrace.image.metrics import OUTLIER, RELATIVE_EPS, Limits, compare, level_of, ssim, violations, worst_tile


def pair(height=24, width=21, seed=0):
    rng = np.random.default_rng(seed)
    b = rng.random((height, width, 3)) ** 2
    return b + 0.05 * rng.standard_normal(b.shape), b


def plain_ssim(a, b):
    # the formula pixel by pixel, window by window   [Wang2004]
    i = np.arange(-5, 6)
    window = np.exp(-(i[:, None] ** 2 + i**2) / (2 * 1.5**2))
    window = (window / window.sum())[:, :, None]
    a, b = (files.srgb_encode(np.clip(x, 0.0, 1.0)) for x in (a, b))
    if min(a.shape[:2]) < 11:
        a, b = (np.pad(x, ((5, 5), (5, 5), (0, 0)), mode="symmetric") for x in (a, b))
    values = []
    for y in range(5, a.shape[0] - 5):
        for x in range(5, a.shape[1] - 5):
            p, q = (z[y - 5 : y + 6, x - 5 : x + 6] for z in (a, b))
            mp, mq = ((window * z).sum((0, 1)) for z in (p, q))
            vp, vq = ((window * z**2).sum((0, 1)) - m**2 for z, m in ((p, mp), (q, mq)))
            cov = (window * p * q).sum((0, 1)) - mp * mq
            c1, c2 = 0.01**2, 0.03**2
            values.append((2 * mp * mq + c1) * (2 * cov + c2) / ((mp**2 + mq**2 + c1) * (vp + vq + c2)))
    return float(np.mean(values))


def plain_worst_tile(difference):
    height, width, _ = difference.shape
    best, at = -1.0, None
    for top in range(0, height, 8):
        for left in range(0, width, 8):
            y, x = max(min(top, height - 8), 0), max(min(left, width - 8), 0)
            value = max(abs(difference[y : y + 8, x : x + 8, c].mean()) for c in range(3))
            if value > best:
                best, at = value, (y, x)
    return best, at


def test_equal_pictures_are_at_distance_zero():
    _, b = pair()
    c = compare(b, b)
    assert (c.rmse, c.relative_mse, c.bias, c.relative_bias) == (0.0, 0.0, (0.0,) * 3, (0.0,) * 3)
    assert (c.ssim, c.worst_tile, c.outliers, c.non_finite) == (1.0, 0.0, 0.0, 0)


def test_means_are_those_of_a_plain_loop():
    a, b = pair()
    c = compare(a, b)
    pixels = [(p, q) for y in range(24) for x in range(21) for p, q in zip(a[y, x], b[y, x], strict=True)]
    squares = [(p - q) ** 2 for p, q in pixels]
    assert c.rmse == pytest.approx((sum(squares) / len(pixels)) ** 0.5, rel=1e-12)
    relative = [s / (q**2 + RELATIVE_EPS) for s, (_, q) in zip(squares, pixels, strict=True)]
    assert c.relative_mse == pytest.approx(sum(relative) / len(pixels), rel=1e-12)
    for channel in range(3):
        bias = a[:, :, channel].mean() - b[:, :, channel].mean()
        assert c.bias[channel] == pytest.approx(bias, rel=1e-9)  # a difference of means: cancellation
        assert c.relative_bias[channel] == pytest.approx(bias / b[:, :, channel].mean(), rel=1e-9)


def test_the_error_on_a_screen_is_that_of_what_it_shows():
    a, b = pair()
    a[3, 4], b[3, 4] = (7.0, -1.0, 0.2), (1.0, 0.0, 0.2)  # on a screen these are equal
    codes = [files.srgb_encode(np.clip(x, 0, 1)) for x in (a, b)]
    expected = np.sqrt(np.mean((codes[0] - codes[1]) ** 2))
    assert compare(a, b).rmse_srgb == pytest.approx(expected, rel=1e-12)
    assert np.all(codes[0][3, 4] == codes[1][3, 4])
    assert compare(a, b).rmse > 0.1


def test_the_order_of_pixels_in_memory_changes_no_bit():
    a, b = pair()
    assert compare(np.asfortranarray(a), b) == compare(a, np.asfortranarray(b)) == compare(a, b)


def test_outliers_are_those_of_a_plain_loop():
    a, b = pair()
    level = float((b @ files.LUMINANCE).mean())
    far = sum(any(abs(a[y, x] - b[y, x]) > OUTLIER * (b[y, x] + level)) for y in range(24) for x in range(21))
    assert 0 < far < 24 * 21
    assert compare(a, b).outliers == far / (24 * 21)


@pytest.mark.parametrize("size", [(24, 21), (12, 11), (11, 30), (10, 30), (5, 4), (1, 1)])
def test_ssim_is_that_of_the_plain_formula(size):
    a, b = pair(*size)
    assert ssim(a, b) == pytest.approx(plain_ssim(a, b), rel=1e-9)  # variances by subtraction: about 1e-12


@pytest.mark.parametrize("size", [(24, 16), (24, 21), (9, 15), (8, 8), (7, 20), (3, 2), (1, 1)])
def test_the_worst_tile_is_that_of_a_plain_loop(size):
    a, b = pair(*size)
    value, at = worst_tile(a - b)
    expected, expected_at = plain_worst_tile(a - b)
    assert value == pytest.approx(expected, rel=1e-12)
    assert at == expected_at


@pytest.mark.parametrize("at", [(0, 0), (13, 9), (20, 18)])
def test_the_worst_tile_of_a_dark_pixel_holds_it(at):
    b = np.full((21, 19, 3), 0.5)
    a = b.copy()
    a[at] = 0.0
    c = compare(a, b)
    assert c.worst_tile == pytest.approx(1 / 64)  # 0.5 lost in 1 of 64 pixels, mean 0.5
    assert all(first <= k < first + 8 for first, k in zip(c.worst_tile_at, at, strict=True))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", [0, 1])
def test_a_pixel_that_is_not_finite_is_counted_and_left_out_of_the_means(value, which):
    pictures = pair()
    keep = np.ones((24, 21), bool)
    keep[3, 4] = False
    a, b = (picture[keep][None] for picture in pictures)  # the other pixels, as one row
    pictures[which][3, 4, 1] = value
    c = compare(*pictures)
    assert c.non_finite == 1
    assert (c.rmse, c.bias) == (pytest.approx(compare(a, b).rmse), pytest.approx(compare(a, b).bias))
    assert np.isfinite([c.relative_mse, *c.relative_bias, c.ssim, c.worst_tile, c.outliers]).all()
    assert violations(c, Limits()) == ["pixels that are not finite: 1"]


def test_a_picture_without_a_finite_pixel_breaks_every_limit():
    c = compare(np.full((4, 4, 3), np.nan), np.ones((4, 4, 3)))
    assert c.non_finite == 16
    assert np.isnan(c.rmse)
    assert len(violations(c, Limits(1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0))) == 10


def test_light_against_a_black_reference_is_infinitely_biased():
    black = np.zeros((16, 16, 3))
    c = compare(black + [0.0, 0.1, 0.0], black)
    assert c.relative_bias == (0.0, np.inf, 0.0)
    assert (c.worst_tile, c.outliers) == (np.inf, 1.0)
    assert c.relative_mse == pytest.approx(0.01 / RELATIVE_EPS / 3)


def test_each_broken_limit_gives_one_line():
    c = compare(np.full((16, 16, 3), 0.6), np.full((16, 16, 3), 0.5))
    limits = Limits(0.05, 0.9999, 0.1, max_worst_tile=0.1, max_outliers=0.5, max_rmse_srgb=0.01, max_relative_mse=0.01)
    names = ["rmse", "rmse_srgb", "relative_mse", *["relative"] * 3, "worst", "share", "ssim"]
    assert [line.split()[0] for line in violations(c, limits)] == names
    assert violations(c, Limits(max_rmse=0.2, min_ssim=0.9, max_bias=0.3, max_worst_tile=0.3)) == []
    assert violations(c, Limits()) == []


def test_pictures_may_be_arrays_paths_or_objects_with_rgb(tmp_path):
    a, b = (x.astype(np.float32) for x in pair())
    path = files.save(tmp_path / "b.npz", b)
    expected = compare(a, b)
    assert compare(a, path) == compare(a, str(path)) == compare(a, files.load(path)) == expected
    with pytest.raises(FileError, match="nowhere"):
        compare(tmp_path / "nowhere.npz", b)


def test_what_cannot_be_compared_is_a_clear_error():
    a, b = pair()
    with pytest.raises(ValueError, match="different size: 21x23 against a reference of 21x24"):
        compare(a[1:], b)
    for wrong in (a[:, :, 0], np.zeros((0, 4, 3)), np.zeros((4, 4, 3), np.uint8)):
        with pytest.raises(ValueError, match="image: expected linear radiance"):
            compare(wrong, b)


def test_without_scikit_image_the_message_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.metrics", None)
    with pytest.raises(PackageError, match="pip install scikit-image"):
        compare(*pair())


@pytest.mark.parametrize("seed", range(3))
def test_a_picture_of_negative_light_is_at_distance_zero_from_itself(seed):
    rng = np.random.default_rng(seed)
    for b in (-np.abs(rng.normal(size=(32, 32, 3))), rng.normal(size=(32, 32, 3)), np.zeros((32, 32, 3))):
        c = compare(b, b.copy())
        assert (c.rmse, c.relative_bias, c.worst_tile, c.outliers) == (0.0, (0.0,) * 3, 0.0, 0.0)


def test_distances_do_not_depend_on_the_sign_of_light():
    a, b = pair()
    there, back = compare(a, b), compare(-a, -b)
    assert back.outliers == there.outliers > 0
    assert (back.rmse, back.relative_mse) == (there.rmse, there.relative_mse)
    assert back.worst_tile == pytest.approx(there.worst_tile)


def test_a_level_is_the_mean_size_of_the_luminance():
    assert level_of(np.array([[[1.0, 1.0, 1.0], [-3.0, -3.0, -3.0]]]), 2) == pytest.approx(2.0)
    normals = np.array([[[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]]])  # a mean of 0 is no level
    c = compare(normals * (1 + 1e-7), normals)
    assert (c.outliers, c.worst_tile < 1e-6) == (0.0, True)


def test_light_whose_square_is_too_large_is_far_off_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        c = compare(np.full((8, 8, 3), 1e300), np.full((8, 8, 3), -1e300))
        assert (c.rmse, c.outliers) == (np.inf, 1.0)
        assert violations(c, Limits(max_rmse=1.0, max_bias=1.0)) != []
        assert compare(np.full((8, 8, 3), 1e300), np.full((8, 8, 3), 1e300)).rmse == 0.0
