"""The drawing of an error: signs, maps and numbers of the comparison."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.image.files import LUMINANCE
from raytrace.image.metrics import SSIM_RADIUS, ssim_map


def pictures(shape=(40, 48)):
    rng = np.random.default_rng(1)
    reference = rng.uniform(0.2, 0.8, (*shape, 3))
    image = reference.copy()
    image[8:16, 16:24] += 0.1
    image[30, 5] -= 0.2
    return image, reference


def test_the_maps_are_the_signed_luminance_and_the_similarity():
    image, reference = pictures()
    drawing = rt.show.error(image, reference)
    np.testing.assert_allclose(drawing.data["error"], (image - reference) @ LUMINANCE)
    assert drawing.data["error"][10, 20] > 0 > drawing.data["error"][30, 5]
    numbers, inner = rt.compare(image, reference), np.s_[SSIM_RADIUS:-SSIM_RADIUS, SSIM_RADIUS:-SSIM_RADIUS]
    assert drawing.data["ssim"][inner].mean() == pytest.approx(numbers.ssim, abs=1e-12)
    assert drawing.title.startswith(f"RMSE {numbers.rmse:.3g}; ")
    assert f"SSIM {numbers.ssim:.4f}" in drawing.title


def test_the_frame_is_the_worst_tile():
    drawing = rt.show.error(*pictures())
    (frame,) = [patch for axes in drawing.figure.axes for patch in axes.patches if patch.get_label() == "worst tile"]
    assert (frame.get_xy(), frame.get_width(), frame.get_height()) == ((15.5, 7.5), 8, 8)


def test_a_defect_of_a_few_pixels_sets_the_scale_of_the_colours():
    reference = np.random.default_rng(3).uniform(0.2, 0.8, (64, 64, 3))
    image = reference * (1 + 1e-7)  # rounding
    image[20:22, 30:32] += 0.1  # 0.1 % of the pixels
    drawing = rt.show.error(image, reference)
    (shown,) = [axes.images[0] for axes in drawing.figure.axes if axes.get_title().startswith("error")]
    assert shown.get_clim() == pytest.approx((-0.1, 0.1), rel=1e-3)


def test_equal_pictures_have_no_frame_and_no_error():
    image, _ = pictures()
    drawing = rt.show.error(image, image)
    assert not drawing.data["error"].any()
    assert (drawing.data["ssim"] == 1).all()
    assert not [patch for axes in drawing.figure.axes for patch in axes.patches if patch.get_label() == "worst tile"]


def test_pixels_that_are_not_finite_are_told():
    image, reference = pictures()
    image[3, 4] = np.nan
    drawing = rt.show.error(image, reference)
    assert "pixels that are not finite: 1" in drawing.title
    assert np.isfinite(drawing.data["error"]).all()


def test_the_map_of_a_picture_smaller_than_the_window_has_its_size():
    small = np.random.default_rng(2).uniform(size=(3, 9, 3))
    assert ssim_map(small, small).shape == (3, 9)
    other = small.copy()
    other[1, 4] = 0
    assert ssim_map(small, other).mean() == pytest.approx(rt.compare(other, small).ssim, abs=1e-12)
