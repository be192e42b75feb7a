"""What a picture is drawn from: all that decides its bits."""

from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import raytrace
from raytrace.records import Scene, Settings, Window
from raytrace.rendering.adaptive import FIRST
from raytrace.scene.path_plan import needs_paths


class Job(NamedTuple):
    """A scene, and what is wanted of it."""

    scene: Scene
    settings: Settings
    window: Window
    precision: str  # "float32" or "float64"
    target: float | None  # error of the picture, RMSE in sRGB; None: all pixels have the same samples

    @property
    def paths(self) -> bool:
        """Whether the passes of path tracing run."""
        return needs_paths(self.scene, self.settings.integrator)

    @property
    def first_spp(self) -> int:
        """Samples that all pixels have before any of them gets more."""
        return self.settings.spp if self.target is None else min(FIRST, self.settings.spp)


class Tiling(NamedTuple):
    """How a picture is cut into parts; it decides none of its bits."""

    first: int | None = None  # samples of each pixel in the first pass over the film; 0: all; None: not yet known
    leap: int = 2  # by how much a pass may multiply the samples
    at_least: int = 0  # pixels of a part
    work: int = 0  # samples of a part at least


def identity(job: Job) -> dict[str, Any]:
    """What two pictures have in common if they have the same bits, as JSON types."""
    settings = job.settings
    return {
        "raytrace": raytrace.__version__,
        "sources": sources(),
        "scene": job.scene.sha256,
        "size": list(settings.size),
        "crop": list(job.window),
        "spp": settings.spp,
        "sampler": settings.sampler,
        "integrator": settings.integrator,
        "seed": settings.seed,
        "precision": job.precision,
        "target_error": job.target,
    }


def build() -> str:
    """Which raytrace this is."""
    return f"{raytrace.__version__} ({sources()})"


@cache
def sources() -> str:
    """A hash of this package as it is installed: two versions of one number differ while they are worked on."""
    digest, package = sha256(), Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\n" + path.read_bytes())
    return digest.hexdigest()[:16]
