"""First pass for cameras that are no pinhole, and for films whose filter is no box: rays with origins of their own.

- Thin lens: from a point of the lens to the point of the plane in focus on the pinhole's ray [Pharr2023, 5.2.3].
- Orthographic: parallel rays from the plane through the camera's position.
- Filters, by importance sampling: the position of a sample follows the filter, so every sample has the same weight and
  belongs to one pixel [Ernst2006].
"""

from decimal import Decimal, localcontext
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.accel.lanes import gather, load, packet, packet_width, peek, select, sqrt, to_int, to_real
from raytrace.accel.vectors import scaled, unit
from raytrace.jit import inlined, kernel
from raytrace.passes.camera import make_view
from raytrace.passes.sampling import film_sample, path_bits, pixel_key, unit_interval
from raytrace.passes.surface import store3
from raytrace.passes.warp import disc
from raytrace.records import Camera

BOX, TENT, GAUSSIAN = range(3)
FILTERS = {"box": BOX, "tent": TENT, "gaussian": GAUSSIAN}
SIGMA, RADIUS = Decimal("0.5"), Decimal(2)  # of the Gaussian, pixels
STEPS = 4096  # of its table
PLACES = 1024  # where its distribution is computed
LENS = 4  # dimension of the pair of random numbers for the lens


class Lens(NamedTuple):
    """What a camera has besides its view, for kernels."""

    across: NDArray[np.floating]  # (3,) f, world units: from the centre of the lens to its right rim
    down: NDArray[np.floating]  # (3,) f, world units: to its lower rim
    numbers: NDArray[
        np.floating
    ]  # (4,) f: distance in focus times a factor; 1 where orthographic; 1 with a lens; the factor
    offsets: NDArray[np.floating]  # (STEPS + 2,) f, pixels: quantiles of the Gaussian; or (2,): of a box or a tent
    filter: NDArray[np.int32]  # (1,) i4: BOX, TENT or GAUSSIAN


def make_lens(camera: Camera, name: str, dtype: Any) -> Lens:
    """Make the lens of a camera, and the filter of its film."""
    view = make_view(camera, (1, 1), np.dtype(np.float64))
    rims = [camera.aperture * axis / np.linalg.norm(axis) for axis in (view.right, view.down)]
    _, exponent = np.frexp(max(camera.focus, camera.aperture))
    small = np.ldexp(1.0, -int(exponent))  # a power of two: squares of directions neither overflow nor change a bit
    numbers = camera.focus * small, camera.height is not None, camera.aperture > 0, small
    offsets = gaussian_quantiles() if name == "gaussian" else np.zeros(2)
    return Lens(
        *(np.asarray(values, dtype) for values in (*rims, numbers, offsets)),
        np.array([FILTERS[name]], np.int32),
    )


@cache
def gaussian_quantiles() -> NDArray[np.float64]:
    """Quantiles k / STEPS of a Gaussian of `SIGMA`, cut off at `RADIUS`; the last one twice.

    The distribution is computed with decimal numbers by its series, and inverted by linear interpolation: the same
    numbers on every machine.
    """
    places = [RADIUS * k / PLACES for k in range(PLACES + 1)]
    shares = np.array([float(_error_function(place / SIGMA)) for place in places])
    positions = np.array([float(place) for place in places])
    wanted = np.arange(STEPS // 2 + 1) / (STEPS // 2) * shares[-1]
    half = np.interp(wanted, shares, positions)
    return np.concatenate([-half[:0:-1], half, half[-1:]])


def _error_function(x: Decimal) -> Decimal:
    """A multiple of erf(x / sqrt 2): the sum of (-1)^n (x / sqrt 2)^(2n + 1) / (n! (2n + 1))."""
    with localcontext() as context:
        context.prec = 40
        square, term, total, n = x * x / 2, x, Decimal(0), 0
        while n < 4 or abs(term) > Decimal("1e-25"):
            total += term / (2 * n + 1)
            n += 1
            term = -term * square / n
        return total


@inlined
def tent(u):
    """Offset whose density is 1 - |x| on -1 .. 1."""
    low = u < 0.5
    size = 1.0 - sqrt(select(low, 2.0 * u, 2.0 - 2.0 * u))
    return select(low, -size, size)


@inlined
def filtered(lens, u):
    """Position within a pixel, or beyond it, of a number in [0, 1)."""
    kind = peek(lens.filter, 0)
    if kind == TENT:
        return 0.5 + tent(u)
    if kind == GAUSSIAN:
        at = u * np.float64(STEPS)
        step = to_int(at)
        low, high = gather(lens.offsets, step), gather(lens.offsets, step + np.int32(1))
        return 0.5 + (low + (at - to_real(step, u)) * (high - low))
    return u


@inlined
def lens_ray(view, lens, x, y, u, v):
    """Origins and unit directions of rays through (x, y), in pixels from the centre of the film, and (u, v)."""
    right, down, forward, origin = view.right, view.down, view.forward, view.origin
    ax = x * right[0] + y * down[0], x * right[1] + y * down[1], x * right[2] + y * down[2]
    ones = x - x + 1.0
    ahead = ones * forward[0], ones * forward[1], ones * forward[2]
    if lens.numbers[1] > 0.0:
        return (ax[0] + origin[0], ax[1] + origin[1], ax[2] + origin[2]), ahead
    d = ahead[0] + ax[0], ahead[1] + ax[1], ahead[2] + ax[2]
    shift = 0.0 * ones, 0.0 * ones, 0.0 * ones
    if lens.numbers[2] > 0.0:
        a, b, _ = disc(u, v)
        across, below = lens.across, lens.down
        shift = a * across[0] + b * below[0], a * across[1] + b * below[1], a * across[2] + b * below[2]
        d, back = scaled(d, lens.numbers[0]), scaled(shift, lens.numbers[3])
        d = d[0] - back[0], d[1] - back[1], d[2] - back[2]
    return (shift[0] + origin[0], shift[1] + origin[1], shift[2] + origin[2]), unit(d)


@kernel
def lens_rays(view, lens, sampler, x, y, samples, rays):
    """Compute origins and directions of rays through samples of pixels; as ``camera_rays``, with a lens or filter."""
    like = packet(rays.d)
    count, n = len(x), len(rays.d) // 3
    first = samples[0]
    for j in range(0, count, packet_width(rays.d)):
        column, row = load(x, j, like), load(y, j, like)
        pixel = pixel_key(sampler.seed, column, row)
        left, top = to_real(column, like) - view.centre[0], to_real(row, like) - view.centre[1]
        for sample in range(first, samples[1]):
            u, v = film_sample(sampler, pixel, sample, like)
            number = (pixel ^ pixel) + np.uint32(sample)
            a, b = path_bits(sampler, pixel, number, LENS)
            a, b = unit_interval(a, like), unit_interval(b, like)
            o, d = lens_ray(view, lens, left + filtered(lens, u), top + filtered(lens, v), a, b)
            at = (sample - first) * count + j
            store3(rays.o, at, n, o)
            store3(rays.d, at, n, d)
