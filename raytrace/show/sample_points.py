"""``samples``: positions of the samples in a pixel, and their projections on x and y."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.limits import MAX_SIDE
from raytrace.passes.camera import camera_rays
from raytrace.passes.sampling import make_sampler
from raytrace.records import Settings, View
from raytrace.rendering.rendering import override, within
from raytrace.show.drawing import BLUE, Drawing, new_figure

MAX_POINTS = 1024
UNIT_VIEW = View(
    np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.zeros(2)
)  # point (x, y) of the film has direction (x, y, 1)


def samples(sampler: str, spp: int, *, seed: int = 0, pixel: tuple[int, int] = (1, 1)) -> Drawing:
    """Draw the samples of a pixel and their projections on x and y.

    Parameters
    ----------
    sampler : {"sobol", "stratified", "independent"}
    spp : int
        Samples per pixel, 1 .. 1024.
    seed : int
    pixel : (x, y)
        Column and row of the pixel; each pixel has different points.

    Returns
    -------
    Drawing
        ``data``: "points", (spp, 2), x and y in [0, 1), pixels, in the order in which ``render`` takes them.

    Raises
    ------
    OptionError
        An invalid option.
    RaytraceError
        matplotlib isn't installed.

    Notes
    -----
    The lines divide the pixel into at least spp cells of equal size. The strips above and beside it are histograms with
    spp intervals; an empty interval is grey. A good sampler leaves few cells and intervals empty.

    Examples
    --------
    >>> import numpy as np
    >>> import raytrace as rt
    >>> points = rt.show.samples("sobol", 16).data["points"]
    >>> sorted(np.floor(16 * points[:, 0]).astype(int).tolist()) == list(range(16))
    True
    """
    spp = within("spp", spp, 1, MAX_POINTS)
    column, row = (within("pixel", number, 0, MAX_SIDE - 1) for number in pixel)
    settings = override(Settings((1, 1), 1, 1, "sobol", "float64", 0), spp, None, seed, None, sampler)
    points = points_of(settings, column, row)
    title = f"{sampler}: {spp} sample{'s' * (spp > 1)} of pixel ({column}, {row}), seed {seed}"
    with new_figure(8.0, 9.0) as figure:
        figure.set_layout_engine("none")  # the strips stand beside the pixel, whatever their labels
        figure.suptitle(title)
        _show(figure, points)
    return Drawing(title, {"points": points}, figure)


def points_of(settings: Settings, column: int, row: int) -> NDArray[np.float64]:
    """Positions (spp, 2) of the samples of a pixel, computed by the kernel that makes camera rays."""
    sampler = make_sampler(settings.sampler, settings.seed, settings.spp)
    x, y = np.full(PACKET, column, np.uint32), np.full(PACKET, row, np.uint32)
    d = np.empty(3 * PACKET * settings.spp)
    camera_rays(UNIT_VIEW, sampler, x, y, np.array([0, settings.spp]), d)
    d = d.reshape(3, settings.spp, PACKET)[:, :, 0]
    return (d[:2] / d[2]).T - [column, row]


def _show(figure: Any, points: NDArray[np.float64]) -> None:
    from matplotlib.ticker import MaxNLocator

    spp = len(points)
    axes = figure.add_axes((0.09, 0.19, 0.70, 0.62))
    size = np.clip(1600 / spp, 6, 90)
    shown = axes.scatter(*points.T, c=np.arange(spp), cmap="viridis", vmin=0, vmax=max(spp - 1, 1), s=size, zorder=3)
    columns = 2 ** round(np.log2(spp) / 2) if spp & (spp - 1) == 0 else int(np.ceil(np.sqrt(spp)))
    rows = -(-spp // columns)
    axes.vlines(np.arange(1, columns) / columns, 0, 1, color="#cccccc", linewidth=0.8)
    axes.hlines(np.arange(1, rows) / rows, 0, 1, color="#cccccc", linewidth=0.8)
    axes.set(xlim=(0, 1), ylim=(1, 0), xlabel="x, pixels", ylabel="y, pixels")
    axes.spines[:].set_visible(True)
    bar, ticks = figure.add_axes((0.09, 0.085, 0.70, 0.02)), MaxNLocator(8, integer=True)
    figure.colorbar(shown, cax=bar, orientation="horizontal", label="index of the sample", ticks=ticks)
    _strip(figure.add_axes((0.09, 0.825, 0.70, 0.08)), points[:, 0], "x")
    _strip(figure.add_axes((0.805, 0.19, 0.09, 0.62)), points[:, 1], "y")


def _strip(axes: Any, values: NDArray[np.float64], side: str) -> None:
    """Draw a histogram with as many intervals as points; empty intervals are grey."""
    spp = len(values)
    counts = np.bincount(np.clip((values * spp).astype(np.int64), 0, spp - 1), minlength=spp)
    edges, empty, most = np.arange(spp) / spp, counts == 0, counts.max()
    bar, limits = (axes.bar, axes.set_ylim) if side == "x" else (axes.barh, axes.set_xlim)
    look: Any = {"align": "edge", "edgecolor": "white", "linewidth": 0.8 if spp <= 64 else 0.0}
    bar(edges, counts, 1 / spp, color=BLUE, **look)
    bar(edges[empty], most, 1 / spp, color="#d4d4d4", **look)
    limits(0, most)
    axes.set(xlim=(0, 1), xticks=[], yticks=[most]) if side == "x" else axes.set(ylim=(1, 0), yticks=[], xticks=[most])
    note = f"{side}: {np.count_nonzero(empty)} of {spp} intervals empty"
    if side == "x":
        axes.set_title(note, fontsize=13)
    else:
        axes.text(1.12, 0.5, note, transform=axes.transAxes, rotation=-90, va="center")
