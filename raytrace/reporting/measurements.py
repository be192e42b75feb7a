"""Records of what a report measured."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.reporting.configurations import Configuration
from raytrace.reporting.intervals import Interval, of_median, of_root_mean
from raytrace.reporting.precision_floor import Floor
from raytrace.reporting.spectrum import Spectrum


class Point(NamedTuple):
    """One configuration at one number of samples; time, RMSE and RMSE (sRGB) come from all repetitions."""

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
    worst_tile: float
    ssim: float
    mrse: float = float("nan")
    flip: float | None = None  # of the first repetition, as all metrics but RMSE; None: not measured
    squares: tuple[float, ...] = ()  # MSE of sRGB codes of each repetition, in the order of the seeds

    @property
    def seconds(self) -> float:
        """Time of one image: the median over the repetitions."""
        return float(np.median(self.times))

    @property
    def time(self) -> Interval:
        """95 % interval of the time."""
        return of_median(self.times)

    @property
    def error(self) -> Interval:
        """95 % interval of the RMSE (sRGB)."""
        return of_root_mean(self.squares)

    @property
    def fastest(self) -> float:
        """Minimum time over the repetitions."""
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


class Inset(NamedTuple):
    """An image of a configuration after a given time, to display beside others of the same time."""

    name: str
    spp: float
    seconds: float
    rmse_srgb: float
    rgb8: NDArray[np.uint8]  # (h, w, 3) sRGB
    error: NDArray[np.float32]  # (h, w): largest difference of a channel, sRGB


class EqualTime(NamedTuple):
    """Images of several configurations at equal time."""

    seconds: float
    windows: tuple[tuple[int, int, int], ...]  # x, y and side of square windows, pixels: where the errors are largest
    insets: tuple[Inset, ...]  # the first is the reference


class Measured(NamedTuple):
    """Results of a sweep."""

    points: tuple[Point, ...]
    firsts: tuple[First, ...]
    shown: tuple[Shown, ...]
    gaps: dict[int, float]  # spp -> RMSE (sRGB) between the two precisions with the same samples
    left_out: tuple[tuple[str, str], ...]  # what was not measured, and why
    interrupted: bool
    floor: Floor | None = None  # bias of float32
    spectra: tuple[Spectrum, ...] = ()  # of error images
    equal_time: EqualTime | None = None
