"""Convert images of any type to linear light."""

import os
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError, SceneError, printable
from raytrace.golden.pillow import is_pillow, to_codes
from raytrace.image.files import load, srgb_decode
from raytrace.image.texels import ENCODED, read_texels, srgb_table

Encoding = Literal["linear", "srgb"] | None
__tracebackhide__ = True  # as in check.py


def to_light(image: Any, encoding: Encoding = None) -> NDArray[np.float64]:
    """Linear light of an image: (h, w, 3).

    Parameters
    ----------
    image : Render, path, or array
        Paths end in .png, .jpg, .jpeg, .exr or .npz; a PNG has 8 or 16 bits per channel. Arrays are (h, w), (h, w, 1),
        (h, w, 3) or (h, w, 4) with an alpha of 1, or anything that ``numpy.asarray`` converts to one. Pillow images are
        converted to RGB in sRGB codes; in mode F the values are floats, and the encoding must be given.
    encoding : {"linear", "srgb"}, optional
        Meaning of the values of an array. Default: floats are linear light, uint8 are sRGB codes 0 .. 255. For
        floats, "srgb" means codes 0 .. 1; for uint8, "linear" means 255 times linear light.

    Raises
    ------
    ValueError
        It is not an image, or has an alpha below 1, or a type whose meaning is unclear.
    FileError
        A file can't be read, or has an alpha below 1.
    """
    if encoding not in (None, "linear", "srgb"):
        raise ValueError(f"encoding: expected 'linear' or 'srgb', got {encoding!r}")
    if isinstance(image, str | os.PathLike):
        if encoding is not None:
            raise ValueError(f"encoding: {image}: a file defines its own encoding; omit the argument")
        return _of_file(Path(image))
    array = to_codes(image, encoding is not None) if is_pillow(image) else np.asarray(getattr(image, "rgb", image))
    if array.dtype.kind == "f":
        light = array.astype(np.float64)
        return _colour(srgb_decode(light) if encoding == "srgb" else light, light, 1.0)
    if array.dtype == np.uint8:
        return _colour(array / 255.0 if encoding == "linear" else srgb_decode(array / 255.0), array, 255)
    raise ValueError(f"image: expected floats or uint8, got {array.dtype.name}: convert it, and pass its encoding")


def _of_file(path: Path) -> NDArray[np.float64]:
    """Linear light of a file."""
    suffix = path.suffix.lower()
    if suffix not in (".jpg", ".jpeg") and not (suffix == ".png" and _sixteen_bits(path)):
        return load(path).rgb.astype(np.float64)
    try:
        texels = read_texels(path, srgb=True)
    except SceneError as error:
        raise FileError(str(error).replace(f", {ENCODED}", "")) from None
    if texels.warning:
        raise FileError(f"{printable(path)}: has an alpha below 1: put it on a background first")
    light: NDArray[np.float64] = srgb_table(8 * texels.codes.dtype.itemsize)[texels.codes]
    return light


def _sixteen_bits(path: Path) -> bool:
    """Whether a PNG has 16 bits per channel; False for what is no PNG."""
    try:
        with path.open("rb") as file:
            head = file.read(25)
    except OSError:
        return False  # the reader says why
    return head[:4] == b"\x89PNG" and head[24:] == b"\x10"


def _colour(light: NDArray[np.float64], given: NDArray[Any], opaque: float) -> NDArray[np.float64]:
    """Convert an image to three channels; ``given`` has its alpha."""
    if light.ndim == 2:
        light = light[:, :, None]
    if light.ndim != 3 or light.shape[2] not in (1, 3, 4) or light.size == 0:
        raise ValueError(f"image: expected shape (height, width, 3), got {given.shape}")
    if light.shape[2] == 4:
        if not (given[:, :, 3] == opaque).all():
            raise ValueError("image: has an alpha below 1: put it on a background first")
        light = light[:, :, :3]
    return np.ascontiguousarray(np.broadcast_to(light, (*light.shape[:2], 3)))
