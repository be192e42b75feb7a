"""Convert Pillow images of any mode to sRGB codes, or to floats for mode F."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image.read_png import check_profile

__tracebackhide__ = True  # as in check.py
GREY = ("1", "L")
SOLID = ("RGB", "RGBX", "CMYK", "YCbCr", "HSV")  # without alpha, converted to RGB by Pillow
WITH_ALPHA = ("P", "PA", "LA", "La", "RGBA", "RGBa")  # with alpha, or possibly so
TO_STRAIGHT = {"La": "LA", "RGBa": "RGBA"}  # from premultiplied alpha


def is_pillow(image: Any) -> bool:
    """Whether it is a Pillow image; does not import Pillow."""
    pillow = sys.modules.get("PIL.Image")
    return pillow is not None and isinstance(image, pillow.Image)


def to_codes(image: Any, has_encoding: bool) -> NDArray[Any]:
    """SRGB codes of an image, (h, w, 3) or (h, w, 4) uint8; or the values of mode F, (h, w) float32.

    Parameters
    ----------
    image : PIL.Image.Image
    has_encoding : bool
        Whether the caller gives the encoding; mode F needs it: its values may be light, or codes up to 255.

    Raises
    ------
    ValueError
        The meaning of the values is unclear, or they have more than 8 bits.
    """
    mode = image.mode
    if mode.startswith("I") or _sixteen_bits(image):
        raise ValueError(f"image: 16 or 32 bits per channel (mode {mode}): pass an array of floats")
    if mode == "F" and not has_encoding:
        raise ValueError("image: mode F: pass encoding='linear' or 'srgb', values 0 to 1")
    if mode == "F":
        return np.asarray(image)
    if mode == "LAB":
        return np.asarray(_from_lab(image))
    if image.info.get("icc_profile"):
        check_profile(image)
    transparent = "transparency" in image.info
    if mode in GREY + SOLID and not transparent:
        return np.asarray(image.convert("RGB"))
    if mode in (*GREY, "RGB", *WITH_ALPHA):
        return np.asarray(image.convert(TO_STRAIGHT.get(mode, mode)).convert("RGBA"))
    raise ValueError(f"image: mode {mode}: convert it to RGB first")


def _sixteen_bits(image: Any) -> bool:
    """Whether an unread file has 16 bits per channel, of which Pillow drops 8."""
    return any(";16" in str(tile[3]) for tile in getattr(image, "tile", ()))


def _from_lab(image: Any) -> Any:
    try:
        from PIL import ImageCms

        lab, srgb = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
        return ImageCms.profileToProfile(image, lab, srgb, outputMode="RGB")
    except ImportError:  # Pillow was built without it
        raise ValueError("image: mode LAB: convert it to RGB first") from None
