"""Files of golden images: ``<name>.npz`` with exact linear light, and ``<name>.png`` to look at."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError
from raytrace.image import files

WRITE_AGAIN = "write it again: pytest --update-goldens"
MAX_PICTURES = 2**31  # limit of the number of images in a mean
PICTURES = "pictures"  # key in the provenance: number of images in the mean


class GoldenImage(NamedTuple):
    """A golden image: a single image, or the mean of several noisy ones."""

    rgb: NDArray[np.float64]  # (h, w, 3): linear light
    stderr: NDArray[np.float64] | None  # (h, w): standard error of the luminance of the mean; None: a single image
    pictures: int  # number of images in the mean


def read(path: Path) -> GoldenImage:
    """Read a golden image.

    Raises
    ------
    FileError
        The file is missing or broken.
    """
    held = files.load(path)
    rgb, stderr, pictures = held.rgb.astype(np.float64), held.stderr, held.provenance.get(PICTURES, 1)
    if not isinstance(pictures, int) or isinstance(pictures, bool) or not 1 <= pictures <= MAX_PICTURES:
        raise FileError(f"{path}: its provenance has no valid integer {PICTURES!r}; {WRITE_AGAIN}")
    if not np.isfinite(rgb).all():
        raise FileError(f"{path}: has pixels that are not finite; {WRITE_AGAIN}")
    if stderr is None or pictures < 2:
        return GoldenImage(rgb, None, 1)
    if not (stderr >= 0).all() or not np.isfinite(stderr).all():
        raise FileError(f"{path}: has invalid standard errors; {WRITE_AGAIN}")
    return GoldenImage(rgb, stderr.astype(np.float64), pictures)


def write(path: Path, golden: GoldenImage) -> None:
    """Write a golden image and a PNG of it, each completely or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    provenance = {PICTURES: golden.pictures} if golden.pictures > 1 else {}
    files.save(path, golden.rgb, stderr=golden.stderr, provenance=provenance)
    files.save(path.with_suffix(".png"), golden.rgb)
