"""Render threads: each thread of this process adds samples with wavefronts of its own."""

import contextlib
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from raytrace.accel.lanes import PACKET
from raytrace.jit import load_all
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import make_sampler
from raytrace.records import Scene, Settings
from raytrace.rendering.compiled_scene import compiled_of, paths_of
from raytrace.rendering.film_tiles import LONG, FilmTile, FilmTiles, blank
from raytrace.rendering.wavefront import BATCH, Wavefront
from raytrace.scene.plan import Plan

if TYPE_CHECKING:
    from raytrace.rendering.path_wavefront import PathWavefront

LEAST = 1 << 20  # samples: fewer never take long; on two cores of 2020 so many take 0.01 to 1 s
SPOTS, SAMPLES = 16, 4  # to estimate the time: places of the film where samples are taken; samples of each pixel there

_loaded: set[tuple[Any, ...]] = set()  # kinds of wavefronts whose kernels this process has loaded

AnyWavefront = Union[Wavefront, "PathWavefront"]


class RenderThreads:
    """Adds samples of a scene, on any number of threads at once.

    Parameters
    ----------
    scene : Scene
        Compiled on first use.
    plan : Plan
    precision : str
    settings : Settings
        Film, samples and seed.
    light : bool
        Whether to keep the light layers, with path tracing.
    """

    def __init__(self, scene: Scene, plan: Plan, precision: str, settings: Settings, light: bool = False) -> None:
        self.scene, self.compiled = scene, compiled_of(scene, plan, precision)
        self._view = make_view(scene.camera, settings.size, np.dtype(precision))
        self._sampler = make_sampler(settings.sampler, settings.seed, settings.spp)
        self._paths = paths_of(scene, self.compiled, settings.integrator)
        self._light = light
        self._local = threading.local()
        self._wavefronts: list[AnyWavefront] = []
        self._idle: list[AnyWavefront] = []  # of threads that have ended

    def load_kernels(self) -> None:
        """Load machine code in the calling thread, which can be interrupted, before other threads need it."""
        compiled = self.compiled
        plan, leaves = compiled.plan, type(compiled.bvh.tree.leaves)
        kind: tuple[Any, ...] = (compiled.bvh.precision, leaves, type(self._sampler), plan.smooth)
        kind += (plan.refraction, plan.lights > 0) if self._paths is None else (*self._paths.kernel_key(), self._light)
        if kind not in _loaded:
            from raytrace.rendering.kernels import tracing

            load_all(tracing(self._make(PACKET)))
            _loaded.add(kind)

    def draw(self, tile: FilmTile, first: int, last: int, over: Callable[[], bool] = lambda: False) -> int:
        """Add samples ``first`` .. ``last - 1`` of a tile's pixels to their sums, batch after batch.

        Returns
        -------
        int
            The samples that the pixels have: ``last``, or fewer where ``over`` ended the work.
        """
        n = len(tile.x)
        step = max(1, BATCH // n)
        done = first
        while done < last and not over():
            after = min(done + step, last)
            wavefront = self._wavefront((after - done) * n)
            wavefront.add_samples(tile.x, tile.y, done, after, tile.film.sums, tile.begin)
            done = after
        return done

    def _make(self, n: int) -> "AnyWavefront":
        """A new wavefront for batches of n samples."""
        if self._paths is None:
            return Wavefront(self.compiled, self._view, self._sampler, n)
        from raytrace.rendering.path_wavefront import PathWavefront

        if self._light:
            from raytrace.rendering.layered_wavefront import LayeredWavefront

            return LayeredWavefront(self._paths, self._view, self._sampler, n)
        return PathWavefront(self._paths, self._view, self._sampler, n)

    def _wavefront(self, n: int) -> "AnyWavefront":
        """Wavefront of the calling thread for batches of n samples."""
        front: AnyWavefront | None = getattr(self._local, "front", None)
        if front is None:
            with contextlib.suppress(IndexError):  # none is left
                front = self._local.front = self._idle.pop()
        if front is None or n > front.most:
            front = self._local.front = self._make(max(n, BATCH))
            self._wavefronts.append(front)
            self._local.__dict__.setdefault("all", []).append(front)
        if n != front.n:
            front.resize(n)
        return front

    def expected(self, film_tiles: FilmTiles, spp: int, threads: int) -> float:
        """Estimate the seconds for so many samples of each pixel; 0 where they are too few to matter."""
        samples = len(film_tiles.at) * spp
        if samples < LEAST:
            return 0.0
        seconds = 0.0
        for pixels in (BATCH // SPOTS // SAMPLES // 4, BATCH // SPOTS // SAMPLES):
            seconds = min(self._timed(film_tiles, pixels, min(SAMPLES, spp)) for _ in range(2)) * samples / threads
            if seconds <= LONG:  # small batches are slower than large ones
                break
        return seconds

    def _timed(self, film_tiles: FilmTiles, pixels: int, samples: int) -> float:
        """Seconds per sample, for so many neighbouring pixels at each spot; the results are dropped."""
        count = len(film_tiles.at)
        spots = np.linspace(0, max(count - pixels, 0), SPOTS).astype(int) // PACKET * PACKET
        tile = blank(
            *film_tiles.positions(np.minimum(spots[:, None] + np.arange(pixels), count - 1).ravel()), self._light
        )
        began = time.perf_counter()
        self.draw(tile, 0, samples)
        seconds = time.perf_counter() - began
        self.forget()
        return seconds / (len(tile.x) * samples)

    def rest(self) -> None:
        """Make the wavefronts of threads that have ended available to the next threads."""
        self._idle, self._local = list(self._wavefronts), threading.local()

    def forget(self) -> None:
        """Reset the counts of rays and seconds."""
        for front in self._wavefronts:
            front.rays.clear()
            front.seconds.clear()

    def mine(self) -> tuple[Counter[str], dict[str, float]]:
        """Rays traced and seconds spent so far by the calling thread."""
        return _tally(getattr(self._local, "all", ()))

    def rays(self) -> Counter[str]:
        """Rays traced so far, by kind."""
        return _tally(list(self._wavefronts))[0]

    def seconds(self) -> dict[str, float]:
        """Seconds spent so far, by pass; summed over threads."""
        return _tally(list(self._wavefronts))[1]


def _tally(wavefronts: Iterable[AnyWavefront]) -> tuple[Counter[str], dict[str, float]]:
    rays, seconds = Counter[str](), defaultdict[str, float](float)
    for wavefront in wavefronts:
        rays.update(wavefront.rays)
        for name, spent in wavefront.seconds.items():
            seconds[name] += spent
    return rays, dict(seconds)
