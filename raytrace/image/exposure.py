"""The exposure of images as 8-bit codes: chosen by a fixed rule, and hints where it fits an image badly."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

AUTO = "auto"
Exposure = float | Literal["auto"]
MAX_STOPS = 100.0  # limit of |exposure|: 2**100 is almost the largest float32
PERCENTILE = 0.95  # of the pixels that are not black
MIDDLE = 0.5  # what that percentile becomes: one stop below white
DARK = 0.02  # an image whose percentile is below this is nearly black: code 39 of 255
CLIPPED, MUCH = 1.1, 0.2  # pixels above CLIPPED are visibly clipped; a hint from this share of them on


def auto_exposure(rgb: ArrayLike) -> float:
    """Return the exposure, in stops, at which an image is shown well; 0 where all of it is black.

    Parameters
    ----------
    rgb : (h, w, 3) array of float
        Linear radiance.

    Returns
    -------
    float
        From -100 to 100, rounded to hundredths, so that it can be typed.

    Notes
    -----
    The value of a pixel is its largest channel. The 95th percentile (nearest rank) of the pixels that are not black
    becomes 0.5. So at least 95 % of the lit pixels are at least one stop below white, and a surface may be twice as
    bright as these before it clips. Lamps, highlights and outliers of noise do not count, as long as they are less than
    5 % of the lit pixels. The result is a function of the image alone, so it does not depend on threads either.

    Examples
    --------
    >>> auto_exposure([[[0.25, 0.1, 0.0], [0.0, 0.0, 0.0]]])
    1.0
    """
    level = bright_level(rgb)
    if level == 0:
        return 0.0
    return float(np.clip(np.round(np.log2(MIDDLE / level), 2), -MAX_STOPS, MAX_STOPS)) + 0.0


def bright_level(rgb: ArrayLike) -> float:
    """Return the 95th percentile of the largest channels of all pixels that are not black; 0 if all are."""
    values = _largest_channels(rgb)
    lit = values[(values > 0) & (values < np.inf)]  # also leaves out NaN
    if not len(lit):
        return 0.0
    rank = int(np.ceil(PERCENTILE * len(lit))) - 1
    return float(np.partition(lit, rank)[rank])


def stops_of(exposure: Exposure, rgb: ArrayLike) -> float:
    """Return an exposure in stops, which is chosen where it is "auto".

    Raises
    ------
    ValueError
        It is neither "auto" nor a number within the limits.
    """
    if isinstance(exposure, str):
        if exposure != AUTO:
            raise ValueError(f'exposure: expected stops or "auto", got {exposure!r}')
        return auto_exposure(rgb)
    if not abs(exposure) <= MAX_STOPS:
        raise ValueError(f"exposure: expected stops from {-MAX_STOPS:g} to {MAX_STOPS:g}, got {exposure!r}")
    return exposure


def hint(rgb: ArrayLike, stops: float) -> str:
    """Say that an image is nearly black, or that much of it is clipped, and what to do; "" where neither is so.

    Parameters
    ----------
    rgb : (h, w, 3) array of float
    stops : float
        The exposure at which it is shown.

    Examples
    --------
    >>> hint([[[0.001, 0.001, 0.001]]], 0.0)
    'the image is nearly black; use --exposure auto (+8.97 stops), or multiply the lights by 500'
    """
    level, better = bright_level(rgb), auto_exposure(rgb)
    factor = float(f"{2.0 ** (better - stops):.2g}")
    cure = f"use --exposure auto ({better:+.2f} stops), or multiply the lights by {factor:g}"
    if level == 0:
        return 'the image is black: see "My image is black" in docs/start.md'
    if level * 2.0**stops < DARK:
        return f"the image is nearly black; {cure}"
    values = _largest_channels(rgb)
    share = np.count_nonzero(values > CLIPPED * 2.0**-stops) / values.size
    return f"{100 * share:.0f} % of the pixels are clipped; {cure}" if share > MUCH and better < stops else ""


def _largest_channels(rgb: ArrayLike) -> NDArray[np.floating]:
    """Return the largest channel of each pixel; NaN where a channel is."""
    image = np.asarray(rgb)
    return np.maximum(np.maximum(image[..., 0], image[..., 1]), image[..., 2])
