"""Who draws: the threads of one process, each with wavefronts of its own."""

import contextlib
import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Union

import numpy as np

from raytrace.accel.lanes import PACKET
from raytrace.jit import load_all
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import make_sampler
from raytrace.records import Scene, Settings
from raytrace.rendering.compiled_scenes import compiled_of, paths_of
from raytrace.rendering.film_tiles import FilmTile
from raytrace.rendering.kernels import tracing
from raytrace.rendering.wavefront import BATCH, Wavefront
from raytrace.scene.plan import Plan

if TYPE_CHECKING:
    from raytrace.rendering.path_wavefront import PathWavefront

AnyWavefront = Union[Wavefront, "PathWavefront"]


class RenderThreads:
    """Draws samples of a scene, on any number of threads at once.

    Parameters
    ----------
    scene : Scene
        Is built if it wasn't before.
    plan : Plan
    precision : str
    settings : Settings
        Film, samples and seed.
    """

    def __init__(self, scene: Scene, plan: Plan, precision: str, settings: Settings) -> None:
        self.scene, self.stage = scene, compiled_of(scene, plan, precision)
        self._view = make_view(scene.camera, settings.size, np.dtype(precision))
        self._sampler = make_sampler(settings.sampler, settings.seed, settings.spp)
        self._paths = paths_of(scene, self.stage, settings.integrator)
        self._local = threading.local()
        self._wavefronts: list[Wavefront | PathWavefront] = []
        self._idle: list[Wavefront | PathWavefront] = []  # of threads that have ended

    def _make(self, n: int) -> AnyWavefront:
        """A wavefront for batches of n samples."""
        if self._paths is None:
            return Wavefront(self.stage, self._view, self._sampler, n)
        from raytrace.rendering.path_wavefront import PathWavefront

        return PathWavefront(self._paths, self._view, self._sampler, n)

    def load_kernels(self) -> None:
        """Have the machine code of kernels ready here, where Ctrl-C is noticed, and not in the threads that draw."""
        load_all(tracing(self._make(PACKET)))

    def draw(self, sheet: FilmTile, first: int, last: int, over: Callable[[], bool] = lambda: False) -> int:
        """Add samples ``first`` .. ``last - 1`` of a sheet's pixels to their sums, a batch after the other.

        Returns
        -------
        int
            The samples that the pixels have: ``last``, or fewer where it was ``over`` before.
        """
        n = len(sheet.x)
        step = max(1, BATCH // n)
        done = first
        while done < last and not over():
            after = min(done + step, last)
            wavefront = self._wavefront((after - done) * n)
            wavefront.add_samples(sheet.x, sheet.y, done, after, sheet.film.sums, sheet.begin)
            done = after
        return done

    def _wavefront(self, n: int) -> AnyWavefront:
        """Wavefront of the calling thread for batches of n samples."""
        front: Wavefront | PathWavefront | None = getattr(self._local, "front", None)
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

    def rest(self) -> None:
        """Let the next threads have the wavefronts of those that have ended."""
        self._idle, self._local = list(self._wavefronts), threading.local()

    def forget(self) -> None:
        """Count rays and seconds anew."""
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
