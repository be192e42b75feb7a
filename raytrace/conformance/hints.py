"""The usual cause of an error: the closed forms of known mistakes, and changes of the image that make it right."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.conformance.case import Cause, Region
from raytrace.conformance.measuring import Images, measure
from raytrace.image.files import srgb_decode, srgb_encode

BLACK = 1e-3  # radiance: what a mistake may leave where it shows black
NEAR = 0.02  # relative: how near the measured values must be to those of a mistake
PI = np.pi
FACTORS = (
    (PI, "a factor of pi is too much: 1 / pi is missing"),
    (1 / PI, "a factor of pi is missing"),
    (4 * PI, "a factor of 4 pi: flux is taken for intensity"),
    (1 / (4 * PI), "a factor of 1 / (4 pi): intensity is taken for flux"),
    (2 * PI, "a factor of 2 pi is too much"),
    (1 / (2 * PI), "a factor of 2 pi is missing"),
    (2.25, "2.25 = 1.5^2: the eta^2 of radiance is applied where it should not be"),
    (1 / 2.25, "1 / 2.25 = 1 / 1.5^2: the eta^2 of radiance is missing"),
    (2.0, "a factor of 2: something counts twice, such as both sides of a lamp"),
    (0.5, "a factor of 1/2: half of the light is missing"),
    (4.0, "a factor of 4"),
    (0.25, "a factor of 1/4"),
)
Change = Callable[[NDArray[np.float64]], NDArray[np.float64]]
MOVES: tuple[tuple[str, Change], ...] = (  # what undoes the mistake
    ("the image is mirrored left to right", lambda rgb: rgb[:, :, ::-1]),
    ("the image is upside down", lambda rgb: rgb[:, ::-1]),
    ("the image is turned by 180 degrees", lambda rgb: rgb[:, ::-1, ::-1]),
    ("red and blue are swapped", lambda rgb: rgb[..., ::-1]),
)
ENCODINGS: tuple[tuple[str, Change], ...] = (  # these change all scenes
    (
        "linear radiance was written as if it were encoded as sRGB, or decoded twice",
        lambda rgb: np.asarray(srgb_encode(rgb)),
    ),
    (
        "sRGB is encoded twice, or codes were written as linear radiance",
        lambda rgb: np.asarray(srgb_decode(np.clip(rgb, 0, 1))),
    ),
    ("a gamma of 2.2 is applied to linear radiance", lambda rgb: np.maximum(rgb, 0) ** 2.2),
)


class Deviation(NamedTuple):
    """How far values are from others, in units of what is allowed."""

    text: str
    worst: float


def cause_of(images: Images, regions: Sequence[Region], causes: Sequence[Cause], encoded: bool = True) -> str:
    """Return the most likely cause of an error; an empty text where no known one fits.

    ``encoded`` is whether the images may have another encoding: not where some scene passes.
    """
    measured = [measure(images, region) for region in regions]
    means = np.array([each.mean for each in measured])
    slack = np.array([4 * each.noise + each.step for each in measured])
    allowed = np.array([[max(region.tolerance, NEAR / 2)] for region in regions])
    strict = np.array([[region.tolerance] for region in regions])
    right = np.array([region.expected for region in regions])
    found = [Deviation(cause.text, _worst(means, np.array(cause.expected), allowed, slack)) for cause in causes]
    own = min(found, key=lambda each: each.worst, default=None)
    if own is not None and own.worst <= 1:
        return own.text
    now = _worst(means, right, strict, slack)
    for text, change in MOVES + (ENCODINGS if encoded else ()):
        changed = images._replace(rgb=change(images.rgb), eight_bits=False)
        values = np.array([measure(changed, region).mean for region in regions])
        if _worst(values, right, strict, np.minimum(slack, strict * right)) <= 1 < now:  # the scene would pass
            return text
    found = [Deviation(text, _worst(means, factor * right, allowed, slack)) for factor, text in FACTORS]
    best = min(found, key=lambda each: each.worst)
    if best.worst <= 1:
        return best.text
    ratio = np.median(means / right)
    if len(regions) > 1 and abs(ratio - 1) > NEAR and _worst(means, ratio * right, allowed, slack) <= 1:
        return f"everything is off by the same factor of {ratio:.4g}"
    if own is not None and own.worst <= 3:
        return f"perhaps: {own.text}"
    return ""


def _worst(
    means: NDArray[np.float64], other: NDArray[np.float64], allowed: NDArray[np.float64], slack: NDArray[np.float64]
) -> float:
    """Largest deviation from other values, over all regions and channels; 1 is allowed."""
    return float((np.abs(means - other) / (allowed * np.abs(other) + slack + BLACK)).max())
