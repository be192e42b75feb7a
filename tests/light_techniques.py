"""Path tracing with light sampling alone or surface sampling alone, for comparison with both: for tests only.

``with technique("light")`` makes ``rt.render`` use that technique. After a perfectly specular surface emission counts in
all of them, as nothing else could find it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from raytrace.rendering import path_wavefront

TECHNIQUES = "both", "light", "surface"
NEVER = 1e-30  # a density that gives the other technique all the weight


def densities(scene: Any, value: float) -> Any:
    """A PathScene whose weights are made as if lights were sampled with a density: inf or nearly 0."""
    density = np.where(scene.surfaces.density > 0, value, 0).astype(scene.surfaces.density.dtype)
    environment = scene.environment
    if environment is not None:
        environment = np.append(environment[:3], environment.dtype.type(value))
    return scene._replace(surfaces=scene.surfaces._replace(density=density), environment=environment)


class LightAlone(path_wavefront.PathWavefront):
    """A path that scattered counts no lamp that it meets; sampled lights have weight 1."""

    def __init__(self, scene: Any, *rest: Any) -> None:
        super().__init__(densities(scene, np.inf), *rest)

    def _pick_lights(self, *where: Any) -> None:
        super()._pick_lights(*where)
        self.incident.pdf[:] = np.inf


class SurfaceAlone(path_wavefront.PathWavefront):
    """Lamps that a path meets have weight 1; no shadow ray is cast."""

    def __init__(self, scene: Any, *rest: Any) -> None:
        super().__init__(densities(scene, NEVER), *rest)

    def _pick_lights(self, *where: Any) -> None:
        super()._pick_lights(*where)
        self.incident.tmax[:] = -1


@contextmanager
def technique(name: str) -> Iterator[None]:
    """Render by light sampling alone ("light"), surface sampling alone ("surface") or multiple importance ("both")."""
    usual = path_wavefront.PathWavefront
    chosen = {"both": usual, "light": LightAlone, "surface": SurfaceAlone}[name]
    path_wavefront.PathWavefront = chosen  # type: ignore[misc]
    try:
        yield
    finally:
        path_wavefront.PathWavefront = usual  # type: ignore[misc]
