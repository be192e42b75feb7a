"""``render``: tiles of pixels on several threads, with progress, cancel, a time limit and a wanted error."""

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

import raytrace
from raytrace import adaptive, parallel
from raytrace.accel.lanes import BITS
from raytrace.estimate import ORDER, Estimate, Film, displayed, estimate, root_mean
from raytrace.jit import on_compile
from raytrace.options import deadline_after, error_wanted, layers_of, override, window_of
from raytrace.parts import Part, doubled, rounds, tiles
from raytrace.passes.camera import make_view
from raytrace.passes.film import BINS
from raytrace.passes.sampling import make_sampler
from raytrace.picture import Layers, Render, trace_layers
from raytrace.records import Scene, Settings, Window
from raytrace.scene.load import load
from raytrace.scene.plan import Plan, make_plan
from raytrace.wavefront import BATCH, Stage, Wavefront, make_stage

_stages: WeakKeyDictionary[Scene, dict[str, Stage]] = WeakKeyDictionary()  # of scenes drawn before


def set_stage(scene: Scene, stage: Stage) -> None:
    """Draw a scene on this stage from now on, in the stage's precision."""
    _stages.setdefault(scene, {})[stage.bvh.precision] = stage


def stage_of(scene: Scene, plan: Plan, precision: str) -> Stage:
    """The stage that a scene is drawn on, built if it isn't there yet."""
    stages = _stages.setdefault(scene, {})
    if precision not in stages:
        stages[precision] = make_stage(scene, plan, precision)
    return stages[precision]


class Progress(NamedTuple):
    """One message of a running render."""

    stage: str  # "compiling", "building" or "rendering"
    done: int  # finished parts
    total: int  # all parts
    rays: int  # traced so far, of all kinds
    seconds: float  # since the stage began


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

    Returns
    -------
    Render
        With ``complete`` False after Ctrl-C or the time limit.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
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
    job = _Job(scene, settings, window, target, progress or (lambda _: None))
    return job.run(parallel.thread_count(threads), limit, layers)


class _Job:
    """One call of ``render``."""

    def __init__(
        self,
        scene: Scene,
        settings: Settings,
        window: Window,
        target: float | None,
        progress: Callable[[Progress], None],
    ) -> None:
        self.scene, self.settings, self.window, self.target, self.progress = scene, settings, window, target, progress
        self.plan = make_plan(scene)
        self.precision = self.plan.precision.name if settings.precision == "auto" else settings.precision
        self.order = ORDER[settings.sampler]
        pixels = window.width * window.height
        self.film = Film(np.zeros((3 * BINS, pixels)), np.zeros(pixels, np.int32))
        self.layers = Layers(self.film.samples.reshape(window.height, window.width), self._trace_layers)
        self.error: float | None = None  # of the picture, where the target made it known
        self.began = time.perf_counter()
        self._local = threading.local()
        self._cancelled = threading.Event()
        self._wavefronts: list[Wavefront] = []

    def run(self, threads: int, time_limit: float, layers: Sequence[str]) -> Render:
        """Draw until done, stopped or out of time."""
        self._deadline = self.began + time_limit
        complete, interrupted = False, False
        with on_compile(lambda: self._say("compiling", 0, 1)) as compiled:
            try:
                self._prepare()
                self._drawing = time.perf_counter()
                all_drawn = self._draw_all(threads, hasty=time_limit < np.inf)
                complete = all_drawn and (self.target is None or self._refine(threads, self.target))
                for name in layers:
                    self.layers[name]
            except KeyboardInterrupt:
                interrupted = True
        return self._picture(complete, interrupted, compiled.seconds)

    def _over(self) -> bool:
        """Whether to stop: after Ctrl-C, an error, or the time limit."""
        return self._cancelled.is_set() or time.perf_counter() > self._deadline

    def _draw_all(self, threads: int, hasty: bool) -> bool:
        """Draw round after round: a pixel's samples are summed in their order, so no tile may be in two at once."""
        spp = self.settings.spp if self.target is None else min(adaptive.FIRST, self.settings.spp)
        areas, ranges = tiles(self.window), rounds(spp, hasty)
        for number, samples in enumerate(ranges):
            parts = [Part(*samples, pixels) for pixels in areas]
            if not self._draw_parts(parts, threads, number * len(parts), len(ranges) * len(parts)):
                return False
        return int(self.film.samples.min()) == spp

    def _draw_parts(self, parts: Sequence[Part], threads: int, before: int, total: int) -> bool:
        report = partial(self._report, before, total)
        return parallel.run(self._draw, parts, threads, self._over, report, self._cancelled.set)

    def _refine(self, threads: int, target: float) -> bool:
        """Double the samples of pixels round after round, until the error of the picture meets the target."""
        samples, order, cap, done = self.film.samples, np.concatenate(tiles(self.window)), self.settings.spp, 0
        shape = self.window.height, self.window.width
        known = self._estimate()
        shown, scale = displayed(known.rgb), known.shown * float(samples[0]) ** self.order
        while True:
            unseen = adaptive.hidden(shown.reshape(*shape, 3), samples.reshape(shape)).ravel()
            error = scale / samples**self.order + unseen
            self.error = float(np.sqrt(error.mean()))
            chosen = np.zeros(len(samples), np.bool_)
            chosen[adaptive.choose(error, samples, target, cap, self.order)] = True
            pixels = order[chosen[order]]
            parts = list(doubled(pixels, samples[pixels], cap))
            if not parts or not self._draw_parts(parts, threads, done, done + len(parts)):
                return not parts
            done += len(parts)
            known = self._estimate(pixels)
            shown[pixels] = displayed(known.rgb)
            scale[pixels] *= adaptive.MEMORY
            scale[pixels] += (1 - adaptive.MEMORY) * known.shown * samples[pixels] ** self.order

    def _estimate(self, pixels: NDArray[np.int64] | slice = np.s_[:]) -> Estimate:
        """Estimate some pixels, or all."""
        return estimate(Film(self.film.sums[:, pixels], self.film.samples[pixels]), self.order)

    def _report(self, before: int, total: int, done: int) -> None:
        self._say("rendering", before + done, total)

    def _say(self, stage: str, done: int, total: int) -> None:
        rays = sum(wavefront.rays.total() for wavefront in list(self._wavefronts))
        since = self._drawing if stage == "rendering" else self.began
        self.progress(Progress(stage, done, total, rays, time.perf_counter() - since))

    def _prepare(self) -> None:
        if self.precision not in _stages.get(self.scene, {}):
            self._say("building", 0, 1)
        self.stage = stage_of(self.scene, self.plan, self.precision)
        self.view = make_view(self.scene.camera, self.settings.size, np.dtype(self.precision))
        self.sampler = make_sampler(self.settings.sampler, self.settings.seed, self.settings.spp)

    def _draw(self, part: Part) -> None:
        """Add samples of some pixels to the film, a batch after the other."""
        pixels = part.pixels
        spare = -len(pixels) % (BITS // 8 // np.dtype(self.precision).itemsize)
        row, column = np.divmod(np.pad(pixels, (0, spare), "edge"), self.window.width)
        x, y = (column + self.window.x).astype(np.uint32), (row + self.window.y).astype(np.uint32)
        sums = np.pad(self.film.sums[:, pixels], ((0, 0), (0, spare)))
        step = max(1, BATCH // len(x))
        done = part.first
        while done < part.last and not self._over():
            end = min(done + step, part.last)
            self._wavefront((end - done) * len(x)).add_samples(x, y, done, end, sums)
            done = end
        self.film.sums[:, pixels] = sums[:, : len(pixels)]
        self.film.samples[pixels] = done

    def _wavefront(self, n: int) -> Wavefront:
        """Wavefront of the calling thread for batches of n samples."""
        mine = self._local.__dict__.setdefault("wavefronts", {})
        if n not in mine:
            mine[n] = Wavefront(self.stage, self.view, self.sampler, n)
            self._wavefronts.append(mine[n])
        return mine[n]

    def _picture(self, complete: bool, interrupted: bool, compile_seconds: float) -> Render:
        height, width = self.window.height, self.window.width
        known = self._estimate()
        seconds = time.perf_counter() - self.began
        passes: defaultdict[str, float] = defaultdict(float)
        rays: Counter[str] = Counter()
        for wavefront in self._wavefronts:
            rays.update(wavefront.rays)
            for name, spent in wavefront.seconds.items():
                passes[name] += spent
        error = root_mean(known.shown) if self.error is None else self.error
        stats = {
            "seconds": seconds,
            "compile_seconds": compile_seconds,
            "seconds_by_pass": dict(passes),
            "rays": dict(rays),
            "samples": int(self.film.samples.sum()),
            "estimated_error": error,
            "estimated_error_linear": root_mean(known.variance),
            "target_reached": None if self.target is None else bool(error <= self.target),
        }
        provenance = {
            "version": raytrace.__version__,
            "scene_sha256": self.scene.sha256,
            "size": f"{self.settings.size[0]}x{self.settings.size[1]}",
            "spp": self.settings.spp,
            "max_depth": self.settings.max_depth,
            "sampler": self.settings.sampler,
            "seed": self.settings.seed,
            "precision": self.precision,
            "complete": int(complete),
            "seconds": round(seconds, 4),
        }
        rgb = known.rgb.astype(np.float32).reshape(height, width, 3)
        stderr = np.sqrt(known.variance).astype(np.float32).reshape(height, width)
        return Render(rgb, stderr, self.layers, stats, provenance, complete, interrupted)

    def _trace_layers(self) -> dict[str, NDArray[Any]]:
        self._prepare()
        return trace_layers(self.scene, self.stage.bvh, self.settings.size, self.window)
