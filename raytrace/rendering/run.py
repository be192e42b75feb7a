"""One run: renders work items, round after round, until the image is complete, cancelled or out of time."""

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
from raytrace.limits import LIGHT_LAYERS
from raytrace.passes.estimate import MODELS, root_mean
from raytrace.passes.film import MAX_RADIANCE, Frame
from raytrace.rendering import adaptive
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.compiled_scene import compiled_of, is_compiled
from raytrace.rendering.film_tiles import LEAP, FilmTile, FilmTiles, WorkItem, first_round, pieces, rounds
from raytrace.rendering.job import Job, Tiling
from raytrace.rendering.progress import Progress, ProgressListener
from raytrace.rendering.result import Layers, Render, state_of, trace_layers
from raytrace.rendering.threads import RenderThreads
from raytrace.rendering.wavefront import BATCH
from raytrace.scene.content import changes_of
from raytrace.scene.path_plan import needs_paths

if TYPE_CHECKING:
    from raytrace.rendering.cluster import Cluster

EARLY = 64  # work items of rounds with fewer than 1/EARLY of all samples are not kept: rendering them again costs less

Numbered = tuple[WorkItem, int]
RenderItems = Callable[[Sequence[Numbered], Callable[[int], None]], bool]  # items, a report -> whether all are rendered


class Run:
    """One call of ``render``."""

    def __init__(
        self,
        job: Job,
        tiling: Tiling,
        checkpoint: Checkpoint | None,
        cluster: "Cluster | None",
        listener: ProgressListener,
    ) -> None:
        self.job, self.tiling, self.checkpoint, self.listener = job, tiling, checkpoint, listener
        self._cluster = cluster
        self._workers: RenderThreads | Cluster | None = cluster
        model = MODELS["independent" if needs_paths(job.scene, job.settings.integrator) else job.settings.sampler]
        self.film_tiles = FilmTiles(job.window, model, job.light)
        self.sampler = None
        if job.target is not None:
            film, at = self.film_tiles.film, self.film_tiles.at
            self.sampler = adaptive.AdaptiveSampler(film, at, job.window, model, job.target, job.settings.spp)
        self.samples = np.zeros((job.window.height, job.window.width), np.int32)
        self.layers = Layers(self.samples, partial(_trace_layers, job), job.light)
        self.began = self._rendering = time.perf_counter()
        self._numbers = itertools.count()  # of work items, in an order that depends on job and tiling alone
        self._cancelled = threading.Event()

    def run(self, threads: int, time_limit: float, layers: Sequence[str]) -> Render:
        """Render until the image is complete, cancelled or out of time."""
        self._deadline, self._threads = self.began + time_limit, threads
        self.with_layers = bool(set(layers) - {"samples", *LIGHT_LAYERS})
        complete, interrupted = False, False
        with on_compile(self._compile_ahead) as compilation:
            try:
                self._render = self._by_cluster(self._cluster) if self._cluster else self._by_threads(threads)
                self._settle(threads)
                self._rendering = time.perf_counter()
                complete = self._render_all() and (self.sampler is None or self._refine(self.sampler))
                for name in layers:
                    if name not in LIGHT_LAYERS:
                        self.layers[name]
            except KeyboardInterrupt:
                interrupted, whole = True, int(self.film_tiles.film.samples.min()) == self.job.settings.spp
                complete = whole and not layers  # it came too late
            finally:
                self.__dict__.pop("_render", None)  # break the reference cycle that keeps the threads' memory alive
                if self.checkpoint:
                    self.checkpoint.close(complete)
        image = self._image(complete, interrupted, compilation.seconds)
        for name in layers:
            if name in LIGHT_LAYERS:
                image.aov[name]
        self.listener.end(state_of(image))
        return image

    def _settle(self, threads: int) -> None:
        """Decide in how many rounds the film is rendered."""
        if self.tiling.first is None:
            spp, seconds = self.job.first_spp, 0.0
            if self._cluster:
                seconds = self._cluster.expected(len(self.film_tiles.at) * spp)
            elif isinstance(self._workers, RenderThreads):
                seconds = self._workers.expected(self.film_tiles, spp, min(threads, parallel.thread_count(None)))
            self.tiling = self.tiling._replace(first=first_round(spp, seconds), leap=LEAP)
        if self.checkpoint:
            self.checkpoint.settle(self.tiling)
        if self.tiling.first:
            self.film_tiles.keep_rounds()

    def _over(self) -> bool:
        """Whether to stop: after Ctrl-C, an error, or the time limit."""
        return self._cancelled.is_set() or time.perf_counter() > self._deadline

    def _render_all(self) -> bool:
        """Render round after round. A pixel's samples are summed in order, so no tile may be in two items at once."""
        film = self.film_tiles.film
        self.listener.begin(film.samples, self.film_tiles.at, self.job.window)
        at_least, work = self.tiling.at_least, max(self.tiling.work, BATCH)
        items_of_rounds = [
            [WorkItem(first, last, piece) for piece in pieces(len(film.samples), max(at_least, work // (last - first)))]
            for first, last in self._rounds()
        ]
        skipped = self._kept_rounds(items_of_rounds)
        done = sum(map(len, items_of_rounds[:skipped]))
        self._numbers = itertools.count(done)
        for items in items_of_rounds[skipped:]:
            whole = self._render_items(items, done, sum(map(len, items_of_rounds)))
            if not whole or int(film.samples.min()) < items[0].last:  # time was up within the last item
                return False
            done += len(items)
        return True

    def _rounds(self) -> list[tuple[int, int]]:
        """Samples of each round."""
        return rounds(self.job.first_spp, self.tiling.first or 0, self.tiling.leap)

    def _kept_rounds(self, items_of_rounds: list[list[WorkItem]]) -> int:
        """Number of rounds to skip, as the checkpoint has all of the next one, which then starts at sample 0."""
        before = list(itertools.accumulate(map(len, items_of_rounds), initial=0))
        for k in range(len(items_of_rounds) - 1, 0, -1):
            if self.checkpoint and all(self.checkpoint.has(number) for number in range(before[k], before[k + 1])):
                items_of_rounds[k] = [item._replace(first=0) for item in items_of_rounds[k]]
                return k
        return 0

    def _refine(self, sampler: adaptive.AdaptiveSampler) -> bool:
        """Add samples to pixels, round after round, until the estimated error of the image meets the target."""
        done = 0
        at_least = max(self.tiling.at_least, self.tiling.work // self.job.settings.spp)
        while items := sampler.work_items(at_least):
            if not self._render_items(items, done, done + len(items)):
                return False
            done += len(items)
        return True

    def _render_items(self, items: Sequence[WorkItem], before: int, total: int) -> bool:
        numbered = list(zip(items, self._numbers, strict=False))  # items first: the numbers have no end
        left = [each for each in numbered if not self._restore(*each)]
        if isinstance(self._workers, RenderThreads):
            self._workers.rest()
        return self._render(left, partial(self._report, before + len(numbered) - len(left), total))

    def _by_threads(self, threads: int) -> RenderItems:
        job = self.job
        if not is_compiled(job.scene, job.precision):
            self._send("building", 0, 1)
        workers = self._workers = RenderThreads(job.scene, job.plan, job.precision, job.settings, job.light)
        workers.load_kernels()
        draw, stop = partial(self._draw, workers), self._cancelled.set
        return lambda left, report: parallel.run(draw, left, threads, self._over, report, stop)

    def _by_cluster(self, cluster: "Cluster") -> RenderItems:
        return lambda left, report: cluster.draw(left, self.film_tiles.get, self._receive, self._over, report)

    def _draw(self, workers: RenderThreads, numbered: Numbered) -> None:
        """Render a work item in the calling thread."""
        item = numbered[0]
        tile = self.film_tiles.get(item)
        began = time.perf_counter()
        done = workers.draw(tile, item.first, item.last, self._over)
        if done == item.last:
            self._finish(numbered, tile, time.perf_counter() - began)
        else:
            self._merge(item, tile, done)

    def _finish(self, numbered: Numbered, tile: FilmTile, seconds: float) -> None:
        """Merge a finished work item, and keep it in the checkpoint."""
        item, number = numbered
        if self.checkpoint and item.last * EARLY >= self.job.first_spp:
            self.checkpoint.add(number, tile.sums, seconds)
        self._merge(item, tile, item.last)

    def _receive(self, numbered: Numbered, sums: NDArray[np.float64], seconds: float) -> None:
        """Merge a work item that a cluster worker rendered."""
        tile = self.film_tiles.get(numbered[0])
        self.film_tiles.fill(numbered[0], tile, sums)
        self._finish(numbered, tile, seconds)

    def _restore(self, item: WorkItem, number: int) -> bool:
        """Merge a work item from the checkpoint; whether it was there."""
        sums = self.checkpoint.find(number) if self.checkpoint else None
        if sums is None:
            return False
        tile = self.film_tiles.get(item)
        if sums.shape != tile.sums.shape:
            return False
        self.film_tiles.fill(item, tile, sums)
        self._merge(item, tile, item.last)
        return True

    def _merge(self, item: WorkItem, tile: FilmTile, samples: int) -> None:
        shown = self.film_tiles.merge(item, tile, samples)
        self.listener.show(item.pixels, shown)
        if self.sampler:
            self.sampler.show(item.pixels, shown)

    def _report(self, before: int, total: int, done: int) -> None:
        if self.checkpoint:
            self.checkpoint.write_when_due()
        self._send("rendering", before + done, total)

    def _send(self, stage: str, done: int, total: int) -> None:
        """Send a progress update to the listener."""
        rays = self._workers.rays().total() if self._workers else 0
        since = self._rendering if stage == "rendering" else self.began
        self.listener(Progress(stage, done, total, rays, time.perf_counter() - since))

    def _compile_ahead(self) -> None:
        """Compile all kernels that this render needs; called when the first one is missing."""
        if self._cluster:  # its workers need them
            return
        from raytrace.rendering.kernels import compile_ahead, traits_of

        self._send("compiling", 0, 1)
        job, also = self.job, {"layers": self.with_layers, "adaptive": self.sampler is not None}
        traits = traits_of(job.scene, job.plan, job.precision, job.settings, **also, light=job.light)
        compile_ahead([traits], partial(self._send, "compiling"))

    def _developed(self) -> Frame:
        """The image after the last complete round, and everything that adaptive sampling added to it."""
        spp, done = self.job.first_spp, int(self.film_tiles.film.samples.min())
        if done >= spp:
            return self.film_tiles.develop(threads=self._threads)
        complete = [last for _, last in self._rounds() if last <= done]
        return self.film_tiles.develop(max(complete, default=0), self._threads)

    def _image(self, complete: bool, interrupted: bool, compile_seconds: float) -> Render:
        size, settings = self.samples.shape, self.job.settings
        frame = self._developed()
        self.samples[:] = frame.samples.reshape(size)
        if self.job.light:
            self.layers.put_light(frame.light.reshape(*size, len(LIGHT_LAYERS), 3))
        seconds = time.perf_counter() - self.began
        error = self.sampler.error if self.sampler else math.nan  # of the last complete round
        error = root_mean(frame.error) if math.isnan(error) else error
        stats = {
            "seconds": seconds,
            "compile_seconds": compile_seconds,
            "seconds_by_pass": dict(self._workers.seconds()) if self._workers else {},
            "rays": dict(self._workers.rays()) if self._workers else {},
            "samples": int(self.samples.sum()),
            "estimated_error": error,
            "estimated_error_linear": root_mean(frame.variance),
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
            **({"set": "; ".join(changes)} if (changes := changes_of(self.job.scene)) else {}),
            "complete": complete,
            "seconds": round(seconds, 4),
        }
        stderr = np.minimum(np.sqrt(frame.variance), MAX_RADIANCE).astype(np.float32).reshape(size)
        rgb, var, more = frame.rgb.reshape(*size, 3), frame.var.reshape(*size, 3), (complete, interrupted)
        return Render(rgb, stderr, var, self.layers, stats, provenance, *more, self.checkpoint)


def _trace_layers(job: Job, name: str) -> dict[str, NDArray[Any]]:
    bvh = compiled_of(job.scene, job.plan, job.precision).bvh
    return trace_layers(job.scene, bvh, job.settings.size, job.window, name)
