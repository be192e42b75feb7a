"""What the readers of image files share: the bytes of a file, its limits, and the texts that it carries."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from raytrace.errors import printable, shortened
from raytrace.files import open_regular
from raytrace.image.files import KEY
from raytrace.limits import MAX_PIXELS
from raytrace.memory import Allowance

POINTER = b"version https://git-lfs.github.com/spec/"  # what Git keeps in place of a large file
TRANSPARENT = "has an alpha below 1: put the picture on a background first"


class RefusedError(ValueError):
    """An image that there is no room for, or that is none of those that can be read."""


class NoMemoryError(RefusedError):
    """A picture that there is not enough memory for."""


def content(path: Path) -> bytes:
    """Content of an image file, if it is a regular file and not too large."""
    with open_regular(path, "an image") as stream:
        size = os.fstat(stream.fileno()).st_size
        afford(1, size)
        data = stream.read(size)
    if data.startswith(POINTER):
        raise RefusedError("a Git LFS pointer; fetch the file: git lfs pull")
    return data


def afford(pixels: int, each: float) -> None:
    """Refuse an image that is too large, before anything is made of it; each: bytes a pixel."""
    if pixels > MAX_PIXELS:
        raise RefusedError(f"it has {pixels:,} pixels; at most {MAX_PIXELS:,}")
    if lacks := Allowance().lacks(pixels * each, "scale it down"):
        raise NoMemoryError(lacks.partition(", or ")[0])


def from_texts(texts: Mapping[Any, Any]) -> dict[str, Any]:
    """Provenance from the texts of a PNG or EXR."""
    ours = {str(key): text for key, text in texts.items() if isinstance(text, str) and str(key).startswith(KEY)}
    return {key.removeprefix(KEY): from_json(text, key) for key, text in ours.items()}


def from_json(text: str, key: str) -> Any:
    """The value that a text holds."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise RefusedError(f"its text {shortened(printable(key))} is no JSON; remove it") from None
