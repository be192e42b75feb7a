"""Who draws: the threads of one process, each with wavefronts of its own."""

import threading
from collections import Counter, defaultdict
from collections.abc import Callable

import numpy as np

from raytrace.accel.lanes import PACKET
from raytrace.canvas import Sheet
from raytrace.jit import load_all
from raytrace.needs import tracing
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import make_sampler
from raytrace.records import Camera, Settings
from raytrace.wavefront import BATCH, Stage, Wavefront


class Crew:
    """Draws samples of a scene, on any number of threads at once.

    Parameters
    ----------
    stage : Stage
    camera : Camera
    settings : Settings
        Film, samples and seed.
    """

    def __init__(self, stage: Stage, camera: Camera, settings: Settings) -> None:
        self.stage = stage
        self._view = make_view(camera, settings.size, np.dtype(stage.bvh.precision))
        self._sampler = make_sampler(settings.sampler, settings.seed, settings.spp)
        self._local = threading.local()
        self._wavefronts: list[Wavefront] = []

    def load_kernels(self) -> None:
        """Have the machine code of kernels ready here, where Ctrl-C is noticed, and not in the threads that draw."""
        load_all(tracing(Wavefront(self.stage, self._view, self._sampler, PACKET)))

    def draw(self, sheet: Sheet, first: int, last: int, over: Callable[[], bool] = lambda: False) -> int:
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

    def _wavefront(self, n: int) -> Wavefront:
        """Wavefront of the calling thread for batches of n samples."""
        mine = self._local.__dict__.setdefault("wavefronts", {})
        if n not in mine:
            mine[n] = Wavefront(self.stage, self._view, self._sampler, n)
            self._wavefronts.append(mine[n])
        return mine[n]

    def rays(self) -> Counter[str]:
        """Rays traced so far, by kind."""
        traced: Counter[str] = Counter()
        for wavefront in list(self._wavefronts):
            traced.update(wavefront.rays)
        return traced

    def seconds(self) -> dict[str, float]:
        """Seconds spent so far, by pass; summed over threads."""
        spent: defaultdict[str, float] = defaultdict(float)
        for wavefront in list(self._wavefronts):
            for name, seconds in wavefront.seconds.items():
                spent[name] += seconds
        return dict(spent)
