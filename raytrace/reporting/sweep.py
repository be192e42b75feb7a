"""``report``: measure speed against error on one scene, analyse it, and write the results."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import raytrace
from raytrace.errors import OptionError, printable
from raytrace.image.files import srgb8
from raytrace.output_folder import check_folder, write
from raytrace.parallel import thread_count
from raytrace.records import Scene
from raytrace.rendering.progress import Progress
from raytrace.rendering.rendering import override
from raytrace.reporting.advice import recommendations
from raytrace.reporting.analysis import Order, orders_of, pareto
from raytrace.reporting.configurations import configurations_of
from raytrace.reporting.equal_cost import Costs, costs_of
from raytrace.reporting.measure import Sweep
from raytrace.reporting.measurements import EqualTime, First, Measured, Point, Shown
from raytrace.reporting.page import report_page
from raytrace.reporting.peers import make_configured, peers_of
from raytrace.reporting.plots import DARK, Plotted, check_matplotlib, make_plots
from raytrace.reporting.precision_floor import Floor
from raytrace.reporting.reference import Reference, make_reference, read_reference
from raytrace.reporting.report_json import as_json
from raytrace.reporting.slopes import Slope, slopes_of
from raytrace.reporting.spectrum import Spectrum
from raytrace.reporting.sweep_table import text
from raytrace.scene.load import load
from raytrace.scene.sources import Source

MACHINE = "system", "numpy", "numba", "llvmlite", "cores", "processor", "lanes"  # facts that affect the speed
PARTS = 1000  # steps of the reported progress
FOR_REFERENCE = 0.6  # share of the budget for rendering a reference


@dataclass(frozen=True, eq=False)
class Report:
    """Results of a report; ``print`` it.

    Attributes
    ----------
    points : tuple of Point
        The measurements: one configuration at one number of samples each.
    front : tuple of bool
        Whether each point is on the Pareto front of time and error.
    slopes : tuple of Slope
        Local slopes of log error against log samples, with confidence intervals.
    costs : Costs
        Time to reach an error, and error at equal time, of each configuration.
    floor : Floor or None
        The bias of float32; None: not measured.
    spectra : tuple of Spectrum
        Spectra of error images, of each sampler.
    equal_time : EqualTime or None
        Images of each sampler after the same time.
    orders : tuple of Order
        One fitted order for each configuration. It hides that curves bend: prefer the slopes.
    firsts : tuple of First
        The first image of each configuration, including compilation.
    advice : tuple of str
        Recommendations, computed from the measurements.
    left_out : tuple of (str, str)
        What was not measured, and why.
    files : tuple of Path
        The files written; the page is the last.
    interrupted : bool
        True after Ctrl-C: the report has what was measured until then.
    """

    version: str
    about_scene: Mapping[str, Any]
    machine: Mapping[str, Any]
    about_reference: Mapping[str, Any]
    budget: float
    seconds: float
    points: tuple[Point, ...]
    front: tuple[bool, ...]
    orders: tuple[Order, ...]
    firsts: tuple[First, ...]
    gaps: Mapping[int, float]
    shown: tuple[Shown, ...]
    advice: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...]
    files: tuple[Path, ...]
    interrupted: bool
    slopes: tuple[Slope, ...] = ()
    costs: Costs | None = None
    floor: Floor | None = None
    spectra: tuple[Spectrum, ...] = ()
    equal_time: EqualTime | None = None

    @property
    def reference_text(self) -> str:
        """A sentence on the reference: its origin, samples and error."""
        about = self.about_reference
        origin = {"drawn": "rendered", "cache": "from the cache"}.get(about["origin"], about["origin"])
        if about["error"] is None:
            return f"The reference is {origin}; its error is unknown."
        return (
            f"The reference ({origin}) has {about['spp']:,} samples per pixel in float64. Its RMSE (sRGB), "
            f"estimated from the difference of its halves, is {about['error']:.1e}: "
            f"{about['ahead'] or math.inf:.3g} times smaller than that of the most accurate point."
        )

    def __str__(self) -> str:
        return text(self)

    def __repr__(self) -> str:
        return f"<Report on {self.about_scene['name']}: {len(self.points)} points, {self.files[-1]}>"


def report(
    scene: Scene | Source,
    folder: str | Path,
    *,
    reference: str | Path | None = None,
    budget: float = 60.0,
    size: tuple[int, int] | None = None,
    peers: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Report:
    """Measure speed against error: samplers, precisions, triangle tests and trees, from 1 to 256 samples per pixel.

    Parameters
    ----------
    scene : Scene, str, Path, dict or mesh
        A loaded scene, or what ``load`` accepts.
    folder : str or Path
        Created if missing; ``report.json``, ``report.html`` and the plots are written there.
    reference : path, optional
        A reference image. Default: one is rendered in float64 and cached.
    budget : float, seconds
        Time for the reference and the measurements, without compilation. What does not fit is not measured, and the
        report lists it.
    size : (width, height), pixels, optional
        Image size; default: the scene's.
    peers : bool
        Also measure Mitsuba 3 (on as many threads) and ``raytrace.textbook`` (on one). One that is not installed, or
        cannot express the scene, is listed as not measured.
    progress : callable, optional
        Called with a ``Progress`` from time to time.

    Returns
    -------
    Report

    Raises
    ------
    SceneError, FileError
        As for ``load``; or the reference can't be read, or the folder can't be written to.
    OptionError
        An option is invalid.
    RaytraceError
        matplotlib or scikit-image isn't installed.
    KeyboardInterrupt
        Ctrl-C before anything was measured. Later, the report is written with what was measured.

    Examples
    --------
    >>> import raytrace as rt
    >>> print(rt.report("scenes/cornell-box.json", "out"))  # doctest: +SKIP
    """
    check_matplotlib()
    if not isinstance(scene, Scene):
        scene = load(scene)
    if not budget > 0:
        raise OptionError(f"budget: expected seconds, more than 0, got {budget!r}")
    size = override(scene.settings, None, size, None, None, None).size
    folder = Path(folder)
    check_folder(folder)
    progress_adapter = _ProgressAdapter(progress or (lambda _: None))
    if reference is None:
        truth = make_reference(scene, size, FOR_REFERENCE * budget, progress_adapter.reference)
    else:
        truth = read_reference(Path(reference), size)
    progress_adapter.begin_sweep()
    seconds = budget - (truth.seconds if truth.origin == "drawn" else 0.0)
    others, missing = peers_of(scene) if peers else ([], ())
    seconds = max(seconds, (1 - FOR_REFERENCE) * budget)
    sweep = Sweep(scene, size, truth, seconds, progress_adapter.sweep, make_configured)
    found = sweep.run([*configurations_of(scene), *others])
    found = found._replace(left_out=(*found.left_out, *missing))
    if not found.points:
        if found.interrupted:
            raise KeyboardInterrupt
        raise OptionError(
            f"budget: {budget:g} s are not enough for a single point; use a larger budget or a smaller size"
        )
    return written(scene, size, truth, found, folder, (budget, progress_adapter.seconds))


class _ProgressAdapter:
    """Combine the progress of reference and sweep."""

    def __init__(self, listener: Callable[[Progress], None]) -> None:
        self.listener, self.began, self.rays, self.start = listener, time.perf_counter(), 0, 0.0

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.began

    def reference(self, share: float, event: Progress) -> None:
        """Report progress of the reference."""
        self.rays = max(self.rays, event.rays)
        self.start = max(self.start, FOR_REFERENCE * min(share, 1.0))
        self._report(self.start, self.rays, "compiling" if event.stage == "compiling" else "rendering")

    def begin_sweep(self) -> None:
        """Start the sweep, after the reference."""
        self.reference_rays = self.rays

    def sweep(self, share: float, rays: int) -> None:
        """Report progress of the sweep."""
        self._report(self.start + (1 - self.start) * share, self.reference_rays + rays, "rendering")

    def _report(self, share: float, rays: int, stage: str) -> None:
        self.listener(Progress(stage, int(PARTS * share), PARTS, rays, self.seconds))


def written(
    scene: Scene, size: tuple[int, int], truth: Reference, found: Measured, folder: Path, seconds: tuple[float, float]
) -> Report:
    """Analyse the measurements and write all files."""
    orders, front, slopes = orders_of(found.points), pareto(found.points), slopes_of(found.points)
    about = _about(scene, size)
    shown = Plotted(found.points, front, slopes, found.floor, found.spectra, str(about["name"]))
    plots = make_plots(shown)
    plot_files = {name: data for name, data in plots.items() if not name.endswith(DARK)}
    names = (*plot_files, "report.json", "report.html")
    finished = Report(
        version=raytrace.__version__,
        about_scene=about,
        machine=_machine(),
        about_reference=_about_reference(truth, found.points),
        budget=seconds[0],
        seconds=seconds[1],
        points=found.points,
        front=tuple(front),
        orders=tuple(orders),
        firsts=found.firsts,
        gaps=found.gaps,
        shown=(Shown("reference", srgb8(truth.rgb), None), *found.shown),
        advice=tuple(recommendations(found.points, found.floor)),
        left_out=found.left_out,
        files=tuple(folder / name for name in names),
        interrupted=found.interrupted,
        slopes=tuple(slopes),
        costs=costs_of(found.points),
        floor=found.floor,
        spectra=found.spectra,
        equal_time=found.equal_time,
    )
    content = json.dumps(as_json(finished), indent=1, allow_nan=False) + "\n"
    files = plot_files | {"report.json": content.encode(), "report.html": report_page(finished, plots).encode()}
    write(folder, files)
    return finished


def _about(scene: Scene, size: tuple[int, int]) -> dict[str, Any]:
    return {
        "name": printable(scene.source.stem) if scene.source else "scene",
        "about": printable(scene.about),
        "sha256": scene.sha256,
        "size": list(size),
        "triangles": len(scene.mesh.faces),
        "seed": scene.settings.seed,
    }


def _about_reference(truth: Reference, points: Sequence[Point]) -> dict[str, Any]:
    known = truth.error == truth.error
    return {
        "origin": truth.origin,
        "spp": truth.spp,
        "precision": "float64" if known else None,
        "error": truth.error if known else None,
        "ahead": min(point.rmse_srgb for point in points) / truth.error if known and truth.error else None,
        "seconds": truth.seconds,
    }


def _machine() -> dict[str, Any]:
    from raytrace.doctor import findings

    facts = dict(findings())
    return {name: facts[name] for name in MACHINE} | {"threads": thread_count(None)}
