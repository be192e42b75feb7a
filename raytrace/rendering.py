"""``render``: tiles of pixels on several threads, with progress, cancel, a time limit and a wanted error."""

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import raytrace
from raytrace import adaptive, parallel
from raytrace.accel.build import FEW
from raytrace.accel.lanes import PACKET
from raytrace.jit import load_all, on_compile
from raytrace.memory import Drawing, check_drawing
from raytrace.needs import Picture, compile_ahead, tracing
from raytrace.options import deadline_after, error_wanted, layers_of, override, window_of
from raytrace.parts import Part, curve, pieces, rounds
from raytrace.passes.camera import make_view
from raytrace.passes.estimate import MODELS, estimate, root_mean
from raytrace.passes.film import BINS, MOST, Film, develop, make_film, make_frame, put, taken
from raytrace.passes.sampling import make_sampler
from raytrace.picture import Layers, Render, trace_layers
from raytrace.preview import watcher_of
from raytrace.progress import Progress, Watcher
from raytrace.records import Scene, Settings, Window
from raytrace.scene.load import load
from raytrace.stages import is_built, plan_of, stage_of, trees_of
from raytrace.wavefront import BATCH, Wavefront


def render(
    scene: Scene | str | Path | dict[str, Any],
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    precision: str | None = None,
    sampler: str | None = None,
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | Literal[False] | None = None,
    aov: Sequence[str] = (),
    crop: tuple[int, int, int, int] | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    max_memory: int | None = None,
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
    progress : callable or False, optional
        Is called with a ``Progress`` now and then. Default: in a notebook, the picture is shown as it gets better;
        elsewhere, and where this is False, nothing is.
    aov : sequence of str
        Layers to compute and keep in files; all can be had from ``Render.aov`` later.
    crop : (x, y, width, height), pixels, optional
        Draw only this part of the film; it equals that part of the whole picture.
    time_limit : float, seconds, optional
        Stop after about so long, with fewer samples.
    target_error : float, optional
        Sample where the error is until the estimated RMSE of the picture, in sRGB clipped to 0 .. 1, is at most this:
        0.002 is half a step of 8 bits. No pixel gets more than ``spp`` samples, 4096 where that isn't given.
    max_memory : int, bytes, optional
        What the process may take in all; a picture that takes more is refused. Default: what is free.

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
        scene = load(scene, max_memory=max_memory)
    target = error_wanted(target_error)
    most = adaptive.CAP if spp is None and target is not None else spp
    settings = override(scene.settings, most, size, seed, precision, sampler)
    window = window_of(settings.size, crop)
    layers, limit, count = layers_of(aov), deadline_after(time_limit), parallel.thread_count(threads)
    plan = plan_of(scene)
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    check_drawing(_drawing(settings, window, target, layers, count), trees_of(scene, plan, precision), max_memory)
    job = _Job(scene, settings, window, target, watcher_of(progress))
    return job.run(count, limit, layers)


def _drawing(settings: Settings, window: Window, target: float | None, layers: Sequence[str], threads: int) -> Drawing:
    """What the memory of a picture depends on."""
    pixels = window.width * window.height
    batch = min(threads, -(-pixels * settings.spp // BATCH)) * BATCH
    return Drawing(pixels, bool(set(layers) - {"samples"}), target is not None, min(settings.spp, BINS), batch)


class _Job:
    """One call of ``render``."""

    def __init__(
        self, scene: Scene, settings: Settings, window: Window, target: float | None, watcher: Watcher
    ) -> None:
        self.scene, self.settings, self.window, self.target, self.watcher = scene, settings, window, target, watcher
        self.plan = plan_of(scene)
        self.precision = self.plan.precision.name if settings.precision == "auto" else settings.precision
        self.model = MODELS[settings.sampler]
        self.at = curve(window)
        self.film = make_film(len(self.at))
        y, x = np.divmod(np.pad(self.at, (0, len(self.film.samples) - len(self.at)), "edge"), window.width)
        self.x, self.y = (x + window.x).astype(np.uint32), (y + window.y).astype(np.uint32)
        self.search = None
        if target is not None:
            self.search = adaptive.Search(self.film, self.at, window, self.model, target, settings.spp)
        self.samples = np.zeros((window.height, window.width), np.int32)
        self.layers = Layers(self.samples, partial(_trace_layers, scene, self.precision, settings.size, window))
        self.began = time.perf_counter()
        self._local = threading.local()
        self._cancelled = threading.Event()
        self._wavefronts: list[Wavefront] = []

    def run(self, threads: int, time_limit: float, layers: Sequence[str]) -> Render:
        """Draw until done, stopped or out of time."""
        self._deadline = self.began + time_limit
        self.with_layers = bool(set(layers) - {"samples"})
        complete, interrupted = False, False
        with on_compile(self._compile_ahead) as compiled:
            try:
                self._prepare()
                self._load_kernels()
                self._drawing = time.perf_counter()
                all_drawn = self._draw_all(threads, hasty=time_limit < np.inf)
                complete = all_drawn and (self.search is None or self._refine(threads, self.search))
                for name in layers:
                    self.layers[name]
            except KeyboardInterrupt:
                interrupted = True
        self.watcher.end(interrupted)
        return self._picture(complete, interrupted, compiled.seconds)

    def _over(self) -> bool:
        """Whether to stop: after Ctrl-C, an error, or the time limit."""
        return self._cancelled.is_set() or time.perf_counter() > self._deadline

    def _draw_all(self, threads: int, hasty: bool) -> bool:
        """Draw round after round: a pixel's samples are summed in their order, so no tile may be in two at once."""
        spp = self.settings.spp if self.target is None else min(adaptive.FIRST, self.settings.spp)
        pixels, done = len(self.film.samples), 0
        hasty |= self.watcher.early(pixels * spp)
        self.watcher.begin(self.film.samples, self.at, self.window)
        drawn = [
            [Part(first, last, piece) for piece in pieces(pixels, BATCH // (last - first))]
            for first, last in rounds(spp, hasty)
        ]
        for parts in drawn:
            if not self._draw_parts(parts, threads, done, sum(map(len, drawn))):
                return False
            done += len(parts)
        return int(self.film.samples.min()) == spp

    def _draw_parts(self, parts: Sequence[Part], threads: int, before: int, total: int) -> bool:
        report = partial(self._report, before, total)
        return parallel.run(self._draw, parts, threads, self._over, report, self._cancelled.set)

    def _refine(self, threads: int, search: adaptive.Search) -> bool:
        """Give more samples to pixels round after round, until the error of the picture meets the target."""
        done = 0
        while parts := search.parts():
            if not self._draw_parts(parts, threads, done, done + len(parts)):
                return False
            done += len(parts)
        return True

    def _report(self, before: int, total: int, done: int) -> None:
        self._say("rendering", before + done, total)

    def _say(self, stage: str, done: int, total: int) -> None:
        rays = sum(wavefront.rays.total() for wavefront in list(self._wavefronts))
        since = self._drawing if stage == "rendering" else self.began
        self.watcher(Progress(stage, done, total, rays, time.perf_counter() - since))

    def _prepare(self) -> None:
        if not is_built(self.scene, self.precision):
            self._say("building", 0, 1)
        self.stage = stage_of(self.scene, self.plan, self.precision)
        self.view = make_view(self.scene.camera, self.settings.size, np.dtype(self.precision))
        self.sampler = make_sampler(self.settings.sampler, self.settings.seed, self.settings.spp)

    def _load_kernels(self) -> None:
        """Have the machine code of kernels ready here, where Ctrl-C is noticed, and not in the threads that draw."""
        load_all(tracing(Wavefront(self.stage, self.view, self.sampler, PACKET)))

    def _compile_ahead(self) -> None:
        """Have all compiled that this picture needs, for a kernel is missing."""
        self._say("compiling", 0, 1)
        plan, large = self.plan, len(self.scene.mesh.faces) > FEW
        features = plan.smooth, plan.refraction, plan.lights > 0, large, self.with_layers, self.search is not None
        compile_ahead([Picture(self.precision, self.settings.sampler, *features)], partial(self._say, "compiling"))

    def _draw(self, part: Part) -> None:
        """Add samples of some pixels to the film."""
        pixels = part.pixels
        if isinstance(pixels, slice):
            self._add(part, self.film, pixels.start, self.x[pixels], self.y[pixels])
            return
        padded = np.append(pixels, np.repeat(pixels[-1:], -len(pixels) % PACKET))
        film = taken(self.film, padded)
        self._add(part, film, 0, self.x[padded], self.y[padded])
        put(self.film, pixels, film)

    def _add(self, part: Part, film: Film, begin: int, x: NDArray[np.uint32], y: NDArray[np.uint32]) -> None:
        """Add samples of pixels (x, y), the first of which is there in a film, a batch after the other."""
        step = max(1, BATCH // len(x))
        done = part.first
        while done < part.last and not self._over():
            after = min(done + step, part.last)
            self._wavefront((after - done) * len(x)).add_samples(x, y, done, after, film.sums, begin)
            done = after
        film.samples[begin : begin + len(x)] = done
        shown = np.empty((3, len(x)))
        estimate(film, begin, begin + len(x), self.model, shown.reshape(-1))
        self.watcher.show(part.pixels, shown)
        if self.search:
            self.search.show(part.pixels, shown)

    def _wavefront(self, n: int) -> Wavefront:
        """Wavefront of the calling thread for batches of n samples."""
        front: Wavefront | None = getattr(self._local, "front", None)
        if front is None or n > front.most:
            front = self._local.front = Wavefront(self.stage, self.view, self.sampler, max(n, BATCH))
            self._wavefronts.append(front)
        if n != front.n:
            front.resize(n)
        return front

    def _picture(self, complete: bool, interrupted: bool, compile_seconds: float) -> Render:
        shown = make_frame(len(self.at))
        develop(self.film, self.at, shown)
        self.samples[:] = shown.samples.reshape(self.samples.shape)
        seconds = time.perf_counter() - self.began
        passes: defaultdict[str, float] = defaultdict(float)
        rays: Counter[str] = Counter()
        for wavefront in self._wavefronts:
            rays.update(wavefront.rays)
            for name, spent in wavefront.seconds.items():
                passes[name] += spent
        error = root_mean(shown.error) if self.search is None else self.search.error
        stats = {
            "seconds": seconds,
            "compile_seconds": compile_seconds,
            "seconds_by_pass": dict(passes),
            "rays": dict(rays),
            "samples": int(self.samples.sum()),
            "estimated_error": error,
            "estimated_error_linear": root_mean(shown.variance),
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
        stderr = np.minimum(np.sqrt(shown.variance), MOST).astype(np.float32).reshape(self.samples.shape)
        return Render(
            shown.rgb.reshape(*stderr.shape, 3), stderr, self.layers, stats, provenance, complete, interrupted
        )


def _trace_layers(scene: Scene, precision: str, size: tuple[int, int], window: Window) -> dict[str, NDArray[Any]]:
    return trace_layers(scene, stage_of(scene, plan_of(scene), precision).bvh, size, window)
