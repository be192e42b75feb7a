"""``render``: tiles of pixels on several threads, with progress, cancel and a time limit."""

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

import raytrace
from raytrace import parallel
from raytrace.accel.lanes import BITS
from raytrace.errors import OptionError
from raytrace.jit import on_compile
from raytrace.passes.camera import make_view
from raytrace.passes.film import LUMINANCE
from raytrace.passes.sampling import make_sampler
from raytrace.picture import LAYERS, Layers, Render, trace_layers
from raytrace.records import Scene, Settings, Window
from raytrace.scene.load import load
from raytrace.scene.plan import make_plan
from raytrace.wavefront import BATCH, Stage, Wavefront, make_stage

TILE = 32  # pixels: side of a tile
MAX_SIDE, MAX_PIXELS, MAX_SPP = 1 << 16, 1 << 28, 1 << 16  # as in the scene format

_stages: WeakKeyDictionary[Scene, dict[str, Stage]] = WeakKeyDictionary()  # of scenes drawn before


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
    settings = _settings(scene.settings, spp, size, seed, precision, sampler)
    window = _window(settings.size, crop)
    for name in aov:
        if name not in LAYERS:
            raise OptionError(f"aov: {name!r}: expected some of {', '.join(LAYERS)}")
    job = _Job(scene, settings, window, progress or (lambda _: None))
    picture = job.run(threads, time_limit)
    for name in aov:
        picture.aov[name]
    return picture


def _settings(settings: Settings, spp: Any, size: Any, seed: Any, precision: Any, sampler: Any) -> Settings:
    """The scene's settings with the caller's in their place, checked."""
    wanted = {"spp": spp, "size": size, "seed": seed, "precision": precision, "sampler": sampler}
    settings = settings._replace(**{name: value for name, value in wanted.items() if value is not None})
    choices = {"precision": ("auto", "float32", "float64"), "sampler": ("sobol", "stratified", "independent")}
    for name, allowed in choices.items():
        if getattr(settings, name) not in allowed:
            raise OptionError(f"{name}: expected one of {', '.join(allowed)}, got {getattr(settings, name)!r}")
    for name, low, high in (("spp", 1, MAX_SPP), ("seed", 0, 2**32 - 1)):
        if not low <= getattr(settings, name) <= high:
            raise OptionError(f"{name}: expected a number from {low} to {high}, got {getattr(settings, name)}")
    width, height = settings.size
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        raise OptionError(f"size: {width}x{height} is outside 1x1 .. {MAX_PIXELS:,} pixels, {MAX_SIDE:,} a side")
    return settings


def _window(size: tuple[int, int], crop: tuple[int, int, int, int] | None) -> Window:
    window = Window(*(crop or (0, 0, *size)))
    inside = (
        window.x >= 0 and window.y >= 0 and window.x + window.width <= size[0] and window.y + window.height <= size[1]
    )
    if not inside or window.width < 1 or window.height < 1:
        raise OptionError(f"crop: {','.join(map(str, window))} is not a part of the film of {size[0]}x{size[1]} pixels")
    return window


def _tile_order() -> NDArray[np.uint32]:
    """(x, y) of the pixels of a tile along a Z curve: any packet is a compact block   [Morton 1966]."""
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
        self.began = time.perf_counter()
        self._local = threading.local()
        self._wavefronts: list[Wavefront] = []

    def run(self, threads: int | None, time_limit: float | None) -> Render:
        """Draw until done, stopped or out of time."""
        deadline = np.inf if time_limit is None else self.began + time_limit
        complete, interrupted = False, False
        with on_compile(lambda: self._say("compiling", 0, 1)) as compiled:
            try:
                self._prepare()
                work = list(self._work(_rounds(self.settings.spp, time_limit is not None)))
                self._drawing = time.perf_counter()
                complete = parallel.run(
                    self._draw, work, threads, lambda: time.perf_counter() > deadline,
                    lambda done: self._say("rendering", done, len(work)),
                )  # fmt: skip
            except KeyboardInterrupt:
                interrupted = True
        return self._picture(complete, interrupted, compiled.seconds)

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

    def _work(self, rounds: list[tuple[int, int]]) -> Iterator[tuple[NDArray[np.uint32], NDArray[np.uint32], int, int]]:
        """Tiles: columns and rows of their pixels on the film, first sample and the one after the last."""
        x, y = _tile_order()
        left, top, width, height = self.window
        for first, last in rounds:
            for tile_y in range(top, top + height, TILE):
                for tile_x in range(left, left + width, TILE):
                    inside = (x < left + width - tile_x) & (y < top + height - tile_y)
                    yield x[inside] + np.uint32(tile_x), y[inside] + np.uint32(tile_y), first, last

    def _draw(self, tile: tuple[NDArray[np.uint32], NDArray[np.uint32], int, int]) -> None:
        """Add the samples of one tile to the film, a batch after the other."""
        x, y, first, last = tile
        pixels = (y.astype(np.int64) - self.window.y) * self.window.width + (x.astype(np.int64) - self.window.x)
        spare = -len(x) % (BITS // 8 // np.dtype(self.precision).itemsize)
        x, y = np.pad(x, (0, spare), "edge"), np.pad(y, (0, spare), "edge")
        sums = np.pad(self.film.sums[:, pixels], ((0, 0), (0, spare)))
        step = max(1, BATCH // len(x))
        for sample in range(first, last, step):
            end = min(sample + step, last)
            self._wavefront((end - sample) * len(x)).add_samples(x, y, sample, end, sums)
        self.film.sums[:, pixels] = sums[:, : len(pixels)]
        self.film.samples[pixels] = last

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
        layers = Layers(samples.reshape(height, width), self._trace_layers)
        shape = (height, width)
        return Render(rgb.reshape(*shape, 3), stderr.reshape(shape), layers, stats, provenance, complete, interrupted)

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
