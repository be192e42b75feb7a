"""What callers may ask of a render, checked before anything is done."""

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np

from raytrace.errors import OptionError
from raytrace.limits import LAYERS, MAX_PIXELS, MAX_SEED, MAX_SIDE, MAX_SPP
from raytrace.records import Settings, Window


def _integer(name: str, value: Any) -> int:
    """Turn a whole number of any type into Python's."""
    if not isinstance(value, bool):
        try:
            return operator.index(value)
        except TypeError:
            pass
    raise OptionError(f"{name}: expected a whole number, got {value!r}")


def within(name: str, value: Any, low: int, high: int) -> int:
    """Check a whole number of any type; it becomes Python's."""
    number = _integer(name, value)
    if not low <= number <= high:
        raise OptionError(f"{name}: expected a number from {low} to {high}, got {number}")
    return number


def _size(value: Any) -> tuple[int, int]:
    if not isinstance(value, Sequence | np.ndarray) or len(value) != 2:
        raise OptionError(f"size: expected (width, height), got {value!r}")
    width, height = _integer("size", value[0]), _integer("size", value[1])
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        raise OptionError(f"size: {width}x{height} is outside 1x1 .. {MAX_PIXELS:,} pixels, {MAX_SIDE:,} a side")
    return width, height


CHOICES = {
    "precision": ("auto", "float32", "float64"),
    "sampler": ("sobol", "stratified", "independent"),
    "integrator": ("direct", "path"),
}


def override(
    settings: Settings, spp: Any, size: Any, seed: Any, precision: Any, sampler: Any, *, integrator: Any = None
) -> Settings:
    """The scene's settings, with the caller's in their place where they are not None; checked."""
    given = {"spp": spp, "size": size, "seed": seed, "precision": precision, "sampler": sampler}
    given["integrator"] = integrator
    settings = settings._replace(**{name: value for name, value in given.items() if value is not None})
    for name, allowed in CHOICES.items():
        if getattr(settings, name) not in allowed:
            raise OptionError(f"{name}: expected one of {', '.join(allowed)}, got {getattr(settings, name)!r}")
    return settings._replace(
        spp=within("spp", settings.spp, 1, MAX_SPP),
        seed=within("seed", settings.seed, 0, MAX_SEED),
        size=_size(settings.size),
    )


def window_of(size: tuple[int, int], crop: tuple[int, int, int, int] | None) -> Window:
    """Make the part of the film that is drawn: the crop, or all of it."""
    window = Window(*(_integer("crop", number) for number in crop or (0, 0, *size)))
    inside = (
        window.x >= 0 and window.y >= 0 and window.x + window.width <= size[0] and window.y + window.height <= size[1]
    )
    if not inside or window.width < 1 or window.height < 1:
        raise OptionError(f"crop: {','.join(map(str, window))} is not a part of the film of {size[0]}x{size[1]} pixels")
    return window


def layers_of(aov: Sequence[str]) -> tuple[str, ...]:
    """Check names of layers; one alone may be a plain string."""
    names = (aov,) if isinstance(aov, str) else tuple(aov)
    for name in names:
        if name not in LAYERS:
            raise OptionError(f"aov: {name!r}: expected some of {', '.join(LAYERS)}")
    return names


def deadline_after(time_limit: float | None) -> float:
    """Seconds that a render may take; inf for no limit."""
    if time_limit is None:
        return float("inf")
    if not time_limit >= 0:
        raise OptionError(f"time_limit: expected seconds, at least 0, got {time_limit!r}")
    return time_limit


def error_wanted(target_error: float | None) -> float | None:
    """Check the error that a picture is to have."""
    if target_error is not None and not 0 < target_error < 1:
        raise OptionError(f"target_error: expected an RMSE in sRGB, above 0 and below 1, got {target_error!r}")
    return target_error
