"""How long a picture will take, and the passes over the whole film in which it is drawn if that is long.

A picture that is drawn in passes is there as a whole after the first of them, with few samples, and then with ever
more: Ctrl-C and a time limit leave an image without black parts. The bits are the same: a pixel's samples are summed in
their order, in one pass or in many.
"""

import math
import time

import numpy as np

from raytrace.accel.lanes import PACKET
from raytrace.rendering.film_tiles import FilmTiles, blank
from raytrace.rendering.threads import RenderThreads
from raytrace.rendering.wavefront import BATCH

LONG = 2.0  # seconds from which on a picture is drawn in passes
FIRST = 0.25  # seconds that the first pass should take at least; each pass costs some 60 ns a pixel
LEAST = 1 << 20  # samples of a picture that may take so long: on two cores of 2020 it takes 0.01 to 1 s
LEAP = 8  # by how much a pass may multiply the samples, while they are few: fewer passes cost less
SPOTS, SAMPLES = 16, 4  # places of the film where samples are drawn to see how long they take; of each pixel there


def first_pass(spp: int, seconds: float) -> int:
    """Samples of each pixel in the first pass, a power of two, or 0: all at once.

    Parameters
    ----------
    spp : int
        Samples of each pixel in all.
    seconds : float
        That they are expected to take.

    >>> first_pass(64, 1.9), first_pass(64, 5.0), first_pass(200, 9.0), first_pass(8, 3600.0)
    (0, 4, 8, 1)
    """
    if seconds <= LONG:
        return 0
    return 1 << max(0, math.ceil(math.log2(spp * FIRST / seconds)))


def expected(crew: RenderThreads, canvas: FilmTiles, spp: int, threads: int) -> float:
    """Seconds that so many samples of each pixel will take; 0 where they are too few for it to matter."""
    samples = len(canvas.at) * spp
    if samples < LEAST:
        return 0.0
    seconds = 0.0
    for pixels in (BATCH // SPOTS // SAMPLES // 4, BATCH // SPOTS // SAMPLES):
        seconds = min(_timed(crew, canvas, pixels, min(SAMPLES, spp)) for _ in range(2)) * samples / threads
        if seconds <= LONG:  # few samples at a time are slower than many
            break
    return seconds


def _timed(crew: RenderThreads, canvas: FilmTiles, pixels: int, samples: int) -> float:
    """Seconds for a sample, of so many neighbours in each of the spots; what is drawn is dropped."""
    spots = np.linspace(0, max(len(canvas.at) - pixels, 0), SPOTS).astype(int) // PACKET * PACKET
    sheet = blank(*canvas.places(np.minimum(spots[:, None] + np.arange(pixels), len(canvas.at) - 1).ravel()))
    began = time.perf_counter()
    crew.draw(sheet, 0, samples)
    seconds = time.perf_counter() - began
    crew.forget()
    return seconds / (len(sheet.x) * samples)
