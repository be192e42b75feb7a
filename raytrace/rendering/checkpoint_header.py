"""Checks of a checkpoint's title and tiling: a file with a correct checksum can still contain anything."""

from typing import Any

from raytrace.errors import printable, shortened
from raytrace.rendering.job import Tiling
from raytrace.rendering.journal import parsed

ALWAYS = {"format": int, "raytrace": str, "sources": str, "scene": str}  # in the title of any version
HASHES = {"scene": "another scene", "sources": "another version of the code"}
LARGEST = 1 << 62  # of the numbers of a tiling


def is_one(title: Any, mine: dict[str, Any]) -> bool:
    """Whether this is the title of a checkpoint: complete for this version, the common fields for another version.

    Parameters
    ----------
    title : JSON types
    mine : dict
        Title of the image that is rendered.
    """
    image = title.get("picture") if isinstance(title, dict) else None
    if not isinstance(image, dict) or any(type(image.get(key)) is not kind for key, kind in ALWAYS.items()):
        return False
    if any(image[key] != mine[key] for key in ("format", "raytrace", "sources")):
        return True
    return image.keys() == mine.keys() and all(_alike(image[key], mine[key]) for key in mine)


def _alike(value: Any, other: Any) -> bool:
    """Whether two values of a title have the same type."""
    if isinstance(other, list):
        return isinstance(value, list) and len(value) == len(other) and all(map(_alike, value, other))
    if other is None or isinstance(other, float):  # the target error, or None
        return value is None or type(value) in (int, float)
    return type(value) is type(other)


def differences(mine: dict[str, Any], other: dict[str, Any]) -> str:
    """Say in what two images differ."""
    names = [name for name in mine if mine[name] != other.get(name)]
    text = {name: shortened(printable(other.get(name))) for name in names}
    return ", ".join(HASHES.get(name) or f"{name} {text[name]}, not {mine[name]}" for name in names)


def tiling_of(content: bytes | None, spp: int) -> Tiling | None:
    """Return the tiling that a record contains, for an image with so many samples; None if it contains none."""
    found = parsed(content or b"")
    if not isinstance(found, dict) or found.keys() != set(Tiling._fields):
        return None
    tiling = Tiling(**found)
    if any(type(number) is not int or not 0 <= number <= LARGEST for number in tiling):
        return None
    return tiling if (tiling.first or 0) <= spp and tiling.leap >= 2 else None
