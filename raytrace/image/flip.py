"""FLIP and HDR-FLIP: how visible the difference is when a person switches between two images; by flip-evaluator.

Every function takes linear light. LDR-FLIP [Andersson2020] gets what a screen shows: sRGB codes, clipped to 0..1.
HDR-FLIP [Andersson2021] gets the light itself, from 0 on, and shows both images at several exposures.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError
from raytrace.image.files import LUMINANCE, srgb_encode

PIXELS_PER_DEGREE = 67.0206  # of visual angle: 3840 pixels on 0.7 m, seen from 0.7 m, as in [Andersson2020]
DARKEST = 1e-6  # luminance: HDR-FLIP has no exposure for a reference that is darker than this everywhere
INSTALL = "pip install flip-evaluator"
MISSING = f"flip, hdr_flip: not measured, because flip-evaluator is not installed: {INSTALL}"


def available() -> bool:
    """Whether flip-evaluator is installed; does not import it."""
    return find_spec("flip_evaluator") is not None


def required(what: str) -> None:
    """Raise an error that says what to install, if flip-evaluator is not installed.

    Raises
    ------
    OptionError
        The message begins with ``what``.
    """
    if not available():
        raise OptionError(f"{what}: needs flip-evaluator: {INSTALL}")


def flip_map(image: NDArray[np.floating], reference: NDArray[np.floating]) -> NDArray[np.float32]:
    """LDR-FLIP of each pixel, (h, w), of two (h, w, 3) images in linear light: 0 equal, 1 the largest difference.

    Both are clipped to 0..1 and encoded as sRGB, as a screen shows them.
    """
    codes = [srgb_encode(np.clip(light, 0.0, 1.0)) for light in (reference, image)]
    return _evaluate(codes[0], codes[1], "LDR", True)


def hdr_flip_map(image: NDArray[np.floating], reference: NDArray[np.floating]) -> NDArray[np.float32]:
    """HDR-FLIP of each pixel, (h, w): the largest LDR-FLIP of all exposures, tone mapped by ACES.

    Negative light counts as 0. The exposures depend on the reference: the first shows its brightest pixel, the last its
    median. Where all of it is darker than ``DARKEST``, there is no exposure: 0 where the images are equal, else NaN.
    """
    largest = np.finfo(np.float32).max
    shown, truth = (np.clip(light, 0.0, largest) for light in (image, reference))
    if (truth @ LUMINANCE).max() < DARKEST:
        return np.where((shown == truth).all(axis=2), np.float32(0), np.float32(np.nan))
    return _evaluate(truth, shown, "HDR", False)


def flip(image: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Mean of ``flip_map``, the single number that the authors recommend."""
    return _mean(flip_map(image, reference))


def hdr_flip(image: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Mean of ``hdr_flip_map``."""
    return _mean(hdr_flip_map(image, reference))


def _mean(each: NDArray[np.float32]) -> float:
    return float(each.mean(dtype=np.float64))  # flip-evaluator adds in float32


def _evaluate(reference: NDArray[Any], image: NDArray[Any], kind: str, srgb: bool) -> NDArray[np.float32]:
    required("FLIP")
    import flip_evaluator  # an extra

    arrays = [np.ascontiguousarray(array, np.float32) for array in (reference, image)]
    options = {"inputsRGB": srgb, "applyMagma": False, "parameters": {"ppd": PIXELS_PER_DEGREE}}
    each, _, _ = flip_evaluator.evaluate(*arrays, kind, **options)
    return np.array(each[:, :, 0])
