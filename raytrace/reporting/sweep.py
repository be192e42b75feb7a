"""``report``: speed against error of one scene, measured, weighed up and written down."""

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
from raytrace.reporting.advice import advice
from raytrace.reporting.analysis import Order, orders_of, pareto
from raytrace.reporting.configurations import ways_of
from raytrace.reporting.measure import First, Measured, Point, Shown, Sweep
from raytrace.reporting.page import page
from raytrace.reporting.plots import check_matplotlib, plots
from raytrace.reporting.reference import Reference, make_reference, read_reference
from raytrace.reporting.sweep_table import as_json, text
from raytrace.scene.load import load

MACHINE = "system", "numpy", "numba", "llvmlite", "cores", "processor", "lanes"  # facts that speed depends on
PARTS = 1000  # of the progress that is told
FOR_REFERENCE = 0.6  # share of the budget that drawing a reference may take


@dataclass(frozen=True, eq=False)
class Report:
    """What a report found; ``print`` it.

    Attributes
    ----------
    points : tuple of Point
        What was measured, a way of drawing at a number of samples each.
    front : tuple of bool
        Whether each of them lies on the Pareto front of time and error.
    orders : tuple of Order
        Order of convergence of each way, with its confidence interval.
    firsts : tuple of First
        The first picture in each way, compilation included.
    advice : tuple of str
        Sentences computed from all this.
    left_out : tuple of (str, str)
        What was not measured, and why.
    files : tuple of Path
        What was written; the page comes last.
    interrupted : bool
        True after Ctrl-C: what was measured until then is there.
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

    @property
    def reference_text(self) -> str:
        """Where the truth came from, in a sentence."""
        about = self.about_reference
        if about["error"] is None:
            return f"The reference is {about['origin']}; its own error isn't known."
        return (
            f"The reference ({about['origin']}) has {about['spp']:,} samples per pixel in float64, and an RMSE of "
            f"{about['error']:.1e} on a screen by the difference of its halves, {about['ahead'] or math.inf:.3g} times "
            "less than that of the most accurate point."
        )

    def __str__(self) -> str:
        return text(self)

    def __repr__(self) -> str:
        return f"<Report on {self.about_scene['name']}: {len(self.points)} points, {self.files[-1]}>"


def report(
    scene: Scene | str | Path | dict[str, Any],
    folder: str | Path,
    *,
    reference: str | Path | None = None,
    budget: float = 60.0,
    size: tuple[int, int] | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Report:
    """Measure speed against error: samplers, precisions, triangle tests and trees, from 1 to 256 samples per pixel.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    folder : str or Path
        Is made where it is missing; ``report.json``, ``report.html`` and the plots are written there.
    reference : path, optional
        A picture to judge by. Default: one is drawn in float64, and kept in the cache folder.
    budget : float, seconds
        To draw the reference and to measure in, compilation apart. What doesn't fit is left out, and named.
    size : (width, height), pixels, optional
        Default: what the scene says.
    progress : callable, optional
        Is called with a ``Progress`` now and then.

    Returns
    -------
    Report

    Raises
    ------
    SceneError, FileError
        As ``load`` does; a reference that can't be read, or a folder that can't be written to.
    OptionError
        An option that can't be met.
    RaytraceError
        matplotlib or scikit-image isn't installed.
    KeyboardInterrupt
        Ctrl-C before anything was measured; later, what there is is written.

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
    teller = _Teller(progress or (lambda _: None))
    if reference is None:
        truth = make_reference(scene, size, FOR_REFERENCE * budget, teller.reference)
    else:
        truth = read_reference(Path(reference), size)
    teller.begin_sweep()
    seconds = budget - (truth.seconds if truth.origin == "drawn" else 0.0)
    found = Sweep(scene, size, truth, max(seconds, (1 - FOR_REFERENCE) * budget), teller.sweep).run(ways_of(scene))
    if not found.points:
        if found.interrupted:
            raise KeyboardInterrupt
        raise OptionError(f"budget: {budget:g} s are too few for a single point; give more, or make the size smaller")
    return written(scene, size, truth, found, folder, (budget, teller.seconds))


class _Teller:
    """Turns what the parts tell into one progress."""

    def __init__(self, told: Callable[[Progress], None]) -> None:
        self.told, self.began, self.rays, self.start = told, time.perf_counter(), 0, 0.0

    @property
    def seconds(self) -> float:
        """Since the beginning."""
        return time.perf_counter() - self.began

    def reference(self, share: float, event: Progress) -> None:
        """Take in the progress of the reference."""
        self.rays = max(self.rays, event.rays)
        self.start = max(self.start, FOR_REFERENCE * min(share, 1.0))
        self._tell(self.start, self.rays, "compiling" if event.stage == "compiling" else "rendering")

    def begin_sweep(self) -> None:
        """Note where the reference ended."""
        self.reference_rays = self.rays

    def sweep(self, share: float, rays: int) -> None:
        """Take in the progress of the sweep."""
        self._tell(self.start + (1 - self.start) * share, self.reference_rays + rays, "rendering")

    def _tell(self, share: float, rays: int, stage: str) -> None:
        self.told(Progress(stage, int(PARTS * share), PARTS, rays, self.seconds))


def written(
    scene: Scene, size: tuple[int, int], truth: Reference, found: Measured, folder: Path, seconds: tuple[float, float]
) -> Report:
    """Weigh up what was found, and write it down."""
    orders, front = orders_of(found.points), pareto(found.points)
    about = _about(scene, size)
    pictures = plots(found.points, front, orders, str(about["name"]))
    names = (*pictures, "report.json", "report.html")
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
        advice=tuple(advice(found.points, orders, found.gaps)),
        left_out=found.left_out,
        files=tuple(folder / name for name in names),
        interrupted=found.interrupted,
    )
    content = json.dumps(as_json(finished), indent=1, allow_nan=False) + "\n"
    files = pictures | {"report.json": content.encode(), "report.html": page(finished, pictures).encode()}
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
