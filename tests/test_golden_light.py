"""What may be handed to a golden, and what its numbers are taken to mean."""

import numpy as np
import pytest
from PIL import Image

import raytrace as rt
from raytrace import image
from raytrace.golden.light import to_light
from small_scenes import studio

RGB = np.random.default_rng(1).uniform(size=(6, 5, 3))
CODES = np.random.default_rng(2).integers(0, 256, (6, 5, 3), np.uint8)


def test_a_render_is_its_light():
    picture = rt.render(studio(), spp=1)
    np.testing.assert_array_equal(to_light(picture), picture.rgb)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_floats_are_linear_light_unless_told_otherwise(dtype):
    np.testing.assert_array_equal(to_light(RGB.astype(dtype)), RGB.astype(dtype))
    np.testing.assert_array_equal(to_light(RGB.astype(dtype), "srgb"), image.srgb_decode(RGB.astype(dtype)))


def test_bytes_are_srgb_codes_unless_told_otherwise():
    np.testing.assert_array_equal(to_light(CODES), image.srgb_decode(CODES / 255))
    np.testing.assert_array_equal(to_light(CODES, "linear"), CODES / 255)


def test_a_picture_of_pillow_is_an_array():
    np.testing.assert_array_equal(to_light(Image.fromarray(CODES)), to_light(CODES))


@pytest.mark.parametrize("ending", ["png", "exr", "npz"])
def test_a_file_says_itself_what_it_holds(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    image.save(path, RGB)
    np.testing.assert_array_equal(to_light(path), image.load(path).rgb)
    np.testing.assert_array_equal(to_light(str(path)), image.load(path).rgb)
    with pytest.raises(ValueError, match="leave the encoding out"):
        to_light(path, "srgb")


def test_grey_and_opaque_pictures_have_three_channels():
    for grey in (RGB[:, :, 0], RGB[:, :, :1]):
        np.testing.assert_array_equal(to_light(grey), np.repeat(RGB[:, :, :1], 3, axis=2))
    np.testing.assert_array_equal(to_light(np.dstack([RGB, np.ones((6, 5))])), RGB)
    np.testing.assert_array_equal(to_light(np.dstack([CODES, np.full((6, 5), 255, np.uint8)])), to_light(CODES))


def test_an_alpha_below_one_is_refused(tmp_path):
    with pytest.raises(ValueError, match="alpha below 1"):
        to_light(np.dstack([RGB, np.full((6, 5), 0.5)]))
    Image.fromarray(np.dstack([CODES, np.full((6, 5), 254, np.uint8)])).save(tmp_path / "a.png")
    with pytest.raises(rt.FileError, match=r"a\.png: has an alpha below 1"):
        to_light(tmp_path / "a.png")
    Image.fromarray(np.dstack([CODES, np.full((6, 5), 255, np.uint8)])).save(tmp_path / "b.png")
    np.testing.assert_allclose(to_light(tmp_path / "b.png"), to_light(CODES), rtol=1e-7)


@pytest.mark.parametrize(
    ("picture", "encoding", "words"),
    [
        (CODES.astype(np.int64), None, "expected floats or uint8, got int64"),
        (RGB[0, 0], None, r"expected shape \(height, width, 3\), got \(3,\)"),
        (RGB[:, :, :2], None, "expected shape"),
        (RGB[:0], None, "expected shape"),
        ("a picture", None, "unknown kind of picture"),
        (RGB, "gamma", "expected 'linear' or 'srgb', got 'gamma'"),
        (None, None, "expected floats or uint8, got object"),
    ],
)
def test_what_is_no_picture_is_told(picture, encoding, words):
    with pytest.raises((ValueError, rt.FileError), match=words):
        to_light(picture, encoding)
