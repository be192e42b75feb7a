"""``render``: tiles of pixels on several threads, with progress, cancel, a time limit and a wanted error."""

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import raytrace
from raytrace import adaptive, parallel
from raytrace.accel.build import FEW
from raytrace.canvas import Canvas, Sheet
from raytrace.checkpoint import Checkpoint
from raytrace.crew import Crew
from raytrace.jit import on_compile
from raytrace.job import Job, Layout
from raytrace.needs import Picture, compile_ahead
from raytrace.options import deadline_after, error_wanted, layers_of, override, window_of
from raytrace.parts import Part, pieces, rounds
from raytrace.passes.estimate import MODELS, root_mean
from raytrace.picture import Layers, Render, trace_layers
from raytrace.progress import Progress
from raytrace.records import Scene
from raytrace.scene.load import load
from raytrace.scene.plan import Plan, make_plan
from raytrace.stages import is_built, stage_of
from raytrace.wavefront import BATCH, Stage


def render(
    scene: Scene | str | Path | dict[str, Any],
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    precision: str | None = None,
    sampler: str | None = None,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    aov: Sequence[str] = (),
    crop: tuple[int, int, int, int] | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    checkpoint: str | Path | Checkpoint | None = None,
) -> Render:
    """Draw a scene.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    spp, size, seed, precision, sampler : optional
        Samples per pixel; film (width, height) in pixels; 0 .. 2**32 - 1; "auto", "float32" or "float64"; "sobol",
        "stratified" or "independent". Default: what the scene says.
    threads : int, optional
        Default: all cores of the process. The picture has the same bits for any number.
    progress : callable, optional
        Is called with a ``Progress`` now and then.
    aov : sequence of str
        Layers to compute and keep in files; all can be had from ``Render.aov`` later.
    crop : (x, y, width, height), pixels, optional
        Draw only this part of the film; it equals that part of the whole picture.
    time_limit : float, seconds, optional
        Stop after about so long, with fewer samples.
    target_error : float, optional
        Sample where the error is until the estimated RMSE of the picture, in sRGB clipped to 0 .. 1, is at most this:
        0.002 is half a step of 8 bits. No pixel gets more than ``spp`` samples, 4096 where that isn't given.
    checkpoint : str or Path, optional
        File that keeps finished parts while the picture is drawn. If it is there, it is gone on from, and the picture
        has the same bits as if nothing had happened. ``Render.save`` removes it once the whole picture is written.

    Returns
    -------
    Render
        With ``complete`` False after Ctrl-C or the time limit.

    Raises
    ------
    SceneError, FileError
        As ``load`` does; and FileError for a checkpoint of another picture, or one that can't be written.
    OptionError
        An option that can't be met.

    Examples
    --------
    >>> import raytrace as rt
    >>> picture = rt.render("scenes/cornell-box.json", spp=4, size=(32, 32))
    >>> picture.rgb.shape, picture.complete
    ((32, 32, 3), True)
    """
    if not isinstance(scene, Scene):
        scene = load(scene)
    target = error_wanted(target_error)
    most = adaptive.CAP if spp is None and target is not None else spp
    settings = override(scene.settings, most, size, seed, precision, sampler)
    window = window_of(settings.size, crop)
    layers, limit = layers_of(aov), deadline_after(time_limit)
    plan = make_plan(scene)
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    job, layout = Job(scene, settings, window, precision, target), Layout(hasty=limit < np.inf)
    keep = checkpoint if isinstance(checkpoint, Checkpoint | None) else Checkpoint(Path(checkpoint))
    if keep:
        layout = keep.begin(job, layout)
    run = _Run(job, plan, layout, keep, progress or (lambda _: None))
    return run.run(parallel.thread_count(threads), limit, layers)


class _Run:
    """One call of ``render``."""

    def __init__(
        self, job: Job, plan: Plan, layout: Layout, keep: Checkpoint | None, progress: Callable[[Progress], None]
    ) -> None:
        self.job, self.plan, self.layout, self.keep, self.progress = job, plan, layout, keep, progress
        model = MODELS[job.settings.sampler]
        self.canvas = Canvas(job.window, model)
        self.search = None
        if job.target is not None:
            film, at = self.canvas.film, self.canvas.at
            self.search = adaptive.Search(film, at, job.window, model, job.target, job.settings.spp)
        self.samples = np.zeros((job.window.height, job.window.width), np.int32)
        self.layers = Layers(self.samples, self._trace_layers)
        self.began = self._drawing = time.perf_counter()
        self._numbers = itertools.count()  # of parts, in an order that only the job and its layout decide
        self._cancelled = threading.Event()
        self._crew: Crew | None = None

    def run(self, threads: int, time_limit: float, layers: Sequence[str]) -> Render:
        """Draw until done, stopped or out of time."""
        self._deadline = self.began + time_limit
        self.with_layers = bool(set(layers) - {"samples"})
        complete, interrupted = False, False
        with on_compile(self._compile_ahead) as compiled:
            try:
                crew = self._crew = Crew(self._stage(), self.job.scene.camera, self.job.settings)
                crew.load_kernels()
                self._hand_out = partial(self._by_threads, crew, threads)
                self._drawing = time.perf_counter()
                complete = self._draw_all() and (self.search is None or self._refine(self.search))
                for name in layers:
                    self.layers[name]
            except KeyboardInterrupt:
                interrupted = True
            finally:
                if self.keep:
                    self.keep.close(complete)
        return self._picture(complete, interrupted, compiled.seconds)

    def _over(self) -> bool:
        """Whether to stop: after Ctrl-C, an error, or the time limit."""
        return self._cancelled.is_set() or time.perf_counter() > self._deadline

    def _draw_all(self) -> bool:
        """Draw round after round: a pixel's samples are summed in their order, so no tile may be in two at once."""
        spp = self.job.settings.spp if self.search is None else min(adaptive.FIRST, self.job.settings.spp)
        pixels, done = len(self.canvas.film.samples), 0
        drawn = [
            [Part(first, last, piece) for piece in pieces(pixels, max(self.layout.at_least, BATCH // (last - first)))]
            for first, last in rounds(spp, self.layout.hasty)
        ]
        for parts in drawn:
            if not self._draw_parts(parts, done, sum(map(len, drawn))):
                return False
            done += len(parts)
        return int(self.canvas.film.samples.min()) == spp

    def _refine(self, search: adaptive.Search) -> bool:
        """Give more samples to pixels round after round, until the error of the picture meets the target."""
        done = 0
        while parts := search.parts():
            if not self._draw_parts(parts, done, done + len(parts)):
                return False
            done += len(parts)
        return True

    def _draw_parts(self, parts: Sequence[Part], before: int, total: int) -> bool:
        numbered = list(zip(parts, self._numbers, strict=False))  # parts first: they end, and numbers go on
        left = [each for each in numbered if not self._restore(*each)]
        return self._hand_out(left, partial(self._report, before + len(numbered) - len(left), total))

    def _by_threads(
        self, crew: Crew, threads: int, left: Sequence[tuple[Part, int]], report: Callable[[int], None]
    ) -> bool:
        return parallel.run(partial(self._draw, crew), left, threads, self._over, report, self._cancelled.set)

    def _draw(self, crew: Crew, numbered: tuple[Part, int]) -> None:
        """Add samples of some pixels to the film."""
        part, number = numbered
        sheet = self.canvas.lend(part)
        began = time.perf_counter()
        done = crew.draw(sheet, part.first, part.last, self._over)
        if self.keep and done == part.last:
            self.keep.add(number, sheet.sums, time.perf_counter() - began)
        self._take_back(part, sheet, done)

    def _restore(self, part: Part, number: int) -> bool:
        """Put a part on the film as it is in the checkpoint; whether it is there."""
        sums = self.keep.find(number) if self.keep else None
        if sums is None:
            return False
        sheet = self.canvas.lend(part)
        sheet.sums[:] = sums
        self._take_back(part, sheet, part.last)
        return True

    def _take_back(self, part: Part, sheet: Sheet, samples: int) -> None:
        shown = self.canvas.take_back(part, sheet, samples)
        if self.search:
            self.search.show(part.pixels, shown)

    def _report(self, before: int, total: int, done: int) -> None:
        if self.keep:
            self.keep.write_when_due()
        self._say("rendering", before + done, total)

    def _say(self, stage: str, done: int, total: int) -> None:
        rays = self._crew.rays().total() if self._crew else 0
        since = self._drawing if stage == "rendering" else self.began
        self.progress(Progress(stage, done, total, rays, time.perf_counter() - since))

    def _stage(self) -> Stage:
        if not is_built(self.job.scene, self.job.precision):
            self._say("building", 0, 1)
        return stage_of(self.job.scene, self.plan, self.job.precision)

    def _compile_ahead(self) -> None:
        """Have all compiled that this picture needs, for a kernel is missing."""
        self._say("compiling", 0, 1)
        plan, large = self.plan, len(self.job.scene.mesh.faces) > FEW
        features = plan.smooth, plan.refraction, plan.lights > 0, large, self.with_layers, self.search is not None
        picture = Picture(self.job.precision, self.job.settings.sampler, *features)
        compile_ahead([picture], partial(self._say, "compiling"))

    def _picture(self, complete: bool, interrupted: bool, compile_seconds: float) -> Render:
        size, settings = self.samples.shape, self.job.settings
        drawn = self.canvas.develop()
        self.samples[:] = drawn.samples.reshape(size)
        seconds = time.perf_counter() - self.began
        error = root_mean(drawn.error) if self.search is None else self.search.error
        stats = {
            "seconds": seconds,
            "compile_seconds": compile_seconds,
            "seconds_by_pass": dict(self._crew.seconds()) if self._crew else {},
            "rays": dict(self._crew.rays()) if self._crew else {},
            "samples": int(self.samples.sum()),
            "estimated_error": error,
            "estimated_error_linear": root_mean(drawn.variance),
            "target_reached": None if self.job.target is None else bool(error <= self.job.target),
        }
        provenance = {
            "version": raytrace.__version__,
            "scene_sha256": self.job.scene.sha256,
            "size": f"{settings.size[0]}x{settings.size[1]}",
            "spp": settings.spp,
            "max_depth": settings.max_depth,
            "sampler": settings.sampler,
            "seed": settings.seed,
            "precision": self.job.precision,
            "complete": int(complete),
            "seconds": round(seconds, 4),
        }
        rgb, stderr = drawn.rgb.reshape(*size, 3), np.sqrt(drawn.variance).astype(np.float32).reshape(size)
        return Render(rgb, stderr, self.layers, stats, provenance, complete, interrupted, self.keep)

    def _trace_layers(self) -> dict[str, NDArray[Any]]:
        stage = stage_of(self.job.scene, self.plan, self.job.precision)
        return trace_layers(self.job.scene, stage.bvh, self.job.settings.size, self.job.window)
