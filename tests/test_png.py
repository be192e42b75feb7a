"""PNG files as others read them."""

import io
import zlib

import numpy as np
import pytest
from PIL import Image

from raytrace.image import png

pytestmark = pytest.mark.nojit


def read(data):
    return Image.open(io.BytesIO(data), formats=["PNG"])


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (33, 64), (255, 257)])
def test_every_pixel_comes_back(shape):
    pixels = np.random.default_rng(1).integers(0, 256, (*shape, 3), np.uint8)
    picture = read(png.encode(pixels, {}))
    assert picture.mode == "RGB"
    assert np.array_equal(np.asarray(picture), pixels)


def test_any_layout_will_do():
    pixels = np.arange(4 * 5 * 6, dtype=np.uint8).reshape(4, 5, 6)[::-1, :, ::2]
    assert np.array_equal(np.asarray(read(png.encode(pixels, {}))), pixels)


def test_texts_and_the_colour_space_are_told():
    picture = read(png.encode(np.zeros((2, 3, 3), np.uint8), {"raytrace:seed": "7", "about": "caf\xe9"}))
    picture.load()
    assert picture.text == {"raytrace:seed": "7", "about": "caf\xe9"}
    assert picture.info["srgb"] == 0
    assert picture.info["gamma"] == pytest.approx(1 / 2.2, abs=1e-5)


def test_a_smooth_picture_is_packed_well():
    ramp = np.repeat(np.linspace(0, 255, 256).astype(np.uint8)[None, :, None], 64, axis=0).repeat(3, axis=2)
    assert len(png.encode(ramp, {})) < len(zlib.compress(ramp.tobytes())) / 2
