"""Where samples lie in a pixel, and the rays through them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raytrace.records import Camera

F8 = NDArray[np.floating]


def stratified(size: tuple[int, int], spp: int, seed: int = 0) -> F8:
    """Return film positions (h, w, spp, 2) in pixels: each pixel has a grid of cells, with one random point per cell.

    The variance is never larger than that of independent points [Pharr2023, 8.2.1]. If the grid has more than spp
    cells, each pixel leaves out some of them at random.

    Examples
    --------
    >>> positions = stratified((2, 1), 4)
    >>> positions.shape
    (1, 2, 4, 2)
    >>> sorted((2 * positions[0, 1] // 1).tolist())
    [[2.0, 0.0], [2.0, 1.0], [3.0, 0.0], [3.0, 1.0]]
    """
    width, height = size
    rng = np.random.default_rng(seed)
    nx = math.ceil(math.sqrt(spp))
    ny = math.ceil(spp / nx)
    cell = rng.random((height, width, nx * ny)).argsort(axis=2)[..., :spp]
    jitter = rng.random((height, width, spp, 2))
    row, column = np.mgrid[:height, :width]
    x = column[..., None] + (cell % nx + jitter[..., 0]) / nx
    y = row[..., None] + (cell // nx + jitter[..., 1]) / ny
    return np.stack([x, y], axis=-1)


def pixel_centres(size: tuple[int, int]) -> F8:
    """Return the film positions (h, w, 1, 2) of the centres of pixels.

    Examples
    --------
    >>> pixel_centres((2, 1)).tolist()
    [[[[0.5, 0.5]], [[1.5, 0.5]]]]
    """
    width, height = size
    y, x = np.mgrid[:height, :width] + 0.5
    return np.stack([x, y], axis=-1)[:, :, None]


def pinhole_rays(camera: Camera, size: tuple[int, int], positions: F8) -> tuple[F8, F8]:
    """Return origins and unit directions (n, 3) of rays through film positions (n, 2), in pixels from the top left.

    The film is a plane at distance 1; its height spans the angle ``fov``.

    Examples
    --------
    >>> import numpy as np
    >>> from raytrace.records import Camera
    >>> camera = Camera(np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 90.0)
    >>> pinhole_rays(camera, (2, 2), np.array([[1.0, 1.0], [1.0, 0.0]]))[1].round(4) + 0.0
    array([[ 0.    ,  0.    , -1.    ],
           [ 0.    ,  0.7071, -0.7071]])
    """
    forward = unit(camera.look_at - camera.position)
    right = unit(np.cross(forward, camera.up))
    up = np.cross(right, forward)
    width, height = size
    pixel = 2 * math.tan(math.radians(camera.fov) / 2) / height  # width of a pixel at distance 1
    x, y = pixel * (positions[:, :1] - width / 2), pixel * (height / 2 - positions[:, 1:])
    d = unit(forward + x * right + y * up)
    return np.broadcast_to(camera.position, d.shape), d


def unit(a: F8) -> F8:
    """Return vectors (..., 3) scaled to length 1."""
    return a / np.linalg.norm(a, axis=-1, keepdims=True)
