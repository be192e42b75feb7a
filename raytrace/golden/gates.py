"""The gates: limits for the difference between an image and its golden image."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.golden.noise import Noise, critical, in_deviations, noise_of
from raytrace.golden.store import GoldenImage
from raytrace.image import flip
from raytrace.image.files import LUMINANCE
from raytrace.image.metrics import TILE, Comparison, Limits, compare, level_of, ratio, tile_means, violations


class Gates(NamedTuple):
    """Limits; None: no limit. Pixels that are not finite always fail.

    With the same seed, only rounding may differ. In tests with planted bugs, an SSIM of 0.999 alone missed a light that
    was 3 % too bright, and the mean alone missed a shift by half a pixel. The four gates together missed none. The
    outliers allow 9 pixels of 96 x 96, for rays whose last bit decides between two surfaces.
    """

    min_ssim: float | None = 0.999
    max_bias: float | None = 1e-3
    max_worst_tile: float | None = 5e-3
    max_outliers: float | None = 1e-3
    alpha: float | None = 0.01  # noisy images: probability that a correct image fails
    max_rejected: float | None = 0.0025  # noisy images: share of pixels, for noise that is not normally distributed
    max_flip: float | None = None  # mean FLIP; needs flip-evaluator


class Verdict(NamedTuple):
    """Result of the gates; true if all hold."""

    broken: tuple[str, ...]  # the gates that fail, one line each
    comparison: Comparison
    rejected: float | None  # share of pixels that fail the z-test; None: not a noisy image
    worst_z: float | None  # largest difference of a pixel, in standard deviations

    def __bool__(self) -> bool:
        return not self.broken

    def __str__(self) -> str:
        c = self.comparison
        bias = ", ".join(f"{value:+.3g}" for value in c.relative_bias)
        text = f"ssim {c.ssim:.6g}, bias {bias}, worst tile {c.worst_tile:.3g}, outliers {c.outliers:.3g}"
        noise = "" if self.rejected is None else f", rejected {self.rejected:.3g}, worst z {self.worst_z:.3g}"
        seen = "" if c.flip is None else f", flip {c.flip:.3g}"
        return text + noise + seen


def judge(actual: NDArray[np.float64], golden: GoldenImage, gates: Gates) -> Verdict:
    """Compare an image with its golden image, both (h, w, 3) linear light of the same size."""
    comparison = compare(actual, golden.rgb, flip=False)
    if gates.max_flip is not None:
        comparison = comparison._replace(flip=_flip(actual, golden.rgb))
    limits = Limits(
        min_ssim=gates.min_ssim,
        max_bias=gates.max_bias,
        max_worst_tile=gates.max_worst_tile,
        max_outliers=gates.max_outliers,
        max_flip=gates.max_flip,
    )
    if golden.stderr is None:
        return Verdict(tuple(violations(comparison, limits)), comparison, None, None)
    finite: NDArray[np.bool_] = np.all(np.isfinite(actual), axis=2)
    difference = (np.where(finite[..., None], actual, golden.rgb) - golden.rgb) @ LUMINANCE
    noise = noise_of(golden.rgb, golden.stderr, golden.pictures)
    z = np.abs(in_deviations(difference, noise))
    if gates.alpha is None:
        return Verdict(tuple(violations(comparison, limits)), comparison, 0.0, float(z.max()))
    rejected = float(np.mean(z > critical(noise, gates.alpha, z.size)))
    broken = violations(_beyond(comparison, difference, golden, noise, gates.alpha), limits)
    if gates.max_rejected is not None and rejected > gates.max_rejected:
        broken.append(f"share of pixels that fail the z-test {rejected:.6g} is above {gates.max_rejected:g}")
    return Verdict(tuple(broken), comparison, rejected, float(z.max()))


def _flip(actual: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Mean FLIP; pixels that are not finite count as equal."""
    flip.required("max_flip")
    finite = np.isfinite(actual).all(axis=2, keepdims=True)
    return flip.flip(np.where(finite, actual, expected), expected)


def _beyond(
    comparison: Comparison, difference: NDArray[np.float64], golden: GoldenImage, noise: Noise, alpha: float
) -> Comparison:
    """Subtract from the bias of channels and the worst tile what the noise of luminance explains."""
    level = level_of(golden.rgb, difference.size)
    variance = noise.deviation**2
    whole_noise = critical(noise, alpha, 1) * float(np.sqrt(variance.sum())) / variance.size
    bias = [_excess(*both, whole_noise, level) for both in zip(comparison.relative_bias, comparison.bias, strict=True)]
    side = min(TILE, difference.shape[0]) * min(TILE, difference.shape[1])
    tiles = tile_means(difference[..., None])
    deviation = np.sqrt(tile_means(variance[..., None]).means / side)
    excess = (np.abs(tiles.means) - critical(noise, alpha, tiles.means.size) * deviation)[..., 0]
    row, column = np.unravel_index(np.argmax(excess), excess.shape)
    return comparison._replace(
        relative_bias=(bias[0], bias[1], bias[2]),
        worst_tile=ratio(max(float(excess[row, column]), 0.0), level),
        worst_tile_at=(int(tiles.rows[row]), int(tiles.columns[column])),
    )


def _excess(relative: float, absolute: float, noise: float, level: float) -> float:
    """Relative bias of a channel minus the noise of the mean."""
    if not np.isfinite(relative):  # a black channel
        return relative if abs(absolute) > noise else 0.0
    return float(np.sign(relative)) * max(abs(relative) - ratio(noise, level), 0.0)
