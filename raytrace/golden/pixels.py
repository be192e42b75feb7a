"""Pictures of any kind to linear light."""

import os
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raytrace.golden.pillow import is_pillow, to_codes
from raytrace.image.files import load, srgb_decode

Encoding = Literal["linear", "srgb"] | None
__tracebackhide__ = True  # as in check.py


def to_light(picture: Any, encoding: Encoding = None) -> NDArray[np.float64]:
    """Linear light of a picture: (h, w, 3).

    Parameters
    ----------
    picture : Render, path, or array
        Paths end in .png, .exr or .npz. Arrays are (h, w), (h, w, 1), (h, w, 3) or (h, w, 4) with an alpha of 1, or
        what ``numpy.asarray`` turns into one. Images of Pillow are converted to RGB: sRGB codes; those
        of mode F are floats whose encoding has to be given.
    encoding : {"linear", "srgb"}, optional
        What the numbers of an array mean. Default: floats are linear light, uint8 are sRGB codes 0 .. 255. Said of
        floats, "srgb" means codes 0 .. 1; said of uint8, "linear" means 255 times linear light.

    Raises
    ------
    ValueError
        It is no picture, or has an alpha below 1, or has a type that doesn't tell what its numbers mean.
    FileError
        A file can't be read, or has an alpha below 1.
    """
    if encoding not in (None, "linear", "srgb"):
        raise ValueError(f"encoding: expected 'linear' or 'srgb', got {encoding!r}")
    if isinstance(picture, str | os.PathLike):
        if encoding is not None:
            raise ValueError(f"encoding: {picture}: a file says itself what it holds; leave the encoding out")
        return load(picture).rgb.astype(np.float64)
    array = (
        to_codes(picture, encoding is not None) if is_pillow(picture) else np.asarray(getattr(picture, "rgb", picture))
    )
    if array.dtype.kind == "f":
        light = array.astype(np.float64)
        return _colour(srgb_decode(light) if encoding == "srgb" else light, light, 1.0)
    if array.dtype == np.uint8:
        return _colour(array / 255.0 if encoding == "linear" else srgb_decode(array / 255.0), array, 255)
    raise ValueError(
        f"picture: expected floats or uint8, got {array.dtype.name}: convert it, and say which encoding it has"
    )


def _colour(light: NDArray[np.float64], given: NDArray[Any], opaque: float) -> NDArray[np.float64]:
    """Three channels of a picture of any number of them; ``given`` has its alpha."""
    if light.ndim == 2:
        light = light[:, :, None]
    if light.ndim != 3 or light.shape[2] not in (1, 3, 4) or light.size == 0:
        raise ValueError(f"picture: expected shape (height, width, 3), got {given.shape}")
    if light.shape[2] == 4:
        if not (given[:, :, 3] == opaque).all():
            raise ValueError("picture: has an alpha below 1: put it on a background first")
        light = light[:, :, :3]
    return np.ascontiguousarray(np.broadcast_to(light, (*light.shape[:2], 3)))
