"""``render``: tiles of pixels on several threads, with progress, cancel and a time limit."""

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

import raytrace
from raytrace import parallel
from raytrace.accel.lanes import BITS
from raytrace.jit import on_compile
from raytrace.options import deadline_after, layers_of, override, window_of
from raytrace.passes.camera import make_view
from raytrace.passes.film import LUMINANCE
from raytrace.passes.sampling import make_sampler
from raytrace.picture import Layers, Render, trace_layers
from raytrace.records import Scene, Settings, Window
from raytrace.scene.load import load
from raytrace.scene.plan import make_plan
from raytrace.wavefront import BATCH, Stage, Wavefront, make_stage

TILE = 32  # pixels: side of a tile

_stages: WeakKeyDictionary[Scene, dict[str, Stage]] = WeakKeyDictionary()  # of scenes drawn before


def set_stage(scene: Scene, stage: Stage) -> None:
    """Draw a scene on this stage from now on, in the stage's precision."""
    _stages.setdefault(scene, {})[stage.bvh.precision] = stage


class Progress(NamedTuple):
    """One message of a running render."""

    stage: str  # "compiling", "building" or "rendering"
    done: int  # finished parts
    total: int  # all parts
    rays: int  # traced so far, of all kinds
    seconds: float  # since the stage began


class Film(NamedTuple):
    """Sums of the samples of every pixel of a window."""

    sums: NDArray[np.float64]  # (4, h * w): red, green, blue, squared luminance
    samples: NDArray[np.int32]  # (h * w,)


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
    settings = override(scene.settings, spp, size, seed, precision, sampler)
    window = window_of(settings.size, crop)
    layers, limit = layers_of(aov), deadline_after(time_limit)
    job = _Job(scene, settings, window, progress or (lambda _: None))
    return job.run(parallel.thread_count(threads), limit, layers)


def _tile_order() -> NDArray[np.uint32]:
    """(x, y) of the pixels of a tile along a Z curve: any packet is a compact block   [Morton1966]."""
    y, x = np.mgrid[0:TILE, 0:TILE]
    curve = sum(((x >> bit & 1) << 2 * bit) | ((y >> bit & 1) << 2 * bit + 1) for bit in range(TILE.bit_length() - 1))
    order = np.argsort(np.ravel(curve))
    return np.stack([x.ravel()[order], y.ravel()[order]]).astype(np.uint32)


class _Job:
    """One call of ``render``."""

    def __init__(self, scene: Scene, settings: Settings, window: Window, progress: Callable[[Progress], None]) -> None:
        self.scene, self.settings, self.window, self.progress = scene, settings, window, progress
        self.plan = make_plan(scene)
        self.precision = self.plan.precision.name if settings.precision == "auto" else settings.precision
        pixels = window.width * window.height
        self.film = Film(np.zeros((4, pixels)), np.zeros(pixels, np.int32))
        self.layers = Layers(self.film.samples.reshape(window.height, window.width), self._trace_layers)
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
                complete = self._draw_all(threads, hasty=time_limit < np.inf)
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
        tiles, rounds = list(self._tiles()), _rounds(self.settings.spp, hasty)
        for number, samples in enumerate(rounds):
            before, total = number * len(tiles), len(rounds) * len(tiles)
            report = partial(self._report, before, total)
            draw = partial(self._draw, samples)
            if not parallel.run(draw, tiles, threads, self._over, report, self._cancelled.set):
                return False
        return int(self.film.samples.min()) == self.settings.spp

    def _report(self, before: int, total: int, done: int) -> None:
        self._say("rendering", before + done, total)

    def _say(self, stage: str, done: int, total: int) -> None:
        rays = sum(wavefront.rays.total() for wavefront in list(self._wavefronts))
        since = self._drawing if stage == "rendering" else self.began
        self.progress(Progress(stage, done, total, rays, time.perf_counter() - since))

    def _prepare(self) -> None:
        stages = _stages.setdefault(self.scene, {})
        if self.precision not in stages:
            self._say("building", 0, 1)
            stages[self.precision] = make_stage(self.scene, self.plan, self.precision)
        self.stage = stages[self.precision]
        self.view = make_view(self.scene.camera, self.settings.size, np.dtype(self.precision))
        self.sampler = make_sampler(self.settings.sampler, self.settings.seed, self.settings.spp)

    def _tiles(self) -> Iterator[tuple[NDArray[np.uint32], NDArray[np.uint32]]]:
        """Columns and rows, on the film, of the pixels of each tile."""
        x, y = _tile_order()
        left, top, width, height = self.window
        for tile_y in range(top, top + height, TILE):
            for tile_x in range(left, left + width, TILE):
                inside = (x < left + width - tile_x) & (y < top + height - tile_y)
                yield x[inside] + np.uint32(tile_x), y[inside] + np.uint32(tile_y)

    def _draw(self, samples: tuple[int, int], tile: tuple[NDArray[np.uint32], NDArray[np.uint32]]) -> None:
        """Add samples (the first, and the one after the last) of one tile to the film, a batch after the other."""
        (first, last), (x, y) = samples, tile
        pixels = (y.astype(np.int64) - self.window.y) * self.window.width + (x.astype(np.int64) - self.window.x)
        spare = -len(x) % (BITS // 8 // np.dtype(self.precision).itemsize)
        x, y = np.pad(x, (0, spare), "edge"), np.pad(y, (0, spare), "edge")
        sums = np.pad(self.film.sums[:, pixels], ((0, 0), (0, spare)))
        step = max(1, BATCH // len(x))
        done = first
        while done < last and not self._over():
            end = min(done + step, last)
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
        samples = self.film.samples
        rgb, stderr = _estimate(self.film)
        seconds = time.perf_counter() - self.began
        passes: defaultdict[str, float] = defaultdict(float)
        rays: Counter[str] = Counter()
        for wavefront in self._wavefronts:
            rays.update(wavefront.rays)
            for name, spent in wavefront.seconds.items():
                passes[name] += spent
        known = stderr[np.isfinite(stderr)]
        stats = {
            "seconds": seconds,
            "compile_seconds": compile_seconds,
            "seconds_by_pass": dict(passes),
            "rays": dict(rays),
            "samples": int(samples.sum()),
            "estimated_error": float(np.sqrt(np.mean(known.astype(np.float64) ** 2))) if len(known) else float("nan"),
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
        rgb, stderr = rgb.reshape(height, width, 3), stderr.reshape(height, width)
        return Render(rgb, stderr, self.layers, stats, provenance, complete, interrupted)

    def _trace_layers(self) -> dict[str, NDArray[Any]]:
        self._prepare()
        return trace_layers(self.scene, self.stage.bvh, self.settings.size, self.window)


def _rounds(spp: int, hasty: bool) -> list[tuple[int, int]]:
    """Ranges of samples: all at once, or ever more where time may run out, so that the whole picture is there early."""
    bounds = [0, spp]
    if hasty:
        bounds = [0, *(1 << k for k in range((spp - 1).bit_length())), spp]
    return list(pairwise(bounds))


def _estimate(film: Film) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mean radiance, and the standard error of its luminance: sqrt((mean of y^2 - (mean of y)^2) / (n - 1))."""
    n = np.maximum(film.samples, 1)
    mean = film.sums / n
    spread = np.maximum(mean[3] - (np.array(LUMINANCE) @ mean[:3]) ** 2, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        stderr = np.where(film.samples > 1, np.sqrt(spread / (n - 1)), np.nan)
    return mean[:3].T.astype(np.float32), stderr.astype(np.float32)
