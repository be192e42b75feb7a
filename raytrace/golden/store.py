"""Golden files: ``<name>.npz``, the exact light, and ``<name>.png`` for eyes."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import FileError
from raytrace.image import files

ANEW = "write it anew: pytest --update-goldens"
MAX_PICTURES = 2**31  # that a golden may be the mean of
PICTURES = "pictures"  # provenance: of how many pictures the golden is the mean


class GoldenImage(NamedTuple):
    """A golden picture: one picture, or the mean of several that differ by noise."""

    rgb: NDArray[np.float64]  # (h, w, 3): linear light
    stderr: NDArray[np.float64] | None  # (h, w): standard error of the luminance of the mean; None: one picture
    pictures: int  # how many


def read(path: Path) -> GoldenImage:
    """Read a golden file.

    Raises
    ------
    FileError
        It is missing or broken.
    """
    held = files.load(path)
    rgb, stderr, pictures = held.rgb.astype(np.float64), held.stderr, held.provenance.get(PICTURES, 1)
    if not isinstance(pictures, int) or isinstance(pictures, bool) or not 1 <= pictures <= MAX_PICTURES:
        raise FileError(f"{path}: its provenance has no whole number of {PICTURES}; {ANEW}")
    if not np.isfinite(rgb).all():
        raise FileError(f"{path}: has pixels that aren't finite; {ANEW}")
    if stderr is None or pictures < 2:
        return GoldenImage(rgb, None, 1)
    if not (stderr >= 0).all() or not np.isfinite(stderr).all():
        raise FileError(f"{path}: has standard errors that are none; {ANEW}")
    return GoldenImage(rgb, stderr.astype(np.float64), pictures)


def write(path: Path, golden: GoldenImage) -> None:
    """Write a golden file, and a picture for eyes beside it; each appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    provenance = {PICTURES: golden.pictures} if golden.pictures > 1 else {}
    files.save(path, golden.rgb, stderr=golden.stderr, provenance=provenance)
    files.save(path.with_suffix(".png"), golden.rgb)
