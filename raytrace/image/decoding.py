"""Functions shared by the readers of image files: content, size limits and provenance texts."""

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

POINTER = b"version https://git-lfs.github.com/spec/"  # Git LFS stores this text in place of a large file
TRANSPARENT = "has an alpha below 1: put the image on a background first"


class RefusedError(ValueError):
    """The image is too large, or of a kind that is not supported."""


class NoMemoryError(RefusedError):
    """There is not enough memory for the image."""


def content(path: Path, max_memory: int | None = None) -> bytes:
    """Content of an image file; an error if it is not a regular file, or too large."""
    with open_regular(path, "an image") as stream:
        size = os.fstat(stream.fileno()).st_size
        check_size(1, size, max_memory)
        data = stream.read(size)
    if data.startswith(POINTER):
        raise RefusedError("a Git LFS pointer; fetch the file: git lfs pull")
    return data


def check_size(pixels: int, bytes_per_pixel: float, max_memory: int | None = None) -> None:
    """Raise an error for an image that is too large, before memory is allocated for it.

    ``max_memory`` limits the whole process, bytes; by default the free memory does.
    """
    if pixels > MAX_PIXELS:
        raise RefusedError(f"it has {pixels:,} pixels; at most {MAX_PIXELS:,}")
    if lacks := Allowance(max_memory).lacks(pixels * bytes_per_pixel, "scale it down"):
        raise NoMemoryError(lacks.partition(", or ")[0])


def from_texts(texts: Mapping[Any, Any]) -> dict[str, Any]:
    """Provenance from the texts of a PNG or EXR file."""
    ours = {str(key): text for key, text in texts.items() if isinstance(text, str) and str(key).startswith(KEY)}
    return {key.removeprefix(KEY): from_json(text, key) for key, text in ours.items()}


def from_json(text: str, key: str) -> Any:
    """Value of a JSON text."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise RefusedError(f"its text {shortened(printable(key))} is not valid JSON; remove it") from None
