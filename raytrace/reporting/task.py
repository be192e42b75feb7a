"""One point while it is measured: the times and errors of its renders."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image import flip
from raytrace.image.metrics import Comparison, compare, screen
from raytrace.reporting.configurations import renders_of
from raytrace.reporting.measurements import Point


class Truth:
    """The reference image, in linear light and as sRGB codes."""

    def __init__(self, rgb: NDArray[np.floating]) -> None:
        self.rgb, self.codes = rgb, screen(rgb)


class Task:
    """One point during measurement."""

    def __init__(self, scene: Any, step: float, peak: int) -> None:
        self.scene, self.step, self.peak = scene, step, peak
        self.renders = renders_of(scene.configuration, step)
        self.times: list[float] = []  # s
        self.linear: list[float] = []  # MSE of each render, radiance
        self.squares: list[float] = []  # MSE of each render, sRGB codes
        self.comparison: Comparison | None = None  # of the first render
        self.judging = 0.0  # s: to measure the errors of a later render
        self.error: NDArray[np.float64] | None = None  # of the last render, if its spectrum is measured
        self.rays, self.spp = 0, 0.0
        self.flip: float | None = None

    @property
    def name(self) -> str:
        """Name of the point."""
        way = self.scene.configuration
        return f"{way.name}, " + (f"target error {self.step:g}" if way.adaptive else f"{self.step:g} spp")

    @property
    def remaining(self) -> float:
        """Estimated seconds for the remaining renders."""
        return (self.renders - len(self.times)) * (self.times[0] + self.judging)

    def add(self, image: Any, seconds: float, truth: Truth) -> NDArray[np.float64]:
        """Add a render; return its error, (h, w, 3), in sRGB codes. All metrics are of the first, the RMSE of all."""
        self.times.append(seconds)
        began = time.perf_counter()
        codes: NDArray[np.float64] = screen(image.rgb) - truth.codes
        codes[~np.isfinite(codes)] = 0.0
        self.linear.append(mean_square(image.rgb - truth.rgb))
        self.squares.append(mean_square(codes))
        self.judging = time.perf_counter() - began
        if self.comparison is None:
            self.comparison = compare(image.rgb, truth.rgb, flip=False)
            self.flip = flip.flip(image.rgb, truth.rgb) if flip.available() else None
            self.rays = sum(image.stats["rays"].values())
            self.spp = image.stats["samples"] / image.rgb[..., 0].size
        return codes

    def point(self) -> Point:
        """Combine the renders."""
        first = self.comparison
        assert first is not None  # a task is kept after its first render
        return Point(
            configuration=self.scene.configuration,
            step=self.step,
            spp=self.spp,
            times=tuple(self.times),
            rays=self.rays,
            peak_bytes=self.peak,
            rmse=float(np.sqrt(np.mean(self.linear))),
            rmse_srgb=float(np.sqrt(np.mean(self.squares))),
            relative_mse=first.relative_mse,
            bias=first.bias,
            worst_tile=first.worst_tile,
            ssim=first.ssim,
            mrse=first.mrse,
            flip=self.flip,
            squares=tuple(self.squares),
        )


def mean_square(difference: NDArray[np.floating]) -> float:
    """Mean square over the values of pixels that are finite; NaN if none is.

    >>> mean_square(np.array([[[1.0, 2.0, 2.0], [np.nan, 0.0, 0.0]]]))
    3.0
    """
    good = np.isfinite(difference).all(axis=2)
    with np.errstate(over="ignore"):
        squares = np.asarray(difference, np.float64) ** 2
    return float(np.mean(squares if good.all() else squares[good])) if good.any() else float("nan")
