"""The picture that others are judged by: drawn in float64 until it is accurate enough, and kept."""

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

AHEAD = 10.0  # the reference is so many times more accurate than what it judges
START, STEP = 16, 4  # samples per pixel of each half: at first, and how many times more up to `PILOT`
ORDER = 0.75  # error ~ spp^-order near edges, by which the samples that are needed are guessed
PILOT = 256  # samples per pixel: the best picture that is judged
KEPT = "error", "pilot", "spp", "seconds"  # beside the picture, in the cache
SEED_STEP = 0x9E3779B9  # golden ratio of 2^32: the halves' seeds are far from those that are judged


class Reference(NamedTuple):
    """What is held to be the truth."""

    rgb: NDArray[np.float32]  # (h, w, 3) linear radiance
    error: float  # its own RMSE on a screen, from the difference of its halves; NaN: unknown
    pilot: float  # RMSE on a screen of a picture of `PILOT` samples; NaN: unknown
    spp: int  # samples per pixel of both halves; 0: unknown
    seconds: float  # that drawing it took, compilation apart
    origin: str  # "drawn", "cache", or the name of a file

    @property
    def enough(self) -> bool:
        """Whether it is ten times more accurate than what it judges."""
        return self.error * AHEAD <= self.pilot


def read_reference(path: Path, size: tuple[int, int]) -> Reference:
    """Take a picture file as the truth.

    Raises
    ------
    FileError
        It can't be read.
    OptionError
        It has another size.
    """
    rgb = files.load(path).rgb
    if rgb.shape[:2] != size[::-1]:
        raise OptionError(
            f"reference: {printable(path)} has {rgb.shape[1]}x{rgb.shape[0]} pixels, the film {size[0]}x{size[1]}; "
            "draw it anew, or set the size"
        )
    return Reference(rgb, math.nan, math.nan, 0, 0.0, str(path))


def make_reference(
    scene: Scene, size: tuple[int, int], seconds: float, progress: Callable[[float, Progress], None]
) -> Reference:
    """Draw the truth, or take it from the cache.

    Parameters
    ----------
    scene : Scene
    size : (width, height), pixels
    seconds : float
        About how long drawing may take, compilation apart; a first rung is always drawn.
    progress : callable
        Is told the share of the time that has passed, and the event of the render.

    Returns
    -------
    Reference
        The mean of two pictures with seeds of their own. Half the RMSE between them estimates its error.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C before it is there.

    Notes
    -----
    It is drawn with ever more samples, until its error is a tenth of that of a picture of `PILOT` samples, or drawing
    it once more would take too long. What was drawn is kept in the cache, and a later call goes on from there.
    """
    path = cache_folder() / "references" / f"{scene.sha256[:24]}-{size[0]}x{size[1]}.npz"
    known = _from_cache(path, size)
    left = seconds
    while known is None or (spp := next_spp(known, left)):
        known = _rung(scene, size, START if known is None else spp, known, partial(progress, 1 - left / seconds))
        left -= known.seconds
        _keep(path, known)
    return known


def next_spp(known: Reference, seconds: float) -> int:
    """Samples per pixel of each half that the next attempt should have; 0: what is known is enough, or time is short.

    >>> known = Reference(np.zeros((1, 1, 3), np.float32), 1e-4, 2e-4, 512, 3.0, "drawn")  # wanted: 2e-5
    >>> next_spp(known, 100.0), next_spp(known, 30.0), next_spp(known, 5.0)
    (4096, 2048, 0)
    """
    half = known.spp // 2
    affordable = half * seconds / max(known.seconds, 1e-9)
    if half < PILOT:
        return STEP * half if affordable >= STEP * half else 0
    if known.enough:
        return 0
    wanted = half * (known.error * AHEAD / known.pilot) ** (1 / ORDER)
    spp = 2 ** min(math.ceil(math.log2(wanted)), math.floor(math.log2(max(affordable, 1.0))))
    return min(spp, MAX_SPP) if min(spp, MAX_SPP) > half else 0


def _rung(
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
    except (
        FileError,
        KeyError,
        TypeError,
        ValueError,
        OverflowError,
    ):  # none yet, or not one of ours: it is drawn anew
        return None


def _keep(path: Path, reference: Reference) -> None:
    with contextlib.suppress(OSError):  # where no folder can be written to, every process draws anew
        path.parent.mkdir(parents=True, exist_ok=True)
        files.save(path, reference.rgb, provenance={name: getattr(reference, name) for name in KEPT})
