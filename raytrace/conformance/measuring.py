"""Measures the images of one scene: means of regions, and how much noise they have."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.conformance.case import Region
from raytrace.errors import FileError, printable
from raytrace.image.files import LoadedImage, load, srgb_decode, srgb_encode

SUFFIXES = (".exr", ".npz", ".png")
CLIPPED = 1e-3  # share of the pixels of a region at the largest code of a PNG that makes it clipped
HALF_STEP = 0.5 / 255  # of 8 bits


class Images(NamedTuple):
    """The images of one scene."""

    paths: tuple[Path, ...]
    rgb: NDArray[np.float64]  # (k, h, w, 3): linear radiance
    variance: NDArray[np.float64] | None  # (h, w, 3): of the mean of all images; None: unknown
    eight_bits: bool


class Measured(NamedTuple):
    """The mean of a region."""

    mean: NDArray[np.float64]  # (3,)
    noise: NDArray[np.float64]  # (3,): standard error of the mean
    known: bool  # whether the noise comes from variances or seeds; else from differences of pixels
    step: NDArray[np.float64]  # (3,): half a step of 8 bits; 0 for images of floats


def find_images(folder: Path, name: str) -> list[Path]:
    """Return the images of a scene: NAME and NAME-1, NAME-2, ... in one format; the first that exists of EXR, NPZ, PNG.

    Raises
    ------
    FileError
        The folder can't be read.
    """
    try:
        files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    except OSError as error:
        raise FileError(
            f"{printable(folder)}: can't be read: {error.strerror}; name the folder of the images"
        ) from error
    pattern = re.compile(re.escape(name) + r"(-\d+)?")
    for suffix in SUFFIXES:
        found = [path for path in files if path.suffix.lower() == suffix and pattern.fullmatch(path.stem)]
        if found:
            return sorted(found, key=lambda path: (len(path.stem), path.stem))
    return []


def read_images(paths: Sequence[Path]) -> Images:
    """Read the images of a scene.

    Raises
    ------
    FileError
        A file can't be read.
    ValueError
        The images have different sizes.
    """
    loaded = [load(path) for path in paths]
    if len({image.rgb.shape for image in loaded}) > 1:
        raise ValueError("its images have different sizes")
    rgb = np.stack([image.rgb.astype(np.float64) for image in loaded])
    return Images(tuple(paths), rgb, _variance(loaded, rgb), paths[0].suffix.lower() == ".png")


def _variance(loaded: list[LoadedImage], rgb: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Variance of the mean of the images: from their files, or from the differences between seeds."""
    count = len(loaded)
    if all(image.var is not None and (image.var >= 0).all() and np.isfinite(image.var).all() for image in loaded):
        return np.asarray(sum(np.asarray(image.var, np.float64) for image in loaded) / count**2)
    if count > 1 and (rgb != rgb[0]).any():  # copies of one image are no seeds
        return np.asarray(rgb.var(axis=0, ddof=1) / count)
    return None


def measure(images: Images, region: Region) -> Measured:
    """Return the mean of a region, and its noise."""
    x0, y0, x1, y1 = region.box
    part = images.rgb[:, y0:y1, x0:x1]
    count = (y1 - y0) * (x1 - x0)
    mean = part.mean(axis=(0, 1, 2))
    if images.variance is not None:
        noise = np.sqrt(images.variance[y0:y1, x0:x1].sum(axis=(0, 1))) / count
    else:
        noise = _roughness(part[0]) / np.sqrt(count)
    step = np.zeros(3)
    if images.eight_bits:
        codes = srgb_encode(np.clip(mean, 0, 1))
        step = np.asarray(srgb_decode(codes + HALF_STEP) - srgb_decode(codes))
    return Measured(mean, noise, images.variance is not None, step)


def _roughness(part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Deviation of pixels from their neighbours' mean, as noise has it: second differences, which ignore gradients."""
    squares, number = np.zeros(3), 0
    for axis in (0, 1):
        if part.shape[axis] >= 3:
            second = np.diff(part, 2, axis=axis)
            squares, number = squares + (second**2).sum(axis=(0, 1)), number + second[..., 0].size
    return np.sqrt(squares / (6 * number)) if number else np.zeros(3)  # the variance of a - 2 b + c is 6 of each


def unusable(images: Images, regions: Sequence[Region], size: Sequence[int]) -> str:
    """Return why images cannot be judged; an empty text where they can."""
    height, width = images.rgb.shape[1:3]
    if [width, height] != list(size):
        return f"the image has {width} x {height} pixels; the scene asks for {size[0]} x {size[1]}"
    if not np.isfinite(images.rgb).all():
        return "the image has values that are not finite"
    if not images.rgb.any():
        return "the image is black: no light, a camera in a wall, or lamps that face the other way"
    parts: list[Any] = [images.rgb[:, y0:y1, x0:x1] for x0, y0, x1, y1 in (region.box for region in regions)]
    if images.eight_bits and any((part >= 1).mean() > CLIPPED for part in parts):
        return "the image is clipped: values at the largest code; it is too bright, or exposed"
    uniform = len({region.expected for region in regions}) == 1  # by design
    if not uniform and (images.rgb == images.rgb[:, :1, :1]).all():
        return "the image has a single colour"
    return ""
