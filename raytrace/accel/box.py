"""Rays against boxes: the slab test, rounded outward so that it never misses a box that holds a hit."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import absolute, fma, lane_max, lane_min, maximum, minimum, select, splat
from raytrace.jit import inlined


class Slabs(NamedTuple):
    """Factors of the slab test; lanes, or scalars for one ray.

    A ray meets a plane at x where t = (x - o) / d, computed as fma(x, i, c) with i = 1 / d and c = -o / d. Both numbers
    carry rounding errors. So there are two pairs (i, c): one rounds t down, for near planes, and one rounds t up, for
    far planes. The test itself takes no longer for it [Ize2013].
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


class SlabAxis(NamedTuple):
    """The two pairs (i, c) of one axis; see ``Slabs``."""

    near_i: float
    far_i: float
    near_c: float
    far_c: float


@inlined
def slab_axis(o, d, eps) -> SlabAxis:
    """The two pairs (i, c) of one axis; ``eps`` is the machine epsilon of o and d.

    The reciprocal and the fma each have an error of at most eps / 2 relative to t, so 2 eps covers both. The product
    o i has an error of eps / 2 relative to itself, which does not shrink with t, so it gets a term of its own. Where
    t < 0, the factor rounds in the wrong direction, by 3 eps |t| <= 3 eps (|x i| + |o i|). Boxes are widened by more
    than the first term, and 5 eps |o i| covers the second. Components below eps^3 are replaced by eps^3, so that o / d
    cannot overflow. The difference is too small to change which boxes are met.
    """
    least = eps * eps * eps
    d = select(d < 0.0, minimum(d, -least), maximum(d, least))
    i = 1.0 / d
    near_i = i * (1.0 - 2.0 * eps)
    far_i = i * (1.0 + 2.0 * eps)
    near_c = -(o * near_i)
    far_c = -(o * far_i)
    return SlabAxis(near_i, far_i, near_c - absolute(near_c) * (5.0 * eps), far_c + absolute(far_c) * (5.0 * eps))


@inlined
def make_slabs(o, d, eps) -> Slabs:
    """Slabs of rays whose directions are of ordinary length."""
    x, y, z = slab_axis(o[0], d[0], eps), slab_axis(o[1], d[1], eps), slab_axis(o[2], d[2], eps)
    return Slabs(
        x.near_i, y.near_i, z.near_i, x.near_c, y.near_c, z.near_c,
        x.far_i, y.far_i, z.far_i, x.far_c, y.far_c, z.far_c,
    )  # fmt: skip


@inlined
def slab_test(slabs: Slabs, near, far, tmin, tmax):
    """Distances at which rays enter boxes, and a mask of the boxes that are met within [tmin, tmax].

    ``near`` are the x, y, z of the planes that face the rays, ``far`` those of the planes behind. The operands are
    ordered so that a NaN (0 * inf) loses every comparison: at worst a box is visited unnecessarily.
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


class PacketBounds(NamedTuple):
    """Bounds of the origins and reciprocal directions of a packet whose rays share an octant; numbers."""

    near_ox: float  # of all origins, the coordinate that is nearest to planes ahead
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


class AxisBounds(NamedTuple):
    """Bounds of the origins and reciprocal directions of a packet along one axis."""

    near_o: float
    far_o: float
    low_i: float
    high_i: float


@inlined
def axis_bounds(o, slab_near_i, slab_far_i, alive, eps) -> AxisBounds:
    """Bounds along one axis of the rays alive, rounded outward."""
    low_o, high_o = lane_min(select(alive, o, np.inf)), lane_max(select(alive, o, -np.inf))
    low_i, high_i = lane_min(select(alive, slab_near_i, np.inf)), lane_max(select(alive, slab_far_i, -np.inf))
    if high_i > 0.0:
        return AxisBounds(high_o, low_o, low_i, high_i)
    low_i, high_i = lane_min(select(alive, slab_far_i, np.inf)), lane_max(select(alive, slab_near_i, -np.inf))
    return AxisBounds(low_o, high_o, low_i, high_i)


@inlined
def make_packet_bounds(o, slabs: Slabs, tmin, alive, eps) -> PacketBounds:
    """Bounds of the rays alive."""
    x = axis_bounds(o[0], slabs.near_ix, slabs.far_ix, alive, eps)
    y = axis_bounds(o[1], slabs.near_iy, slabs.far_iy, alive, eps)
    z = axis_bounds(o[2], slabs.near_iz, slabs.far_iz, alive, eps)
    return PacketBounds(
        x.near_o, y.near_o, z.near_o, x.far_o, y.far_o, z.far_o,
        x.low_i, y.low_i, z.low_i, x.high_i, y.high_i, z.high_i,
        lane_min(select(alive, tmin, np.inf)),
    )  # fmt: skip


@inlined
def endless_packet_bounds(like) -> PacketBounds:
    """Bounds that meet every box, for trees where the test costs more than it saves."""
    zero, huge = lane_min(splat(0.0, like)), lane_max(splat(1e30, like))
    return PacketBounds(zero, zero, zero, zero, zero, zero, -huge, -huge, -huge, huge, huge, huge, -huge)


@inlined
def bounds_test(packet_bounds: PacketBounds, near, far, tmax):
    """Mask of the boxes that any ray of a packet may meet: (plane - o) / d in interval arithmetic."""
    x, y, z = near[0] - packet_bounds.near_ox, near[1] - packet_bounds.near_oy, near[2] - packet_bounds.near_oz
    x_in = minimum(x * packet_bounds.low_ix, x * packet_bounds.high_ix)
    y_in = minimum(y * packet_bounds.low_iy, y * packet_bounds.high_iy)
    z_in = minimum(z * packet_bounds.low_iz, z * packet_bounds.high_iz)
    x, y, z = far[0] - packet_bounds.far_ox, far[1] - packet_bounds.far_oy, far[2] - packet_bounds.far_oz
    x_out = maximum(x * packet_bounds.low_ix, x * packet_bounds.high_ix)
    y_out = maximum(y * packet_bounds.low_iy, y * packet_bounds.high_iy)
    z_out = maximum(z * packet_bounds.low_iz, z * packet_bounds.high_iz)
    t_in = maximum(maximum(x_in, y_in), maximum(z_in, packet_bounds.tmin))
    t_out = minimum(minimum(x_out, y_out), minimum(z_out, tmax))
    return t_in <= t_out
