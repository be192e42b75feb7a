"""Plots of a sweep, by matplotlib: error against time, error against samples, and spectra of errors."""

import contextlib
import io
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from raytrace.errors import PackageError
from raytrace.reporting.analysis import curves_of
from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measurements import Point
from raytrace.reporting.precision_floor import Floor
from raytrace.reporting.slopes import Slope
from raytrace.reporting.spectrum import Spectrum


class Theme(NamedTuple):
    """Colours of a plot, distinguishable for colour-blind readers."""

    ink: str
    paper: str
    colours: dict[str, str]  # by sampler, or by renderer
    other: str


LIGHT = Theme(
    "#111111",
    "#ffffff",
    {
        "sobol": "#0072b2",
        "stratified": "#009e73",
        "independent": "#d55e00",
        "adaptive": "#b0558f",
        "Mitsuba": "#8a6a00",
    },
    "#555555",
)
NIGHT = Theme(
    "#e6e6e6",
    "#15181c",
    {
        "sobol": "#56b4e9",
        "stratified": "#2cc99a",
        "independent": "#ff9445",
        "adaptive": "#e59fca",
        "Mitsuba": "#e8cf4a",
    },
    "#a8a8a8",
)
DARK = "-dark.svg"  # end of the names of plots for a dark page
SIZE, DPI = (8.0, 7.8), 120  # inches; dots per inch of the PNG. Half of a projected page of 1920 pixels
FAR = 30.0  # the floor of float32 is a line in the plot if the smallest error is at most so many times larger
STYLE: Any = {
    "font.size": 15,
    "axes.titlesize": 16,
    "legend.fontsize": 12,
    "lines.linewidth": 2.2,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "svg.hashsalt": "raytrace",
    "text.parse_math": False,  # "$" in a name does not start a formula
}


class Plotted(NamedTuple):
    """What the plots show."""

    points: Sequence[Point]
    front: Sequence[bool]
    slopes: Sequence[Slope]
    floor: Floor | None
    spectra: Sequence[Spectrum]
    title: str


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
        raise PackageError("a report needs matplotlib: pip install matplotlib scikit-image") from None


@contextlib.contextmanager
def without_glyphs() -> Iterator[None]:
    """Suppress the warnings for characters that are missing in matplotlib's font."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from", UserWarning)
        yield


def make_plots(shown: Plotted) -> dict[str, bytes]:
    """Make all plots as PNG and SVG, and as SVG for a dark page; returns the content of the files by name."""
    import matplotlib as mpl
    from matplotlib.figure import Figure  # without pyplot: needs no window system

    draws = {"error-against-time": _against_time, "error-against-samples": _samples_of, "error-spectrum": _spectra}
    if not shown.spectra:
        del draws["error-spectrum"]
    files: dict[str, bytes] = {}
    for theme, kinds in ((LIGHT, (".png", ".svg")), (NIGHT, (DARK,))):
        with mpl.rc_context(STYLE | _colours(theme)):
            for name, draw in draws.items():
                figure = Figure(SIZE)
                axes = figure.add_axes((0.15, 0.345, 0.835, 0.61))
                draw(shown, theme, axes)
                axes.legend(loc="upper center", bbox_to_anchor=(0.45, -0.15), ncols=2, frameon=False)  # on no curve
                for kind in kinds:
                    files[name + kind] = _saved(figure, kind[-3:])
    return files


def _saved(figure: Any, kind: str) -> bytes:
    stream = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": None}  # the same plot gives the same bytes
    with without_glyphs():
        figure.savefig(stream, format=kind, dpi=DPI, metadata=metadata, bbox_inches="tight", pad_inches=0.08)
    return stream.getvalue()


def _colours(theme: Theme) -> dict[str, Any]:
    ink = "text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "legend.labelcolor"
    paper = "figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor"
    return dict.fromkeys(ink, theme.ink) | dict.fromkeys(paper, theme.paper)


def _scale(axes: Any, points: Sequence[Point], title: str, x_label: str) -> None:
    scale = "log" if any(point.rmse_srgb for point in points) else "linear"  # log 0 does not exist
    axes.set(xscale="log", yscale=scale, title=title, xlabel=x_label, ylabel="RMSE (sRGB)")
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            _tick(axis)


def _tick(axis: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    steps = (1, 2, 5) if high < 300 * max(low, 1e-300) else (1,)  # labels must not overlap on a projector
    axis.set_major_locator(LogLocator(10, subs=steps))
    axis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _look(configuration: Configuration, theme: Theme) -> dict[str, Any]:
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
    name = "adaptive" if configuration.adaptive else configuration.sampler
    if configuration.renderer != "raytrace":
        name, dashes, marker = configuration.renderer, "-." if configuration.sampler == "independent" else "-", "D"
    return {"color": theme.colours.get(name, theme.other), "linestyle": dashes, "marker": marker}


def _against_time(shown: Plotted, theme: Theme, axes: Any) -> None:
    for configuration, curve in curves_of(shown.points).items():
        x, y, look = [p.seconds for p in curve], [p.rmse_srgb for p in curve], _look(configuration, theme)
        axes.plot(x, y, label=configuration.name, markersize=7, **look)
        ends = [(p.time, p.error) for p in curve]
        axes.hlines(y, [t.low for t, _ in ends], [t.high for t, _ in ends], color=look["color"], linewidth=1.2)
        axes.vlines(x, [e.low for _, e in ends], [e.high for _, e in ends], color=look["color"], linewidth=1.2)
    best = sorted((p.seconds, p.rmse_srgb) for p, kept in zip(shown.points, shown.front, strict=True) if kept)
    if best:
        times, errors = zip(*best, strict=True)
        axes.step(times, errors, where="post", color=theme.ink, linewidth=6, alpha=0.18, label="Pareto front", zorder=0)
        axes.plot(times, errors, "o", markersize=14, markerfacecolor="none", markeredgecolor=theme.ink, alpha=0.6)
    _scale(axes, shown.points, shown.title, "seconds per image")
    _floor_line(axes, shown.points, shown.floor, theme)


def _samples_of(shown: Plotted, theme: Theme, axes: Any) -> None:
    against_samples(shown.points, shown.slopes, shown.floor, shown.title, axes, theme=theme)


def against_samples(
    points: Sequence[Point],
    slopes: Sequence[Slope],
    floor: Floor | None,
    title: str,
    axes: Any,
    *,
    theme: Theme = LIGHT,
) -> None:
    """Plot error against samples on matplotlib axes; the labels have the last local slope that is certain."""
    last = {slope.configuration: slope for slope in slopes if slope.certain}
    for configuration, curve in curves_of(points).items():
        x, y, look = [p.spp for p in curve], [p.rmse_srgb for p in curve], _look(configuration, theme)
        slope = last.get(configuration)
        label = configuration.name + (f": slope {slope.slope:.2f}" if slope else "")
        axes.plot(x, y, label=label, markersize=7, **look)
        ends = [p.error for p in curve]
        axes.vlines(x, [e.low for e in ends], [e.high for e in ends], color=look["color"], linewidth=1.2)
    _scale(axes, points, title, "samples per pixel")
    _floor_line(axes, points, floor, theme)


def _floor_line(axes: Any, points: Sequence[Point], floor: Floor | None, theme: Theme) -> None:
    """Draw the bias of float32 as a line; one that is far below the plot is a line of text."""
    errors = [point.rmse_srgb for point in points if point.rmse_srgb > 0.0]
    if floor is None or not errors or not floor.high > 0.0:
        return
    measured = floor.rmse_srgb > 0.0
    value = floor.rmse_srgb if measured else floor.high
    label = f"float32 floor: {value:.1e}" if measured else f"float32 floor: below {value:.1e}"
    if value * FAR >= min(errors):
        axes.axhspan(floor.rmse_srgb or value / 1.02, floor.high, color=theme.other, alpha=0.25)
        axes.axhline(value, color=theme.other, linestyle=(0, (4, 2, 1, 2)), label=label)
    else:
        axes.text(0.02, 0.02, f"{label} (off the plot)", transform=axes.transAxes, fontsize=12.5, color=theme.ink)


def _spectra(shown: Plotted, theme: Theme, axes: Any) -> None:
    configurations = {point.configuration.name: point.configuration for point in shown.points}
    for spectrum in shown.spectra:
        known = [way for name, way in configurations.items() if spectrum.name.startswith(f"{name}, ")]
        look = _look(known[0], theme) if known else {"color": theme.other}
        axes.plot(spectrum.frequency, spectrum.power, label=spectrum.name, markersize=5, **look)
    axes.axhline(1.0, color=theme.ink, linewidth=1.2, linestyle=":", label="white noise")
    axes.set(title=shown.title, xlabel="frequency, cycles per pixel", ylabel="power, relative to white noise")
    axes.set(xlim=(0, 0.5), ylim=(0, None))


def heat(error: Any) -> Any:
    """Colours (h, w, 3) uint8 of sRGB errors (h, w): black at 1e-4 and below, brightest at 1."""
    from matplotlib import colormaps

    level = (np.log10(np.maximum(error, 1e-4)) + 4) / 4
    return (colormaps["inferno"](level)[..., :3] * 255 + 0.5).astype(np.uint8)
