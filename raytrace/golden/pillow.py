"""Images of Pillow, of any mode, to sRGB codes, or to floats where the mode holds those."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image.read_png import check_profile

__tracebackhide__ = True  # as in check.py
GREY = ("1", "L")
SOLID = ("RGB", "RGBX", "CMYK", "YCbCr", "HSV")  # without an alpha, converted to RGB as Pillow does
WITH_ALPHA = ("P", "PA", "LA", "La", "RGBA", "RGBa")  # or perhaps with one
TO_STRAIGHT = {"La": "LA", "RGBa": "RGBA"}  # from colours that are multiplied by their alpha


def is_pillow(image: Any) -> bool:
    """Whether it is an image of Pillow; if Pillow isn't imported, nothing is."""
    pillow = sys.modules.get("PIL.Image")
    return pillow is not None and isinstance(image, pillow.Image)


def to_codes(image: Any, told: bool) -> NDArray[Any]:
    """Codes of an image: (h, w, 3) or (h, w, 4) uint8, sRGB; or the numbers of mode F, (h, w) float32.

    Parameters
    ----------
    image : PIL.Image.Image
    told : bool
        Whether the caller says what its numbers mean: those of mode F may be light, or codes up to 255.

    Raises
    ------
    ValueError
        The mode doesn't tell what its numbers mean, or has more than 8 bits.
    """
    mode = image.mode
    if mode.startswith("I") or _sixteen_bits(image):
        raise ValueError(f"picture: 16 or 32 bits a channel (mode {mode}): hand over an array of floats")
    if mode == "F" and not told:
        raise ValueError("picture: mode F: say which encoding it has, 'linear' or 'srgb', 0 to 1")
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
    raise ValueError(f"picture: mode {mode}: convert it to RGB first")


def _sixteen_bits(image: Any) -> bool:
    """Whether a file that is not read yet has 16 bits a channel, of which Pillow drops 8."""
    return any(";16" in str(tile[3]) for tile in getattr(image, "tile", ()))


def _from_lab(image: Any) -> Any:
    try:
        from PIL import ImageCms

        lab, srgb = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
        return ImageCms.profileToProfile(image, lab, srgb, outputMode="RGB")
    except ImportError:  # Pillow was built without it
        raise ValueError("picture: mode LAB: convert it to RGB first") from None
