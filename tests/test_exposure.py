"""The automatic exposure, and hints about images that are badly exposed."""

import numpy as np
import pytest

from raytrace.cli.exposure import shown
from raytrace.image import files
from raytrace.image.exposure import CLIPPED, MUCH, auto_exposure, hint

RNG = np.random.default_rng(5)


class Image:
    def __init__(self, rgb):
        self.rgb, self.stderr = rgb, rgb[..., 0]


def grey(values):
    return np.repeat(np.asarray(values, np.float32)[..., None], 3, axis=-1)


@pytest.mark.parametrize("power", [1e-6, 0.003, 1.0, 700.0, 1e9])
def test_the_brightest_pixels_begin_one_stop_below_white_whatever_the_power(power):
    light = grey(power * RNG.random((64, 80)))
    shown = light * 2.0 ** auto_exposure(light)
    assert np.quantile(shown, 0.95) == pytest.approx(0.5, rel=0.01)
    assert shown.max() < 1.1  # no surface that is at most twice as bright clips by more than rounding


def test_the_largest_channel_counts():
    light = np.zeros((4, 4, 3), np.float32)
    light[..., 2] = 4.0
    assert auto_exposure(light) == -3.0


def test_outliers_lamps_and_black_pixels_do_not_decide():
    light = grey(np.full((40, 50), 0.25))
    light[:10] = 0  # a black background
    light[20, :50] = 1e6  # a lamp, or noise: 3 % of the lit pixels
    assert auto_exposure(light) == 1.0
    light[21, :50] = 1e6  # more than 5 %
    assert auto_exposure(light) < -10


def test_black_images_and_values_that_are_not_finite():
    assert auto_exposure(np.zeros((3, 3, 3))) == 0.0
    assert auto_exposure(grey([[np.nan, np.inf, 1.0]])) == -1.0
    assert auto_exposure(grey([[1e-38]])) == 100.0


def test_the_number_is_in_the_file_and_gives_the_same_file(tmp_path):
    light = grey(3 * RNG.random((16, 16)))
    stops = auto_exposure(light)
    assert stops == round(stops, 2) != 0
    first = files.save(tmp_path / "a.png", light, exposure="auto").read_bytes()
    assert first == files.save(tmp_path / "b.png", light, exposure=stops).read_bytes()
    assert files.png_bytes(light, exposure="auto") == first
    assert (files.srgb8(light, "auto") == files.srgb8(light, stops)).all()
    assert b"raytrace:exposure\x00" + str(stops).encode() in first


def test_a_word_that_is_no_exposure_is_refused():
    with pytest.raises(ValueError, match="expected stops or \"auto\", got 'bright'"):
        files.srgb8(np.ones((1, 1, 3)), "bright")


def test_hints_say_what_to_do():
    dark, good = grey(np.full((10, 10), 0.01)), grey(np.full((10, 10), 0.4))
    assert (
        hint(dark, 0.0) == "the image is nearly black; use --exposure auto (+5.64 stops), or multiply the lights by 50"
    )
    assert hint(dark, 5.64) == ""
    assert hint(good, 0.0) == ""
    assert "the image is black" in hint(0 * good, 3.0)
    bright = grey(np.full((10, 10), 0.4))
    bright[: int(10 * MUCH)] = CLIPPED + 0.01
    assert hint(bright, 0.0) == ""  # no more than a fifth
    bright[5] = CLIPPED + 0.01
    assert (
        hint(bright, 0.0)
        == "30 % of the pixels are clipped; use --exposure auto (-1.15 stops), or multiply the lights by 0.45"
    )
    assert hint(bright, -1.15) == ""


@pytest.mark.parametrize(
    ("name", "asked", "stops", "lines"),
    [
        ("a.png", "auto", 1.0, ["exposure: +1.00 stops"]),
        (
            "a.png",
            -7.0,
            -7.0,
            ["hint: the image is nearly black; use --exposure auto (+1.00 stops), or multiply the lights by 260"],
        ),
        ("a.png", 0.0, 0.0, []),
        ("a.exr", "auto", 0.0, ["exposure: none; a .exr file stores the radiance itself"]),
        ("a.exr", 0.0, 0.0, []),
    ],
)
def test_the_command_line_prints_a_chosen_exposure_and_hints(tmp_path, name, asked, stops, lines):
    said = []
    assert shown(None, Image(grey(np.full((4, 4), 0.25))), tmp_path / name, asked, said.append) == stops
    assert said == lines
