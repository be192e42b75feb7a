"""Plots of a sweep, by matplotlib: error against time with the Pareto front, and error against samples."""

import contextlib
import io
import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from raytrace.errors import RaytraceError
from raytrace.reporting.analysis import Order, curves_of
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measurements import Point

COLOURS = {
    "sobol": "#0072b2",
    "stratified": "#009e73",
    "independent": "#d55e00",
}  # distinguishable for colour-blind readers
OTHER = "#555555"
SIZE, DPI = (9.6, 6.0), 110  # inches; dots per inch of the PNG
STYLE: Any = {
    "font.size": 13,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "svg.hashsalt": "raytrace",
    "text.parse_math": False,  # "$" in a name does not start a formula
}


def check_matplotlib() -> None:
    """Check that matplotlib is installed, before the measurement.

    Raises
    ------
    RaytraceError
        matplotlib isn't installed.
    """
    try:
        import matplotlib as mpl  # noqa: F401
    except ImportError:
        raise RaytraceError("a report needs matplotlib: pip install matplotlib scikit-image") from None


@contextlib.contextmanager
def without_glyphs() -> Iterator[None]:
    """Suppress the warnings for characters that are missing in matplotlib's font."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from", UserWarning)
        yield


def make_plots(points: Sequence[Point], front: Sequence[bool], orders: Sequence[Order], title: str) -> dict[str, bytes]:
    """Make both plots as PNG and SVG; returns the content of the files by name."""
    import matplotlib as mpl
    from matplotlib.figure import Figure  # without pyplot: needs no window system

    files: dict[str, bytes] = {}
    with mpl.rc_context(STYLE):
        for name, draw in (
            ("error-against-time", partial(_against_time, points, front, title)),
            ("error-against-samples", partial(against_samples, points, orders, title)),
        ):
            figure = Figure(SIZE)
            draw(figure.add_axes((0.12, 0.11, 0.86, 0.82)))
            for kind in ("png", "svg"):
                stream = io.BytesIO()
                metadata = {"Date": None} if kind == "svg" else {"Software": None}  # the same plot gives the same bytes
                with without_glyphs():
                    figure.savefig(stream, format=kind, dpi=DPI, metadata=metadata)
                files[f"{name}.{kind}"] = stream.getvalue()
    return files


def _scale(axes: Any, points: Sequence[Point], title: str, x_label: str) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    scale = "log" if any(point.rmse_srgb for point in points) else "linear"  # log 0 does not exist
    axes.set(xscale="log", yscale=scale, title=title, xlabel=x_label, ylabel="RMSE (sRGB)")
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_locator(LogLocator(10, subs=(1, 2, 5)))
            axis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())


def _look(configuration: Configuration) -> dict[str, Any]:
    """Line style: colour for the sampler; dashes and markers for the other settings."""
    dashes, marker = "-", "o"
    if configuration.adaptive:
        dashes, marker = "-", "*"
    elif configuration.precision == "float64":
        dashes, marker = "--", "s"
    if configuration.triangle != "watertight":
        dashes, marker = ":", "^"
    if configuration.tree != "sah":
        dashes, marker = ":", {"median": "v", "none": "X"}[configuration.tree]
    return {
        "color": "#cc79a7" if configuration.adaptive else COLOURS.get(configuration.sampler, OTHER),
        "linestyle": dashes,
        "marker": marker,
    }


def _against_time(points: Sequence[Point], front: Sequence[bool], title: str, axes: Any) -> None:
    _scale(axes, points, title, "seconds per image")
    for configuration, curve in curves_of(points).items():
        axes.plot(
            [p.seconds for p in curve],
            [p.rmse_srgb for p in curve],
            label=configuration.name,
            markersize=6,
            **_look(configuration),
        )
    best = sorted((p.seconds, p.rmse_srgb) for p, kept in zip(points, front, strict=True) if kept)
    x, y = zip(*best, strict=True)
    axes.step(x, y, where="post", color="black", linewidth=5, alpha=0.15, label="Pareto front", zorder=0)
    axes.plot(x, y, "o", markersize=13, markerfacecolor="none", markeredgecolor="black", alpha=0.6)
    axes.legend(fontsize=10)


def against_samples(points: Sequence[Point], orders: Sequence[Order], title: str, axes: Any) -> None:
    """Plot error against samples on matplotlib axes, with a fitted line for each configuration."""
    _scale(axes, points, title, "samples per pixel")
    fits = {order.configuration: order for order in orders}
    for configuration, curve in curves_of(points).items():
        label = configuration.name + (f": spp^{fits[configuration].order:.2f}" if configuration in fits else "")
        look = _look(configuration)
        line = look["linestyle"] if configuration.adaptive else ""
        axes.plot([p.spp for p in curve], [p.rmse_srgb for p in curve], label=label, **look | {"linestyle": line})
        if configuration in fits:
            x = np.array([min(p.spp for p in curve), max(p.spp for p in curve)])
            axes.plot(
                x,
                fits[configuration].at_one * x ** fits[configuration].order,
                color=look["color"],
                linestyle=look["linestyle"],
            )
    axes.legend(fontsize=10)


def heat(error: Any) -> Any:
    """Colours (h, w, 3) uint8 of sRGB errors (h, w): black at 1e-4 and below, brightest at 1."""
    from matplotlib import colormaps

    level = (np.log10(np.maximum(error, 1e-4)) + 4) / 4
    return (colormaps["inferno"](level)[..., :3] * 255 + 0.5).astype(np.uint8)
