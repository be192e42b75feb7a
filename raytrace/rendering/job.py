"""A job: everything that decides the bits of an image."""

from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import raytrace
from raytrace.records import Scene, Settings, Window
from raytrace.scene.plan import Plan


class Job(NamedTuple):
    """A scene, and how it is to be rendered."""

    scene: Scene
    plan: Plan
    settings: Settings
    window: Window
    precision: str  # "float32" or "float64"
    target: float | None  # target error, RMSE in sRGB; None: all pixels have the same number of samples
    first_spp: int  # samples of every pixel before adaptive sampling starts; without a target error: all
    light: bool = False  # whether to keep emission, direct and indirect light


class Tiling(NamedTuple):
    """How an image is cut into work items; it changes no bit of the image."""

    first: int | None = None  # samples of each pixel in the first round; 0: all; None: not yet known
    leap: int = 2  # the largest factor by which a round may multiply the samples
    at_least: int = 0  # pixels of a work item
    work: int = 0  # samples of a work item at least


def identity(job: Job) -> dict[str, Any]:
    """Return what decides the bits of an image, as JSON types: two images are bit-identical where it is equal."""
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
        "light_layers": job.light,
    }


def build() -> str:
    """Return version and source hash of this package."""
    return f"{raytrace.__version__} ({sources()})"


@cache
def sources() -> str:
    """Return a hash of this package as installed: during development, equal version numbers may differ in code."""
    digest, package = sha256(), Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\n" + path.read_bytes())
    return digest.hexdigest()[:16]
