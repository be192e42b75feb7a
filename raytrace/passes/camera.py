"""First pass: from pixels and samples to rays."""

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import load, packet, packet_width, sqrt, store, to_real
from raytrace.jit import kernel
from raytrace.passes.sampling import Sampler, film_sample, pixel_key
from raytrace.records import Camera, View


def make_view(camera: Camera, size: tuple[int, int], dtype: np.dtype) -> View:
    """Make the view of a camera for a film of ``size`` (width, height) in square pixels, over its field of view."""
    forward = _unit(camera.look_at / 2 - camera.position / 2)  # halves: the difference of large numbers may overflow
    right = np.cross(forward, _unit(camera.up))
    right = right / np.linalg.norm(right)
    height = 2.0 * np.tan(np.radians(camera.fov) / 2.0) if camera.height is None else camera.height
    pixel = height / size[1]
    vectors = camera.position, forward, pixel * right, pixel * np.cross(forward, right), np.array(size) / 2.0
    return View(*(np.asarray(vector, dtype) for vector in vectors))


def pinhole_directions(view: View, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.floating]:
    """Unit directions (n, 3) of rays through points (x, y) of the film, in pixels, in the precision of the view."""
    d = view.forward + (x - view.centre[0])[:, None] * view.right + (y - view.centre[1])[:, None] * view.down
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(view.forward.dtype)


def parallel_origins(view: View, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.floating]:
    """Origins (n, 3) of the rays of an orthographic camera through points (x, y) of the film, in pixels."""
    return view.origin + (x - view.centre[0])[:, None] * view.right + (y - view.centre[1])[:, None] * view.down


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vector; the largest component is first scaled to 1/2 .. 1, exactly, so that no square overflows."""
    scaled = np.ldexp(vector, -np.frexp(np.abs(vector).max())[1])
    return scaled / np.linalg.norm(scaled)


@kernel
def camera_rays(view: View, sampler: Sampler, x, y, samples, d):
    """Compute the directions of rays through samples of pixels; ray number = sample * len(x) + pixel.

    Parameters
    ----------
    view : View
    sampler : Sobol, Stratified or Independent
    x, y : (m,) uint32 arrays, pixels
        Columns and rows of pixels of the film: full packets, with neighbours next to each other.
    samples : (2,) int64 array
        Number of the first sample, and of the one after the last.
    d : (3n,) f array
        Output: unit directions.
    """
    like = packet(d)
    count, n = len(x), len(d) // 3
    first = samples[0]
    for j in range(0, count, packet_width(d)):
        column, row = load(x, j, like), load(y, j, like)
        pixel = pixel_key(sampler.seed, column, row)
        left, top = to_real(column, like) - view.centre[0], to_real(row, like) - view.centre[1]
        for sample in range(first, samples[1]):
            u, v = film_sample(sampler, pixel, sample, like)
            u, v = left + u, top + v
            dx = view.forward[0] + (u * view.right[0] + v * view.down[0])
            dy = view.forward[1] + (u * view.right[1] + v * view.down[1])
            dz = view.forward[2] + (u * view.right[2] + v * view.down[2])
            scale = 1.0 / sqrt(dx * dx + dy * dy + dz * dz)
            at = (sample - first) * count + j
            store(d, at, dx * scale)
            store(d, n + at, dy * scale)
            store(d, 2 * n + at, dz * scale)
