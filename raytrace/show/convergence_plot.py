"""``convergence``: plot of error against samples, from the measurements of a report."""

from __future__ import annotations

import numpy as np

from raytrace.reporting.analysis import curves_of
from raytrace.reporting.plots import against_samples
from raytrace.reporting.sweep import Report
from raytrace.show.drawing import Drawing, new_figure


def convergence(report: Report) -> Drawing:
    """Plot error against samples per pixel for every configuration of a report.

    Parameters
    ----------
    report : Report
        What ``rt.report`` returned.

    Returns
    -------
    Drawing
        ``data``: an (n, 3) array for each configuration, by its name: samples per pixel, RMSE (sRGB), seconds per
        image.

    Raises
    ------
    RaytraceError
        matplotlib isn't installed.

    Notes
    -----
    Both axes are logarithmic: an error that falls as spp^-k is a straight line of slope -k. The
    legend shows the slope between the last two counts whose slope is certain. Independent samples have slope -1/2.

    Examples
    --------
    >>> import raytrace as rt
    >>> report = rt.report("scenes/cornell-box.json", "out", size=(64, 64), budget=10)  # doctest: +SKIP
    >>> rt.show.convergence(report).save("convergence.svg")  # doctest: +SKIP
    """
    data = {
        configuration.name: np.array([(point.spp, point.rmse_srgb, point.seconds) for point in curve], np.float64)
        for configuration, curve in curves_of(report.points).items()
    }
    title = f"{report.about_scene['name']}: error against samples"
    with new_figure(10, 6.4) as figure:
        axes = figure.subplots()
        axes.grid(alpha=0.3)
        against_samples(report.points, report.slopes, report.floor, title, axes)
        axes.legend(fontsize=10)
    return Drawing(title, data, figure)
