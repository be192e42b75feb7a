"""Whether two images differ by more than their noise, judged by the variances that their files have."""

import math
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import OptionError, PackageError, printable
from raytrace.image.files import load
from raytrace.image.metrics import ROUNDING, TILE, light_of, tile_means

ALPHA = 0.01  # default level
FREEDOM = 3  # degrees of freedom of one variance: a pixel of raytrace has four batch means
MOST = 1e9  # degrees of freedom; as good as infinity
CHANNELS = "red", "green", "blue"
Noisy = tuple[NDArray[np.float64], NDArray[np.float64]]  # light and its variance, (h, w, 3) each


class ZTest(NamedTuple):
    """Result of ``z_test``. z: a difference divided by its standard deviation."""

    alpha: float  # probability that two images of the same scene are rejected
    p: float  # probability of a result at least as extreme by chance, corrected for all tests; rejected below alpha
    tests: int  # number of tests: the whole image and every tile, for each channel
    whole_z: tuple[float, float, float]  # of the mean over the image, per channel
    tile_z: float  # of the mean over the least likely tile
    tile_at: tuple[int, int]  # row and column of its first pixel
    tile_channel: str  # red, green or blue
    pixel_z: float  # largest |z| of a pixel in any channel; not part of the test
    reason: str  # what was found if the images differ; else empty

    @property
    def passed(self) -> bool:
        """Whether the images agree within their noise."""
        return not self.reason


class Terms(NamedTuple):
    """What is averaged over a region, (..., 3) each."""

    difference: NDArray[np.floating]  # a - b
    variance: NDArray[np.floating]  # of the difference
    square: NDArray[np.floating]  # (var(a)^2 + var(b)^2) / (FREEDOM + 2)


class Tested(NamedTuple):
    """Tests of the mean differences of regions, (..., 3) each."""

    z: NDArray[np.float64]
    p: NDArray[np.float64]  # two-sided


def z_test(image: Any, reference: Any, alpha: float = ALPHA) -> ZTest:
    """Test whether two independent images differ by more than their noise.

    Parameters
    ----------
    image, reference : path of an .exr or .npz, or object with ``.rgb`` and ``.var``
        Linear radiance, (h, w, 3) each, rendered with different seeds; ``var`` is the variance of each channel's mean.
        A pixel that is not finite in one of them is left out.
    alpha : float
        Probability that images which differ by chance only are rejected.

    Returns
    -------
    ZTest

    Raises
    ------
    OptionError
        An image has no variance, or one that can't be used.
    ValueError
        The sizes differ, an argument is not an image, or alpha is not between 0 and 1.
    FileError
        A file can't be read.
    RaytraceError
        SciPy isn't installed.

    Notes
    -----
    d = a - b has the variance v = var(a) + var(b) in each pixel and channel. Tested are the mean of d over the image
    and over each 8 x 8 tile, for each channel: z = sum(d) / sqrt(sum(v)), compared with Student's t. Each variance is
    an estimate with ``FREEDOM`` degrees of freedom f, so single pixels have heavy tails, and are not tested. The
    degrees of freedom of a sum are

        nu = sum(v)^2 / sum(var(a)^2 / (f + 2) + var(b)^2 / (f + 2)) - 2        [Satterthwaite1946]

    because var^2 f / (f + 2) estimates the square of the true variance without bias. A sum that one pixel dominates
    keeps few of them. The smallest p of m tests becomes 1 - (1 - p)^m [Sidak1967], for the image and for the tiles,
    and the smaller of these two once more with m = 2.

    Examples
    --------
    >>> import numpy as np
    >>> from types import SimpleNamespace
    >>> noise = np.random.default_rng(1).normal(0, 0.01, (2, 32, 32, 3))
    >>> a, b = (SimpleNamespace(rgb=0.5 + each, var=np.full((32, 32, 3), 1e-4)) for each in noise)
    >>> z_test(a, b).passed
    True
    >>> a.rgb *= 1.01
    >>> z_test(a, b).passed
    False
    """
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha: expected a number between 0 and 1, got {alpha!r}")
    terms = _terms(_noisy(image, "image"), _noisy(reference, "reference"))
    height, width = terms.difference.shape[:2]
    tiles = [tile_means(term) for term in terms]
    whole = _tested(Terms(*(term.mean(axis=(0, 1)) for term in terms)), height * width)
    each = _tested(Terms(*(tile.means for tile in tiles)), min(TILE, height) * min(TILE, width))
    pixel = _in_deviations(terms.difference, terms.variance)
    row, column, channel = (int(k) for k in np.unravel_index(np.argmin(each.p), each.p.shape))
    p_whole, p_tile = _corrected(float(whole.p.min()), whole.p.size), _corrected(float(each.p.min()), each.p.size)
    found = ZTest(
        alpha=alpha,
        p=_corrected(min(p_whole, p_tile), 2),
        tests=whole.p.size + each.p.size,
        whole_z=(float(whole.z[0]), float(whole.z[1]), float(whole.z[2])),
        tile_z=float(each.z[row, column, channel]),
        tile_at=(int(tiles[0].rows[row]), int(tiles[0].columns[column])),
        tile_channel=CHANNELS[channel],
        pixel_z=float(np.abs(pixel).max()),
        reason="",
    )
    return found if found.p >= alpha else found._replace(reason=_reason(found, whole, _corrected(p_whole, 2) < alpha))


def _noisy(image: Any, name: str) -> Noisy:
    """Light and variance of an argument, (h, w, 3) each."""
    if isinstance(image, str | os.PathLike):
        name, image = printable(image), load(image)
    var = getattr(image, "var", None) if hasattr(image, "rgb") else None
    if var is None:
        raise OptionError(f"z-test: {name}: has no variance; render it with raytrace to an .exr or .npz file")
    light, var = light_of(image, name), np.asarray(var, np.float64)
    if var.shape != light.shape:
        raise OptionError(f"z-test: {name}: its variance has shape {var.shape} instead of {light.shape}")
    usable = np.isfinite(var) & (var >= 0)
    if not usable[np.isfinite(light)].all():
        count = int((~usable).any(axis=2).sum())
        text = f"z-test: {name}: the variance of {count} pixels is unknown; use 2 or more samples per pixel"
        raise OptionError(text)
    return light, var


def _terms(image: Noisy, reference: Noisy) -> Terms:
    """Difference, variance and terms of nu of each pixel; all 0 where a pixel is not finite."""
    (a, var_a), (b, var_b) = image, reference
    if a.shape != b.shape:
        raise ValueError(f"images of different size: {a.shape[1]}x{a.shape[0]} against {b.shape[1]}x{b.shape[0]}")
    finite: NDArray[np.bool_] = np.all(np.isfinite(a) & np.isfinite(b), axis=2)[:, :, None]
    a, b, var_a, var_b = (np.where(finite, term, 0.0) for term in (a, b, var_a, var_b))
    floor = (ROUNDING * (np.abs(b) + np.abs(b).mean())) ** 2 / 2  # pixels without noise differ by rounding
    var_a, var_b = np.maximum(var_a, floor), np.maximum(var_b, floor)
    return Terms(a - b, var_a + var_b, (var_a**2 + var_b**2) / (FREEDOM + 2))


def _tested(terms: Terms, pixels: int) -> Tested:
    """Test the means of terms over regions of so many pixels."""
    try:
        from scipy.special import stdtr  # comes with scikit-image
    except ImportError:
        raise PackageError("z-test: needs SciPy: pip install scipy") from None
    z = _in_deviations(terms.difference, terms.variance / pixels)
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.where(terms.square > 0, pixels * terms.variance**2 / terms.square - 2, MOST)
    return Tested(z, 2 * stdtr(np.clip(freedom, 1.0, MOST), -np.abs(z)))


def _in_deviations(difference: NDArray[np.floating], variance: NDArray[np.floating]) -> NDArray[np.float64]:
    """Differences divided by their standard deviation; 0 / 0 is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(difference == 0.0, 0.0, difference / np.sqrt(variance))


def _corrected(p: float, tests: int) -> float:
    """Probability that at least one of so many tests has a p this small by chance.

    >>> round(_corrected(0.01, 2), 6)
    0.0199
    """
    return 1.0 if p >= 1.0 else -math.expm1(tests * math.log1p(-p))


def _reason(found: ZTest, whole: Tested, image: bool) -> str:
    channel = int(np.argmin(whole.p))
    where = f"mean of {CHANNELS[channel]}: z = {found.whole_z[channel]:+.3g}"
    if not image:
        row, column = found.tile_at
        where = f"{found.tile_channel} of the tile at row {row}, column {column}: z = {found.tile_z:+.3g}"
    return f"z-test: the images differ by more than their noise: {where}; p = {found.p:.3g} is below {found.alpha:g}"
