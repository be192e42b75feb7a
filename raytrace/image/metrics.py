"""Compare an image with a reference: error measures in linear light and in sRGB."""

from __future__ import annotations

import math
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import PackageError
from raytrace.image import flip as flip_metric
from raytrace.image.comparison import Comparison
from raytrace.image.files import LUMINANCE, load, srgb_encode

RELATIVE_EPS = 0.01  # radiance^2, keeps black pixels finite in relative_mse: the eps of [Gharbi2019], there with a half
MRSE_OFFSET = 0.01  # radiance, keeps black pixels finite in mrse: that of pbrt-v4's imgtool   [Pharr2023]
TILE = 8  # pixels: side of a tile of worst_tile
OUTLIER = (
    0.05  # smallest difference of an outlier, relative to the pixel plus the mean: visible, and more than rounding
)
ROUNDING = 1e-4  # relative to the pixel plus the mean: differences below this come from rounding
DIFFERENCE_QUANTILE = 0.995  # share of the differing pixels within the colour scale of a difference map
SSIM_RADIUS = 5  # pixels: the 11 x 11 Gaussian window of [Wang2004], sigma 1.5


class Limits(NamedTuple):
    """Limits for a comparison; None: no limit. Pixels that are not finite always violate them."""

    max_rmse: float | None = None
    min_ssim: float | None = None
    max_bias: float | None = None  # for |relative_bias| of each channel
    max_worst_tile: float | None = None
    max_outliers: float | None = None
    max_rmse_srgb: float | None = None
    max_relative_mse: float | None = None
    max_mrse: float | None = None
    max_flip: float | None = None
    max_hdr_flip: float | None = None


@np.errstate(over="ignore", invalid="ignore")  # squares of large numbers become inf
def compare(image: Any, reference: Any, *, flip: bool | None = None) -> Comparison:
    """Compare an image with a reference.

    Parameters
    ----------
    image, reference : (h, w, 3) array of float, object with ``.rgb``, or path of an image
        Linear radiance, equal size.
    flip : bool, optional
        Whether to measure FLIP and HDR-FLIP [Andersson2020] [Andersson2021], which takes longer than all other numbers.
        Default: if flip-evaluator is installed.

    Returns
    -------
    Comparison
        Its fields define the numbers.

    Raises
    ------
    ValueError
        The sizes differ, or an argument is not an image.
    FileError
        A file can't be read.
    RaytraceError
        scikit-image isn't installed.
    OptionError
        ``flip`` is true, and flip-evaluator isn't installed.

    Examples
    --------
    >>> import numpy as np
    >>> grey = np.full((16, 16, 3), 0.5)
    >>> compare(1.25 * grey, grey).relative_bias
    (0.25, 0.25, 0.25)
    """
    a, b = light_of(image, "image"), light_of(reference, "reference")
    if a.shape != b.shape:
        raise ValueError(
            f"images of different size: {a.shape[1]}x{a.shape[0]} against a reference of {b.shape[1]}x{b.shape[0]}"
        )
    if flip:
        flip_metric.required("flip")
    finite: NDArray[np.bool_] = np.all(np.isfinite(a) & np.isfinite(b), axis=2)
    count = int(finite.sum())
    if count == 0:
        nan = math.nan
        return Comparison(nan, nan, nan, (nan,) * 3, (nan,) * 3, nan, nan, (0, 0), nan, finite.size, nan)
    a, b = np.where(finite[:, :, None], a, 0.0), np.where(finite[:, :, None], b, 0.0)
    difference = a - b
    mean = b.sum(axis=(0, 1)) / count
    level = level_of(b, count)
    bias = difference.sum(axis=(0, 1)) / count
    tile, tile_at = worst_tile(difference)
    flips = flip_metric.available() if flip is None else flip
    far = (np.abs(difference) > OUTLIER * (np.abs(b) + level)).any(axis=2)
    return Comparison(
        rmse=math.sqrt((difference**2).sum() / (3 * count)),
        rmse_srgb=math.sqrt(((screen(a) - screen(b)) ** 2).sum() / (3 * count)),
        relative_mse=float((difference**2 / (b**2 + RELATIVE_EPS)).sum() / (3 * count)),
        bias=(float(bias[0]), float(bias[1]), float(bias[2])),
        relative_bias=(ratio(bias[0], mean[0]), ratio(bias[1], mean[1]), ratio(bias[2], mean[2])),
        ssim=ssim(a, b),
        worst_tile=ratio(tile, level),
        worst_tile_at=tile_at,
        outliers=float(far.sum() / count),
        non_finite=finite.size - count,
        mrse=float((difference**2 / (np.abs(b) + MRSE_OFFSET) ** 2).sum() / (3 * count)),
        flip=flip_metric.flip(a, b) if flips else None,
        hdr_flip=flip_metric.hdr_flip(a, b) if flips else None,
    )


def violations(comparison: Comparison, limits: Limits) -> list[str]:
    """List the limits that a comparison violates, one line each; empty: all are met.

    >>> black, white = np.zeros((4, 4, 3)), np.ones((4, 4, 3))
    >>> violations(compare(white, black), Limits(max_rmse=0.5))
    ['rmse 1 is above 0.5']
    """
    c = comparison
    ceilings = (
        ("rmse", c.rmse, limits.max_rmse),
        ("rmse_srgb", c.rmse_srgb, limits.max_rmse_srgb),
        ("relative_mse", c.relative_mse, limits.max_relative_mse),
        ("relative bias of red", abs(c.relative_bias[0]), limits.max_bias),
        ("relative bias of green", abs(c.relative_bias[1]), limits.max_bias),
        ("relative bias of blue", abs(c.relative_bias[2]), limits.max_bias),
        (f"worst tile, at row {c.worst_tile_at[0]}, column {c.worst_tile_at[1]},", c.worst_tile, limits.max_worst_tile),
        ("share of outliers", c.outliers, limits.max_outliers),
        ("mrse", c.mrse, limits.max_mrse),
        ("flip", math.nan if c.flip is None else c.flip, limits.max_flip),
        ("hdr_flip", math.nan if c.hdr_flip is None else c.hdr_flip, limits.max_hdr_flip),
    )
    lines = [f"pixels that are not finite: {c.non_finite}"] if c.non_finite else []
    # `not <=`: NaN violates a limit
    lines += [f"{name} {v:.6g} is above {top:g}" for name, v, top in ceilings if top is not None and not v <= top]
    if limits.min_ssim is not None and not c.ssim >= limits.min_ssim:
        lines.append(f"ssim {c.ssim:.6g} is below {limits.min_ssim:g}")
    return lines


def screen(light: NDArray[np.floating]) -> NDArray[np.float64]:
    """Clip linear light to 0..1 and encode it as sRGB codes, as a screen shows it.

    >>> screen(np.array([-1.0, 0.5, 7.0])).round(4).tolist()
    [0.0, 0.7354, 1.0]
    """
    return srgb_encode(np.clip(light, 0.0, 1.0))


def ssim(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Mean structural similarity of two (h, w, 3) images in linear light, of their sRGB codes clipped to 0..1.

    Notes
    -----
    Per channel, with Gaussian weighted moments of an 11 x 11 window, sigma 1.5, c1 = 0.01^2, c2 = 0.03^2:
    ``(2 ma mb + c1) (2 cov + c2) / ((ma^2 + mb^2 + c1) (va + vb + c2))``, averaged over channels and over the pixels
    whose window lies inside the image. An image smaller than the window is padded by reflection, and all its pixels
    are averaged.

    References
    ----------
    [Wang2004], by scikit-image.
    """
    return _similarity(a, b)[0]


def ssim_map(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    """Structural similarity around each pixel, (h, w), as in ``ssim``, averaged over channels."""
    return _similarity(a, b)[1]


def _similarity(a: NDArray[np.floating], b: NDArray[np.floating]) -> tuple[float, NDArray[np.float64]]:
    try:
        from skimage.metrics import structural_similarity  # 0.2 s: imported only where it is used
    except ImportError:
        raise PackageError("comparing images needs scikit-image: pip install scikit-image") from None
    codes = [screen(a), screen(b)]
    margin = SSIM_RADIUS if min(a.shape[:2]) <= 2 * SSIM_RADIUS else 0
    if margin:
        codes = [np.pad(code, ((margin, margin), (margin, margin), (0, 0)), mode="symmetric") for code in codes]
    wang = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    mean, everywhere = structural_similarity(*codes, data_range=1.0, channel_axis=2, full=True, **wang)
    height, width = a.shape[:2]
    return float(mean), everywhere[margin : margin + height, margin : margin + width].mean(axis=2)


def worst_tile(difference: NDArray[np.floating]) -> tuple[float, tuple[int, int]]:
    """Largest mean of a difference over the 8 x 8 tiles of an image, and the tile's position.

    Parameters
    ----------
    difference : (h, w, 3) array of float
        Radiance.

    Returns
    -------
    value : float
        Radiance: the largest |mean over the tile| of all tiles and channels.
    at : (int, int)
        Row and column of the tile's first pixel.

    Notes
    -----
    Tiles start at multiples of 8. A last tile that would cross the border is moved inwards: all tiles are complete, and
    a pixel at the border has no larger weight. In an image narrower than 8 pixels, tiles are as narrow as the image.
    """
    tiles = tile_means(difference)
    size = np.abs(tiles.means).max(axis=2)
    row, column = np.unravel_index(np.argmax(size), size.shape)
    return float(size[row, column]), (int(tiles.rows[row]), int(tiles.columns[column]))


class TileMeans(NamedTuple):
    """Means over the tiles of an image."""

    means: NDArray[np.floating]  # (r, k, c)
    rows: NDArray[np.int64]  # (r,): first row of each tile
    columns: NDArray[np.int64]  # (k,): first column of each tile


def tile_means(field: NDArray[np.floating]) -> TileMeans:
    """Means of an (h, w, c) array over the tiles of ``worst_tile``."""
    side = [min(TILE, extent) for extent in field.shape[:2]]
    rows, columns = (
        np.unique(np.append(np.arange(0, extent - size + 1, size), extent - size))
        for extent, size in zip(field.shape[:2], side, strict=True)
    )
    windows = np.lib.stride_tricks.sliding_window_view(field, side, axis=(0, 1))
    return TileMeans(windows[np.ix_(rows, columns)].mean(axis=(3, 4)), rows, columns)


def light_of(image: Any, name: str) -> NDArray[np.float64]:
    """Linear radiance (h, w, 3) of an argument of ``compare``."""
    if isinstance(image, str | os.PathLike):
        image = load(image)
    values: ArrayLike = getattr(image, "rgb", image)
    array = np.asarray(values)
    if array.ndim != 3 or array.shape[2] != 3 or array.size == 0 or array.dtype.kind != "f":
        raise ValueError(
            f"{name}: expected linear radiance, (height, width, 3) float, got {array.shape} {array.dtype.name}"
        )
    return array.astype(np.float64, order="C")  # C order: sums have the same order for every source


def level_of(light: NDArray[np.floating], count: int) -> float:
    """Mean |luminance| of (h, w, 3) light over ``count`` pixels (the others must be 0), for relative differences.

    >>> round(level_of(np.full((2, 2, 3), -0.5), 4), 12)
    0.5
    """
    luminance = light @ LUMINANCE
    if luminance.min() >= 0.0:
        return float(light.sum(axis=(0, 1)) / count @ LUMINANCE)
    return float(np.abs(luminance).sum() / count)


def difference_scale(difference: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Largest value of the colour scale for a difference map (h, w) from a reference (h, w, 3); 0: no difference.

    It is a quantile of the pixels that differ by more than rounding. So a defect of a few pixels is visible, and a
    single pixel with a large error does not hide the others.
    """
    light, size = np.abs(reference @ LUMINANCE), np.abs(difference)
    visible = size[size > ROUNDING * (light + light.mean())]
    return float(np.quantile(visible, DIFFERENCE_QUANTILE) if visible.size else size.max())


def ratio(x: float, y: float) -> float:
    """X / y, where 0 / 0 is 0 and x / 0 is inf.

    >>> ratio(0.0, 0.0), ratio(2.0, 0.0), ratio(1.0, 2.0)
    (0.0, inf, 0.5)
    """
    if x == 0.0:
        return 0.0
    return float(x / y) if y != 0.0 else math.inf
