"""Likely causes of a difference: each planted one is named, and nothing else is."""

import numpy as np
import pytest

from raytrace.golden.causes import likely_causes
from raytrace.image.files import srgb_decode, srgb_encode


def picture(seed=0):
    """Smooth light without symmetry and with an edge, (40, 48, 3), 0 .. 2; a bright lamp."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:40, 0:48] / 48
    light = np.stack([0.1 + 0.6 * x, 0.2 + 0.4 * y * x, 0.1 + 0.3 * np.sin(3 * y) ** 2], axis=2)
    light[5:15, 30:42] *= 0.3
    light[25:28, 8:12] = 2.0
    return light * (1 + 0.1 * rng.random(light.shape))


def shifted(light, down, right):
    return np.roll(light, (down, right), axis=(0, 1))


PLANTED = {
    "it is flipped left to right": lambda a: a[:, ::-1],
    "it is flipped upside down": lambda a: a[::-1],
    "it is rotated by 180 degrees": lambda a: a[::-1, ::-1],
    "red and blue are swapped": lambda a: a[..., ::-1],
    "red and green are swapped": lambda a: a[..., [1, 0, 2]],
    "green and blue are swapped": lambda a: a[..., [0, 2, 1]],
    "the channels are permuted: red, green, blue are those of green, blue, red": lambda a: a[..., [1, 2, 0]],
    "gamma is applied once too often, or not undone: sRGB codes are taken for linear light": srgb_encode,
    "gamma is missing, or undone once too often: linear light is taken for sRGB codes": lambda a: srgb_decode(
        np.clip(a, 0, 1)
    ),
    "all light is multiplied by 1.05": lambda a: 1.05 * a,
    "all light is multiplied by 0.318 (1 / pi)": lambda a: a / np.pi,
    "all light is multiplied by 2.25 (2.25 = 1.5^2, the index of glass squared)": lambda a: 2.25 * a,
    "red, green, blue are multiplied by 1, 1.2, 0.9": lambda a: a * [1.0, 1.2, 0.9],
    "+0.03, +0.03, +0.03 is added to red, green, blue": lambda a: a + 0.03,
    "it is shifted by 1 pixel right": lambda a: shifted(a, 0, 1),
    "it is shifted by 2 pixels up and 1 pixel left": lambda a: shifted(a, -2, -1),
}


@pytest.mark.parametrize("cause", PLANTED)
@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_a_planted_cause_is_named_and_no_other(cause, noise):
    expected = picture()
    actual = PLANTED[cause](expected)
    actual = actual + noise * np.random.default_rng(1).normal(size=actual.shape)
    assert likely_causes(actual, expected) == [cause]


def test_rows_and_columns_of_a_square_image_may_be_swapped():
    expected = picture()[:40, :40]
    assert likely_causes(expected.transpose(1, 0, 2), expected) == ["rows and columns are swapped"]


def changes():
    rng = np.random.default_rng(2)
    tile, pixel, base = picture(), picture(), picture()
    tile[16:24, 16:24] *= 1.3
    pixel[3, 3] = np.nan
    return {
        "nothing": base.copy(),
        "one tile": tile,
        "not finite": pixel,
        "noise": base + 0.02 * rng.normal(size=base.shape),
        "another image": rng.random(base.shape),
        "a light on one side": base * np.linspace(1, 1.2, 48)[:, None],
        "half a pixel": (base + shifted(base, 0, 1)) / 2,
        "black": np.zeros_like(base),
    }


@pytest.mark.parametrize("change", [name for name in changes() if name != "black"])
def test_what_has_no_simple_cause_has_none(change):
    assert likely_causes(changes()[change], picture()) == []


def test_black_images_have_causes_too():
    assert likely_causes(np.zeros((40, 48, 3)), picture()) == ["all light is multiplied by 0"]
    assert likely_causes(picture(), np.zeros((40, 48, 3))) == []
    assert likely_causes(np.ones((1, 1, 3)), np.full((1, 1, 3), 0.5)) == ["all light is multiplied by 2"]


def test_a_part_that_is_not_finite_does_not_hide_the_cause():
    actual = 2 * picture()
    actual[4:6, 4:6] = np.nan
    assert likely_causes(actual, picture()) == ["all light is multiplied by 2"]
