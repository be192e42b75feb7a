"""Drawn samples: those of ``render``, and what their projections leave empty."""

import numpy as np
import pytest

import raytrace as rt
from naive_sampling import film_points


@pytest.mark.parametrize("sampler", ["sobol", "stratified", "independent"])
@pytest.mark.parametrize(("pixel", "seed", "spp"), [((0, 0), 0, 1), ((5, 3), 7, 64), ((1023, 2), 1, 12)])
def test_points_are_those_of_the_pixel(sampler, pixel, seed, spp):
    points = rt.show.samples(sampler, spp, seed=seed, pixel=pixel).data["points"]
    expected = film_points(sampler, seed, spp, (*pixel, 1, 1))[0, 0] - pixel
    np.testing.assert_allclose(points, expected, atol=1e-9)  # by way of directions, beyond a thousand pixels


def test_the_drawing_shows_the_points_and_counts_the_empty_cuts():
    drawing = rt.show.samples("independent", 64)
    points = drawing.data["points"]
    axes, _, above, beside = drawing.figure.axes
    np.testing.assert_array_equal(axes.collections[0].get_offsets(), points)
    empty = [64 - len(np.unique((64 * points[:, k]).astype(int))) for k in range(2)]
    assert min(empty) > 0
    assert above.get_title() == f"x: {empty[0]} of 64 intervals empty"
    assert [text.get_text() for text in beside.texts] == [f"y: {empty[1]} of 64 intervals empty"]
    assert (
        sum(bar.get_height() for bar in above.patches if bar.get_facecolor()[2] > 0.65 and bar.get_facecolor()[0] < 0.1)
        == 64
    )


def test_sobol_leaves_no_cut_empty():
    assert rt.show.samples("sobol", 64).figure.axes[2].get_title() == "x: 0 of 64 intervals empty"
