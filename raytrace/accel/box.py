"""Rays against boxes: the slab test, rounded outward so that it never loses what the triangle test would hit."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import absolute, fma, lane_max, lane_min, maximum, minimum, select, splat
from raytrace.jit import inlined


class Slabs(NamedTuple):
    """What the slab test needs of rays; lanes, or scalars for one ray.

    A plane at x is met at t = (x - o) / d, computed as fma(x, i, c) with i = 1 / d and c = -o / d. Both carry rounding
    errors, so there is a pair (i, c) that rounds t down, for near planes, and one that rounds it up, for far planes:
    no box pays for it [Ize2013].
    """

    near_ix: float
    near_iy: float
    near_iz: float
    near_cx: float
    near_cy: float
    near_cz: float
    far_ix: float
    far_iy: float
    far_iz: float
    far_cx: float
    far_cy: float
    far_cz: float


@inlined
def slab_axis(o, d, eps):
    """The pairs (i, c) of one axis, near and far; ``eps`` is the machine epsilon of o and d.

    The reciprocal and the fma each err by at most eps / 2 relative to t, so 2 eps covers both; the product o i errs by
    eps / 2 of itself, which does not shrink with t, so it is allowed for on its own. Where t < 0 the factor goes the
    wrong way, by 3 eps |t| <= 3 eps (|x i| + |o i|): boxes are widened by more than the first, and 5 eps |o i| covers
    the second too. Components below eps^3 count as that: o / d must not overflow, and so little bends no ray.
    """
    least = eps * eps * eps
    d = select(d < 0.0, minimum(d, -least), maximum(d, least))
    i = 1.0 / d
    near_i = i * (1.0 - 2.0 * eps)
    far_i = i * (1.0 + 2.0 * eps)
    near_c = -(o * near_i)
    far_c = -(o * far_i)
    return near_i, far_i, near_c - absolute(near_c) * (5.0 * eps), far_c + absolute(far_c) * (5.0 * eps)


@inlined
def make_slabs(o, d, eps):
    """Slabs of rays of ordinary length."""
    near_ix, far_ix, near_cx, far_cx = slab_axis(o[0], d[0], eps)
    near_iy, far_iy, near_cy, far_cy = slab_axis(o[1], d[1], eps)
    near_iz, far_iz, near_cz, far_cz = slab_axis(o[2], d[2], eps)
    return Slabs(
        near_ix, near_iy, near_iz, near_cx, near_cy, near_cz, far_ix, far_iy, far_iz, far_cx, far_cy, far_cz
    )  # fmt: skip


@inlined
def slab_test(slabs, near, far, tmin, tmax):
    """Where rays enter boxes, and a mask of those that meet them within [tmin, tmax].

    ``near`` and ``far`` are the x, y, z of the planes that face the rays and of those behind. The operands stand so
    that a NaN (0 * inf) loses every comparison: at worst a box is visited for nothing.
    """
    x_in = fma(near[0], slabs.near_ix, slabs.near_cx)
    y_in = fma(near[1], slabs.near_iy, slabs.near_cy)
    z_in = fma(near[2], slabs.near_iz, slabs.near_cz)
    x_out = fma(far[0], slabs.far_ix, slabs.far_cx)
    y_out = fma(far[1], slabs.far_iy, slabs.far_cy)
    z_out = fma(far[2], slabs.far_iz, slabs.far_cz)
    t_in = maximum(maximum(x_in, y_in), maximum(z_in, tmin))
    t_out = minimum(minimum(x_out, y_out), minimum(z_out, tmax))
    return t_in, t_in <= t_out


class Beam(NamedTuple):
    """Bounds of the origins and reciprocal directions of a packet of rays with the same signs; numbers."""

    near_ox: float  # the origin that is nearest to planes ahead
    near_oy: float
    near_oz: float
    far_ox: float
    far_oy: float
    far_oz: float
    low_ix: float
    low_iy: float
    low_iz: float
    high_ix: float
    high_iy: float
    high_iz: float
    tmin: float


@inlined
def beam_axis(o, slab_near_i, slab_far_i, alive, eps):
    """Nearest and farthest origin, least and greatest reciprocal direction of the rays alive, rounded outward."""
    low_o, high_o = lane_min(select(alive, o, np.inf)), lane_max(select(alive, o, -np.inf))
    low_i, high_i = lane_min(select(alive, slab_near_i, np.inf)), lane_max(select(alive, slab_far_i, -np.inf))
    if high_i > 0.0:
        return high_o, low_o, low_i, high_i
    low_i, high_i = lane_min(select(alive, slab_far_i, np.inf)), lane_max(select(alive, slab_near_i, -np.inf))
    return low_o, high_o, low_i, high_i


@inlined
def make_beam(o, slabs, tmin, alive, eps):
    """Beam of the rays alive."""
    near_ox, far_ox, low_ix, high_ix = beam_axis(o[0], slabs.near_ix, slabs.far_ix, alive, eps)
    near_oy, far_oy, low_iy, high_iy = beam_axis(o[1], slabs.near_iy, slabs.far_iy, alive, eps)
    near_oz, far_oz, low_iz, high_iz = beam_axis(o[2], slabs.near_iz, slabs.far_iz, alive, eps)
    return Beam(
        near_ox, near_oy, near_oz, far_ox, far_oy, far_oz, low_ix, low_iy, low_iz, high_ix, high_iy, high_iz,
        lane_min(select(alive, tmin, np.inf)),
    )  # fmt: skip


@inlined
def wide_beam(like):
    """A beam that meets every box, where finding out costs more than it saves."""
    zero, huge = lane_min(splat(0.0, like)), lane_max(splat(1e30, like))
    return Beam(zero, zero, zero, zero, zero, zero, -huge, -huge, -huge, huge, huge, huge, -huge)


@inlined
def beam_test(beam, near, far, tmax):
    """Mask of the boxes that any ray of a packet may meet: (plane - o) / d in interval arithmetic."""
    x, y, z = near[0] - beam.near_ox, near[1] - beam.near_oy, near[2] - beam.near_oz
    x_in = minimum(x * beam.low_ix, x * beam.high_ix)
    y_in = minimum(y * beam.low_iy, y * beam.high_iy)
    z_in = minimum(z * beam.low_iz, z * beam.high_iz)
    x, y, z = far[0] - beam.far_ox, far[1] - beam.far_oy, far[2] - beam.far_oz
    x_out = maximum(x * beam.low_ix, x * beam.high_ix)
    y_out = maximum(y * beam.low_iy, y * beam.high_iy)
    z_out = maximum(z * beam.low_iz, z * beam.high_iz)
    t_in = maximum(maximum(x_in, y_in), maximum(z_in, beam.tmin))
    t_out = minimum(minimum(x_out, y_out), minimum(z_out, tmax))
    return t_in <= t_out
