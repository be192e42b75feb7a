"""Rules of the scene format about one value that JSON Schema has no words for."""

from typing import Any

from raytrace.limits import MAX_PIXELS, MAX_SIDE


def check_film(size: tuple[int, int]) -> tuple[int, int]:
    """Refuse a film that is too large."""
    width, height = size
    if max(size) > MAX_SIDE or width * height > MAX_PIXELS:
        limits = f"a side has at most {MAX_SIDE} pixels and a film at most {MAX_PIXELS}"
        raise ValueError(f"a film of {width} x {height} pixels is too large; {limits}")
    return size


def spread_number(scale: Any) -> Any:
    """Take one number for all three axes."""
    number = isinstance(scale, int | float) and not isinstance(scale, bool)
    return (scale, scale, scale) if number else scale


def check_scale(scale: tuple[float, float, float]) -> tuple[float, float, float]:
    """Refuse a scale that leaves no surface."""
    if 0 in scale:
        raise ValueError("a scale of 0 leaves no surface; use a number other than 0 for each axis")
    return scale
