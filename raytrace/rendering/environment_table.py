"""The table from which directions of an environment image are drawn."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.passes.angles import sin_cos_of_turns
from raytrace.passes.environment import BLUE, GREEN, RED
from raytrace.passes.path_records import EnvironmentTable
from raytrace.texture_records import EnvironmentImage

ALL = 2**32 - 1  # random numbers that are shared out; the last one is nobody's


def make_environment_table(image: EnvironmentImage, share: float, dtype: Any) -> EnvironmentTable:
    """Table of an image; share: probability that light is sampled from it."""
    texels = radiance_of(image, dtype)
    height, width = texels.shape[:2]
    weights = cell_weights(texels)
    rows = begins_of(np.cumsum(weights, axis=1)[:, -1])
    columns = np.concatenate([begins_of(row) for row in weights])
    return EnvironmentTable(
        texels.ravel(),
        np.array([height, width], np.int32),
        image.turn.T.astype(dtype).ravel(),
        rows,
        columns,
        np.array([share], dtype),
    )


def cell_weights(texels: NDArray[Any]) -> NDArray[np.float64]:
    """Filtered luminance of cells, averaged over each, times their solid angles in a common unit; (h + 1, w)."""
    height = len(texels)
    luminance = RED * texels[..., 0].astype(np.float64) + GREEN * texels[..., 1] + BLUE * texels[..., 2]
    pairs = luminance + np.roll(luminance, 1, axis=1)
    means = np.concatenate([2 * pairs[:1], pairs[:-1] + pairs[1:], 2 * pairs[-1:]])
    # cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2): the middles and halves of the rows of cells, in parts of pi
    edges = np.concatenate([[0.0], (np.arange(height) + 0.5) / height, [1.0]])
    solid = sines((edges[:-1] + edges[1:]) / 2) * sines((edges[1:] - edges[:-1]) / 2)
    return means * solid[:, None]


def begins_of(weights: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Where the random numbers of each weight begin, and the end of the last: in proportion, but 1 at least.

    >>> begins_of(np.array([1.0, 0.0, 3.0, 1e-30])).tolist()
    [0, 1073741823, 1073741823, 4294967294, 4294967295]
    """
    sums = np.cumsum(weights)
    if not sums[-1] > 0:
        return np.zeros(len(weights) + 1, np.uint32)
    ends = np.floor(sums * (ALL / sums[-1])).astype(np.int64)
    counts = np.diff(ends, prepend=0)
    lacking = (weights > 0) & (counts < 1)
    counts[lacking] = 1
    counts[weights <= 0] = 0
    counts[np.argmax(counts)] += ALL - np.cumsum(counts)[-1]
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.uint32)


def radiance_of(image: EnvironmentImage, dtype: Any) -> NDArray[Any]:
    """Radiance of the texels of an image, (h, w, 3), row 0 up."""
    values = np.empty((image.texture.codes.size // 3, 3), dtype)
    image.texture.values(out=values)
    values *= np.dtype(dtype).type(image.scale)
    return np.ascontiguousarray(values.reshape(image.texture.codes.shape)[::-1])


def sines(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sines of pi times numbers of 0 .. 1: the same on every machine."""
    return np.asarray(sin_cos_of_turns(0.5 * positions)[0])


def mean_radiance(image: EnvironmentImage) -> NDArray[np.float64]:
    """Radiance of an image averaged over the sphere, (3,); each row counts by the sine of its polar angle."""
    values = radiance_of(image, np.float64)
    height, width = values.shape[:2]
    weights = sines((np.arange(height) + 0.5) / height)
    rows = np.cumsum(values, axis=1)[:, -1] / width
    return np.cumsum(weights[:, None] * rows, axis=0)[-1] / np.cumsum(weights)[-1]
