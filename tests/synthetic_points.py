"""Points of a sweep whose errors and times are formulas."""

from collections.abc import Callable

from raytrace.reporting.configurations import Configuration
from raytrace.reporting.measurements import Point

SOBOL, STRATIFIED, DOUBLE = (
    Configuration("sobol", "float32"),
    Configuration("stratified", "float32"),
    Configuration("sobol", "float64"),
)


def point(way: Configuration, spp: float, seconds: float, error: float) -> Point:
    """Six renders, whose median time is `seconds`, without scatter of the error."""
    times = (seconds,) * 4 + (seconds / 2, 2 * seconds)
    bias = (error / 10, -error / 5, 0.0)
    return Point(
        way,
        spp,
        spp,
        times,
        int(2000 * spp),
        1_000_000,
        2 * error,
        error,
        error**2,
        bias,
        0.1,
        0.9,
        squares=(error**2,) * 6,
    )


def curve(
    way: Configuration, error: Callable[[float], float], seconds: float, steps: tuple[int, ...] = (1, 4, 16, 64)
) -> list:
    """Points at `steps` samples per pixel; `seconds` is the time of a sample."""
    return [point(way, spp, seconds * spp, error(spp)) for spp in steps]
