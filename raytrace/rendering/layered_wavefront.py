"""Path tracing that also keeps emission, direct and indirect light apart; only for renders that ask for it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import PACKET
from raytrace.passes.film import SPLIT
from raytrace.passes.light_layers import accumulate_layers, mark_first, split
from raytrace.passes.path_records import Paths
from raytrace.records import View
from raytrace.rendering.path_scene import PathScene
from raytrace.rendering.path_wavefront import PathWavefront


class LayeredWavefront(PathWavefront):
    """The passes of path tracing, whose light is also added to layers.

    Parameters
    ----------
    scene, view, sampler, n
        As ``PathWavefront`` has them.
    """

    def __init__(self, scene: PathScene, view: View, sampler: Any, n: int) -> None:
        self._light, self._layers = (
            np.zeros(k * (n + PACKET), scene.bvh.triangles.dtype) for k in (3, SPLIT)
        )  # before the first call of ``resize``
        super().__init__(scene, view, sampler, n)

    def resize(self, n: int) -> None:
        """Take n samples a batch from now on, in the memory that is there."""
        super().resize(n)
        self.light, self.layers = self._light[: 3 * self._rows], self._layers[: SPLIT * self._rows]

    def add_samples(
        self, x: NDArray[np.uint32], y: NDArray[np.uint32], first: int, last: int, sums: Any, begin: int
    ) -> None:
        """Add samples ``first`` .. ``last - 1`` of all pixels (x, y) of a batch to their sums, layers included."""
        self.layers[:] = 0.0
        super().add_samples(x, y, first, last, sums, begin)
        accumulate_layers(self.layers, first, last, sums, begin, len(x))
        self._lap("film")

    def _see(self, here: Paths, n: int, depth: int) -> None:
        radiance, self.radiance = self.radiance, self.light
        super()._see(here, n, depth)
        self.radiance = radiance
        split(here, n, 1, self.light, radiance, self.layers)
        self._lap("layers")

    def _scatter(self, here: Paths, n: int, depth: int) -> None:
        mark_first(here, n)
        self._lap("layers")
        super()._scatter(here, n, depth)

    def _add_light(self, here: Paths, n: int, spare: Paths) -> None:
        radiance, self.radiance = self.radiance, self.light
        super()._add_light(here, n, spare)
        self.radiance = radiance
        split(here, n, 0, self.light, radiance, self.layers)
        self._lap("layers")
