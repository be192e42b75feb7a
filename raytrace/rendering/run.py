"""One run: parts of a picture, round after round, until all are drawn; or until a cancel, or the time limit."""

import itertools
import math
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import raytrace
from raytrace import parallel
from raytrace.jit import on_compile
from raytrace.passes.estimate import MODELS, root_mean
from raytrace.passes.film import MOST, Frame
from raytrace.records import Scene, Window
from raytrace.rendering import adaptive
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.compiled_scenes import compiled_of, is_built, plan_of
from raytrace.rendering.film_tiles import FilmTile, FilmTiles
from raytrace.rendering.job import Job, Tiling
from raytrace.rendering.kernels import compile_ahead, picture_of
from raytrace.rendering.pace import LEAP, expected, first_pass
from raytrace.rendering.progress import Progress, ProgressListener
from raytrace.rendering.result import Layers, Render, state_of, trace_layers
from raytrace.rendering.threads import RenderThreads
from raytrace.rendering.wavefront import BATCH
from raytrace.rendering.work_items import WorkItem, pieces, rounds

if TYPE_CHECKING:
    from raytrace.rendering.cluster import Cluster

EARLY = 64  # parts of passes with fewer samples than this part of all are not kept: drawing them again costs less

HandOut = Callable[[Sequence[tuple[WorkItem, int]], Callable[[int], None]], bool]  # parts, a report -> whether all are


class Run:
    """One call of ``render``."""

    def __init__(
        self,
        job: Job,
        layout: Tiling,
        keep: Checkpoint | None,
        cluster: "Cluster | None",
        watcher: ProgressListener,
    ) -> None:
        self.job, self.plan, self.layout, self.keep, self.watcher = job, plan_of(job.scene), layout, keep, watcher
        self._cluster = cluster
        self._drawers: RenderThreads | Cluster | None = cluster
        model = MODELS["independent" if job.paths else job.settings.sampler]
        self.canvas = FilmTiles(job.window, model)
        self.search = None
        if job.target is not None:
            film, at = self.canvas.film, self.canvas.at
            self.search = adaptive.AdaptiveSampler(film, at, job.window, model, job.target, job.settings.spp)
        self.samples = np.zeros((job.window.height, job.window.width), np.int32)
        trace = partial(_trace_layers, job.scene, job.precision, job.settings.size, job.window)
        self.layers = Layers(self.samples, trace)
        self.began = self._drawing = time.perf_counter()
        self._numbers = itertools.count()  # of parts, in an order that only the job and its layout decide
        self._cancelled = threading.Event()

    def run(self, threads: int, time_limit: float, layers: Sequence[str]) -> Render:
        """Draw until done, stopped or out of time."""
        self._deadline = self.began + time_limit
        self.with_layers = bool(set(layers) - {"samples"})
        complete, interrupted = False, False
        with on_compile(self._compile_ahead) as compiled:
            try:
                self._hand_out = self._by_cluster(self._cluster) if self._cluster else self._by_threads(threads)
                self._settle(threads)
                self._drawing = time.perf_counter()
                complete = self._draw_all() and (self.search is None or self._refine(self.search))
                for name in layers:
                    self.layers[name]
            except KeyboardInterrupt:
                interrupted, whole = True, int(self.canvas.film.samples.min()) == self.job.settings.spp
                complete = whole and not layers  # it came too late
            finally:
                self.__dict__.pop("_hand_out", None)  # it knows this run: a circle would keep the threads' memory
                if self.keep:
                    self.keep.close(complete)
        picture = self._picture(complete, interrupted, compiled.seconds)
        self.watcher.end(state_of(picture))
        return picture

    def _settle(self, threads: int) -> None:
        """Decide in how many passes the film is drawn."""
        if self.layout.first is None:
            spp, seconds = self.job.first_spp, 0.0
            if self._cluster:
                seconds = self._cluster.expected(len(self.canvas.at) * spp)
            elif isinstance(self._drawers, RenderThreads):
                seconds = expected(self._drawers, self.canvas, spp, min(threads, parallel.thread_count(None)))
            self.layout = self.layout._replace(first=first_pass(spp, seconds), leap=LEAP)
        if self.keep:
            self.keep.settle(self.layout)
        if self.layout.first:
            self.canvas.keep_passes()

    def _over(self) -> bool:
        """Whether to stop: after Ctrl-C, an error, or the time limit."""
        return self._cancelled.is_set() or time.perf_counter() > self._deadline

    def _draw_all(self) -> bool:
        """Draw round after round: a pixel's samples are summed in their order, so no tile may be in two at once."""
        pixels, done = len(self.canvas.film.samples), 0
        self.watcher.begin(self.canvas.film.samples, self.canvas.at, self.job.window)
        at_least, work = self.layout.at_least, max(self.layout.work, BATCH)
        drawn = [
            [WorkItem(first, last, piece) for piece in pieces(pixels, max(at_least, work // (last - first)))]
            for first, last in self._passes()
        ]
        skipped = self._kept_passes(drawn)
        for parts in drawn[:skipped]:
            done += len(parts)
        self._numbers = itertools.count(done)
        for parts in drawn[skipped:]:
            whole = self._draw_parts(parts, done, sum(map(len, drawn)))
            if not whole or int(self.canvas.film.samples.min()) < parts[0].last:  # time was up within the last part
                return False
            done += len(parts)
        return True

    def _passes(self) -> list[tuple[int, int]]:
        """Samples of each pass over the whole film."""
        return rounds(self.job.first_spp, self.layout.first or 0, self.layout.leap)

    def _kept_passes(self, drawn: list[list[WorkItem]]) -> int:
        """How many passes need not be drawn, nor read, for all of the next is in the checkpoint; that begins at 0."""
        before = list(itertools.accumulate(map(len, drawn), initial=0))
        for k in range(len(drawn) - 1, 0, -1):
            if self.keep and all(self.keep.has(number) for number in range(before[k], before[k + 1])):
                drawn[k] = [part._replace(first=0) for part in drawn[k]]
                return k
        return 0

    def _refine(self, search: adaptive.AdaptiveSampler) -> bool:
        """Give more samples to pixels round after round, until the error of the picture meets the target."""
        done = 0
        at_least = max(self.layout.at_least, self.layout.work // self.job.settings.spp)
        while parts := search.parts(at_least):
            if not self._draw_parts(parts, done, done + len(parts)):
                return False
            done += len(parts)
        return True

    def _draw_parts(self, parts: Sequence[WorkItem], before: int, total: int) -> bool:
        numbered = list(zip(parts, self._numbers, strict=False))  # parts first: they end, and numbers go on
        left = [each for each in numbered if not self._restore(*each)]
        if isinstance(self._drawers, RenderThreads):
            self._drawers.rest()
        return self._hand_out(left, partial(self._report, before + len(numbered) - len(left), total))

    def _by_threads(self, threads: int) -> HandOut:
        job = self.job
        if not is_built(job.scene, job.precision):
            self._say("building", 0, 1)
        crew = self._drawers = RenderThreads(job.scene, self.plan, job.precision, job.settings)
        crew.load_kernels()
        draw, stop = partial(self._draw, crew), self._cancelled.set
        return lambda left, report: parallel.run(draw, left, threads, self._over, report, stop)

    def _by_cluster(self, cluster: "Cluster") -> HandOut:
        return lambda left, report: cluster.draw(left, self.canvas.lend, self._receive, self._over, report)

    def _draw(self, crew: RenderThreads, numbered: tuple[WorkItem, int]) -> None:
        """Add samples of some pixels to the film."""
        part = numbered[0]
        sheet = self.canvas.lend(part)
        began = time.perf_counter()
        done = crew.draw(sheet, part.first, part.last, self._over)
        if done == part.last:
            self._take(numbered, sheet, time.perf_counter() - began)
        else:
            self._take_back(part, sheet, done)

    def _take(self, numbered: tuple[WorkItem, int], sheet: FilmTile, seconds: float) -> None:
        """Take in a part that is drawn."""
        part, number = numbered
        if self.keep and part.last * EARLY >= self.job.first_spp:
            self.keep.add(number, sheet.sums, seconds)
        self._take_back(part, sheet, part.last)

    def _receive(self, numbered: tuple[WorkItem, int], sums: NDArray[np.float64], seconds: float) -> None:
        """Take in a part that was drawn elsewhere."""
        sheet = self.canvas.lend(numbered[0])
        self.canvas.fill(numbered[0], sheet, sums)
        self._take(numbered, sheet, seconds)

    def _restore(self, part: WorkItem, number: int) -> bool:
        """Put a part on the film as it is in the checkpoint; whether it is there."""
        sums = self.keep.find(number) if self.keep else None
        if sums is None:
            return False
        sheet = self.canvas.lend(part)
        if sums.shape != sheet.sums.shape:
            return False
        self.canvas.fill(part, sheet, sums)
        self._take_back(part, sheet, part.last)
        return True

    def _take_back(self, part: WorkItem, sheet: FilmTile, samples: int) -> None:
        shown = self.canvas.take_back(part, sheet, samples)
        self.watcher.show(part.pixels, shown)
        if self.search:
            self.search.show(part.pixels, shown)

    def _report(self, before: int, total: int, done: int) -> None:
        if self.keep:
            self.keep.write_when_due()
        self._say("rendering", before + done, total)

    def _say(self, stage: str, done: int, total: int) -> None:
        rays = self._drawers.rays().total() if self._drawers else 0
        since = self._drawing if stage == "rendering" else self.began
        self.watcher(Progress(stage, done, total, rays, time.perf_counter() - since))

    def _compile_ahead(self) -> None:
        """Have all compiled that this picture needs, for a kernel is missing."""
        if self._cluster:  # its workers need them
            return
        self._say("compiling", 0, 1)
        job, wants = self.job, {"layers": self.with_layers, "aimed": self.search is not None}
        picture = picture_of(job.scene, self.plan, job.precision, job.settings, **wants)
        compile_ahead([picture], partial(self._say, "compiling"))

    def _developed(self) -> Frame:
        """The picture after the last pass over the whole film that is complete, and all that a search added to it."""
        spp, done = self.job.first_spp, int(self.canvas.film.samples.min())
        if done >= spp:
            return self.canvas.develop()
        passes = [last for _, last in self._passes() if last <= done]
        return self.canvas.develop(max(passes, default=0))

    def _picture(self, complete: bool, interrupted: bool, compile_seconds: float) -> Render:
        size, settings = self.samples.shape, self.job.settings
        drawn = self._developed()
        self.samples[:] = drawn.samples.reshape(size)
        seconds = time.perf_counter() - self.began
        error = self.search.error if self.search else math.nan  # of the last round that is complete
        error = root_mean(drawn.error) if math.isnan(error) else error
        stats = {
            "seconds": seconds,
            "compile_seconds": compile_seconds,
            "seconds_by_pass": dict(self._drawers.seconds()) if self._drawers else {},
            "rays": dict(self._drawers.rays()) if self._drawers else {},
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
            "samples": int(self.samples.min()),
            **({} if settings.integrator == "direct" else {"integrator": settings.integrator}),
            "complete": complete,
            "seconds": round(seconds, 4),
        }
        rgb, stderr = drawn.rgb.reshape(*size, 3), np.minimum(np.sqrt(drawn.variance), MOST).astype(np.float32)
        return Render(rgb, stderr.reshape(size), self.layers, stats, provenance, complete, interrupted, self.keep)


def _trace_layers(scene: Scene, precision: str, size: tuple[int, int], window: Window) -> dict[str, NDArray[Any]]:
    return trace_layers(scene, compiled_of(scene, plan_of(scene), precision).bvh, size, window)
