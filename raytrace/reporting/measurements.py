"""Records of what a report measured."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.configurations import Configuration


class Point(NamedTuple):
    """One configuration at one number of samples; errors are averaged over the repetitions."""

    configuration: Configuration
    step: float  # samples per pixel, or the target error of adaptive sampling
    spp: float  # samples per pixel, averaged over the film
    times: tuple[float, ...]  # s, of each repetition
    rays: int  # of all types, of one image
    peak_bytes: int  # peak of allocated memory during a render, with the tree
    rmse: float  # as in `Comparison`; root of the mean of the squares
    rmse_srgb: float
    relative_mse: float
    bias: tuple[float, float, float]
    worst_tile: float  # the largest of all repetitions
    ssim: float
    mrse: float = float("nan")
    flip: float | None = None  # of the first repetition; None: not measured

    @property
    def seconds(self) -> float:
        """Time of one image: the minimum over the repetitions, because other processes can only add to it."""
        return min(self.times)

    @property
    def rays_per_second(self) -> float:
        """Rays of all types per second."""
        return self.rays / self.seconds

    @property
    def efficiency(self) -> float:
        """1 / (MSE x seconds), with the MSE of sRGB codes: quality per unit of time."""
        return 1.0 / (self.rmse_srgb**2 * self.seconds) if self.rmse_srgb else float("inf")


class First(NamedTuple):
    """The first image of a configuration: includes compilation or loading of kernels, and the tree."""

    configuration: Configuration
    seconds: float
    compile_seconds: float
    again: float  # s: the same image rendered again
    peak_bytes: int  # peak of allocated memory until then, with the tree


class Shown(NamedTuple):
    """An image to display on the page."""

    name: str
    rgb8: NDArray[np.uint8]  # (h, w, 3) sRGB
    error: NDArray[np.float32] | None  # (h, w): largest difference of a channel, sRGB; None: the reference


class Measured(NamedTuple):
    """Results of a sweep."""

    points: tuple[Point, ...]
    firsts: tuple[First, ...]
    shown: tuple[Shown, ...]
    gaps: dict[int, float]  # spp -> RMSE (sRGB) between the two precisions with the same samples
    left_out: tuple[tuple[str, str], ...]  # what was not measured, and why
    interrupted: bool
