"""The reference image of a report: rendered in float64 until it is accurate enough, and cached."""

import contextlib
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, OptionError, printable
from raytrace.image import files
from raytrace.image.metrics import screen
from raytrace.limits import MAX_SEED, MAX_SPP
from raytrace.native.store import cache_folder
from raytrace.records import Scene
from raytrace.rendering.progress import Progress
from raytrace.rendering.rendering import render

AHEAD = 10.0  # goal: ratio of the error of an image of `PILOT` samples to the error of the reference
START, STEP = 16, 4  # samples per pixel of each half: at first, and the factor of each increase up to `PILOT`
ORDER = 0.75  # error ~ spp^-ORDER near edges; used to estimate the necessary samples
PILOT = 256  # samples per pixel of the most accurate image that is measured
KEPT = "error", "pilot", "spp", "seconds"  # stored with the image in the cache
SEED_STEP = 0x9E3779B9  # 2^32 / golden ratio: the seeds of the halves differ from the measured ones


class Reference(NamedTuple):
    """The reference image and its estimated error."""

    rgb: NDArray[np.float32]  # (h, w, 3) linear radiance
    error: float  # its RMSE (sRGB), estimated from the difference of its halves; NaN: unknown
    pilot: float  # RMSE (sRGB) of an image of `PILOT` samples; NaN: unknown
    spp: int  # samples per pixel of both halves; 0: unknown
    seconds: float  # time to render it, without compilation
    origin: str  # "drawn", "cache", or the name of a file

    @property
    def enough(self) -> bool:
        """Whether it is ten times more accurate than an image of `PILOT` samples."""
        return self.error * AHEAD <= self.pilot


def read_reference(path: Path, size: tuple[int, int]) -> Reference:
    """Read a reference from an image file.

    Raises
    ------
    FileError
        The file can't be read.
    OptionError
        The image has another size.
    """
    rgb = files.load(path).rgb
    if rgb.shape[:2] != size[::-1]:
        raise OptionError(
            f"reference: {printable(path)} has {rgb.shape[1]}x{rgb.shape[0]} pixels, the film {size[0]}x{size[1]}; "
            "render it again, or set the size"
        )
    return Reference(rgb, math.nan, math.nan, 0, 0.0, str(path))


def make_reference(
    scene: Scene, size: tuple[int, int], seconds: float, progress: Callable[[float, Progress], None]
) -> Reference:
    """Render a reference, or load it from the cache.

    Parameters
    ----------
    scene : Scene
    size : (width, height), pixels
    seconds : float
        Approximate time limit, without compilation. The first step is always rendered.
    progress : callable
        Called with the share of the time that has passed, and the progress of the render.

    Returns
    -------
    Reference
        The mean of two images with different seeds. Half the RMSE between them estimates its error.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C before it is complete.

    Notes
    -----
    It is rendered with more and more samples. This stops when its error is a tenth of that of an image of `PILOT`
    samples, or when the next step would take too long. The result is cached, and a later call continues from it.
    """
    path = cache_folder() / "references" / f"{scene.sha256[:24]}-{size[0]}x{size[1]}.npz"
    known = _from_cache(path, size)
    left = seconds
    while known is None or (spp := next_spp(known, left)):
        known = _next_step(scene, size, START if known is None else spp, known, partial(progress, 1 - left / seconds))
        left -= known.seconds
        _keep(path, known)
    return known


def next_spp(known: Reference, seconds: float) -> int:
    """Samples per pixel of each half in the next step; 0: accurate enough, or not enough time.

    >>> known = Reference(np.zeros((1, 1, 3), np.float32), 1e-4, 2e-4, 512, 3.0, "drawn")  # goal: 2e-5
    >>> next_spp(known, 100.0), next_spp(known, 30.0), next_spp(known, 5.0)
    (4096, 2048, 0)
    """
    half = known.spp // 2
    affordable = half * seconds / max(known.seconds, 1e-9)
    if half < PILOT:
        return STEP * half if affordable >= STEP * half else 0
    if known.enough:
        return 0
    goal = half * (known.error * AHEAD / known.pilot) ** (1 / ORDER)
    spp = 2 ** min(math.ceil(math.log2(goal)), math.floor(math.log2(max(affordable, 1.0))))
    return min(spp, MAX_SPP) if min(spp, MAX_SPP) > half else 0


def _next_step(
    scene: Scene, size: tuple[int, int], spp: int, before: Reference | None, progress: Callable[[Progress], None]
) -> Reference:
    began, compiling, halves = time.perf_counter(), 0.0, []
    for k in (1, 2):
        seed = (scene.settings.seed + k * SEED_STEP) % (MAX_SEED + 1)
        half = render(scene, spp, size, seed, "float64", "sobol", progress=progress)
        if half.interrupted:
            raise KeyboardInterrupt
        compiling += half.stats["compile_seconds"]
        halves.append(half.rgb.astype(np.float64))
    between = float(np.sqrt(np.mean((screen(halves[0]) - screen(halves[1])) ** 2)))
    known_pilot = before.pilot if before else math.nan
    return Reference(
        rgb=((halves[0] + halves[1]) / 2).astype(np.float32),
        error=between / 2,
        pilot=between / math.sqrt(2) if spp == PILOT else known_pilot,
        spp=2 * spp,
        seconds=time.perf_counter() - began - compiling,
        origin="drawn",
    )


def _from_cache(path: Path, size: tuple[int, int]) -> Reference | None:
    try:
        kept = files.load(path)
        record = kept.provenance
        if kept.rgb.shape[:2] != size[::-1]:
            return None
        errors = float(record["error"]), float(record["pilot"])
        return Reference(kept.rgb, *errors, int(record["spp"]), float(record["seconds"]), "cache")
    except (FileError, KeyError, TypeError, ValueError, OverflowError):  # not in the cache, or not a valid entry
        return None


def _keep(path: Path, reference: Reference) -> None:
    with contextlib.suppress(OSError):  # without a writable folder, every process renders its own
        path.parent.mkdir(parents=True, exist_ok=True)
        files.save(path, reference.rgb, provenance={name: getattr(reference, name) for name in KEPT})
