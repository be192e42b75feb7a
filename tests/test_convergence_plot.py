"""The drawing of convergence: the points of the report."""

import numpy as np

import raytrace as rt
from test_sweep_table import a_report


def test_the_drawing_holds_and_shows_the_points_of_the_report():
    report = a_report()
    drawing = rt.show.convergence(report)
    held = np.concatenate(list(drawing.data.values()))
    assert sorted(map(tuple, held)) == sorted((p.spp, p.rmse_srgb, p.seconds) for p in report.points)
    (axes,) = drawing.figure.axes
    marks = [line.get_xydata() for line in axes.lines]
    assert sorted(map(tuple, np.concatenate(marks))) == sorted((p.spp, p.rmse_srgb) for p in report.points)
    assert axes.get_xscale() == "log"
    assert report.about_scene["name"] in drawing.title
