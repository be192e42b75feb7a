"""Rays against boxes: the slab test, rounded outward so that it never loses what the triangle test would hit."""

from typing import NamedTuple

from raytrace.accel.lanes import absolute, fma, maximum, minimum, select
from raytrace.jit import inlined

MIN_DIRECTION = 2.0**-60  # of directions of ordinary length: smaller components would make o / d overflow


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
    eps / 2 of itself, which does not shrink with t, so it is allowed for on its own.
    """
    d = select(d < 0.0, minimum(d, -MIN_DIRECTION), maximum(d, MIN_DIRECTION))
    i = 1.0 / d
    near_i = i * (1.0 - 2.0 * eps)
    far_i = i * (1.0 + 2.0 * eps)
    near_c = -(o * near_i)
    far_c = -(o * far_i)
    return near_i, far_i, near_c - absolute(near_c) * eps, far_c + absolute(far_c) * eps


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
