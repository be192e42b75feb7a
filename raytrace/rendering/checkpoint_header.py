"""What a checkpoint says of itself, checked: a file with a sound checksum may still hold anything."""

from typing import Any

from raytrace.errors import printable, shortened
from raytrace.rendering.job import Tiling
from raytrace.rendering.journal import parsed

ALWAYS = {"format": int, "raytrace": str, "sources": str, "scene": str}  # in the title of any version
HASHES = {"scene": "another scene", "sources": "other sources of raytrace"}
LARGEST = 1 << 62  # of the numbers of a layout


def is_one(title: Any, mine: dict[str, Any]) -> bool:
    """Whether this is the title of a checkpoint: of this version as it writes them, of another as far as is known.

    Parameters
    ----------
    title : JSON types
    mine : dict
        Which picture is drawn.
    """
    picture = title.get("picture") if isinstance(title, dict) else None
    if not isinstance(picture, dict) or any(type(picture.get(key)) is not kind for key, kind in ALWAYS.items()):
        return False
    if any(picture[key] != mine[key] for key in ("format", "raytrace", "sources")):
        return True
    return picture.keys() == mine.keys() and all(_alike(picture[key], mine[key]) for key in mine)


def _alike(value: Any, other: Any) -> bool:
    """Whether two values of a title are of the same kind."""
    if isinstance(other, list):
        return isinstance(value, list) and len(value) == len(other) and all(map(_alike, value, other))
    if other is None or isinstance(other, float):  # an error may be wanted, or none
        return value is None or type(value) in (int, float)
    return type(value) is type(other)


def differences(mine: dict[str, Any], other: dict[str, Any]) -> str:
    """What two pictures don't have in common, in words."""
    names = [name for name in mine if mine[name] != other.get(name)]
    told = {name: shortened(printable(other.get(name))) for name in names}
    return ", ".join(HASHES.get(name) or f"{name} {told[name]}, not {mine[name]}" for name in names)


def layout_of(content: bytes | None, spp: int) -> Tiling | None:
    """The layout that a record holds, of a picture with so many samples; None where it holds none."""
    found = parsed(content or b"")
    if not isinstance(found, dict) or found.keys() != set(Tiling._fields):
        return None
    layout = Tiling(**found)
    if any(type(number) is not int or not 0 <= number <= LARGEST for number in layout):
        return None
    return layout if (layout.first or 0) <= spp and layout.leap >= 2 else None
