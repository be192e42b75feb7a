"""Path tracing with light sampling alone or surface sampling alone, for comparison with both: for tests only.

``with technique("light")`` makes ``rt.render`` use that technique. After a perfectly specular surface emission counts
in all of them, as nothing else could find it.
"""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import raytrace as rt
from raytrace.passes.film import LUMINANCE
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


class Images(NamedTuple):
    """Images of one technique under independent seeds."""

    luminance: NDArray[np.float64]  # (seeds, h, w): mean over the samples of each image
    spp: int

    @property
    def mean(self) -> float:
        return float(self.luminance.mean())

    @property
    def means(self) -> NDArray[np.float64]:
        """Mean of each image."""
        return self.luminance.mean(axis=(1, 2))

    @property
    def variance(self) -> NDArray[np.float64]:
        """Variance (h, w) of one sample."""
        return self.spp * self.luminance.var(axis=0, ddof=1)


def images(scene: Any, name: str, spp: int, seeds: range, size: tuple[int, int]) -> Images:
    """Images by one technique, with independent samples."""
    with technique(name):
        rendered = [rt.render(scene, spp=spp, size=size, seed=seed, sampler="independent").rgb for seed in seeds]
    return Images(np.array(rendered, np.float64) @ LUMINANCE, spp)


class Verdict(NamedTuple):
    """Whether two techniques have the same expectation, by Welch's t-test of the means of images."""

    p: float  # two-sided
    difference: float
    found: float  # the smallest difference that a test of the given level finds with probability 0.99


def compare(one: Images, other: Images, level: float) -> Verdict:
    """Compare the means of two techniques."""
    a, b = one.means, other.means
    result = stats.ttest_ind(a, b, equal_var=False)
    spread = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    least = (stats.t.ppf(1 - level / 2, result.df) + stats.t.ppf(0.99, result.df)) * spread
    return Verdict(float(result.pvalue), float(a.mean() - b.mean()), float(least))


def sidak(total: float, tests: int) -> float:
    """Level of each of several independent tests, for the total significance."""
    return float(-np.expm1(np.log1p(-total) / tests))


def lamps_in_view(scene: rt.Scene, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels (h, w) that show a lamp, at least in part: those of a scene that reflects nothing."""
    black = dataclasses.replace(scene, materials=scene.materials._replace(albedo=0 * scene.materials.albedo))
    return rt.render(black, spp=256, size=size).rgb.max(axis=2) > 0
