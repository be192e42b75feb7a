"""Octants and dominant axes of rays: rays that share both read a node and a leaf in the same way.

The octant of a ray is the signs of its direction: they decide which plane of a box is near. The dominant axis is that
of the largest component of the direction: the triangle test puts it last.
"""

from typing import NamedTuple

from raytrace.accel.box import Slabs
from raytrace.accel.lanes import absolute, bits
from raytrace.accel.triangle import RayFrame
from raytrace.jit import inlined


class Octants(NamedTuple):
    """Octants and dominant axes of the rays in a register: in each number, bit k belongs to lane k."""

    negative_x: int
    negative_y: int
    negative_z: int
    dominant_x: int
    dominant_y: int  # where neither x nor y is dominant, z is


class Axes(NamedTuple):
    """Offsets of planes in a node and of vertices in a leaf, for rays that share an octant and a dominant axis."""

    near_x: int  # first of the eight planes that face the rays; the far planes are the others
    near_y: int
    near_z: int
    x: int  # first of the eight x, y, z of a vertex; z here is the dominant axis of the rays
    y: int
    z: int


class RayPacket(NamedTuple):
    """Rays that share an octant and a dominant axis: lanes for a packet, numbers for a single ray."""

    slabs: Slabs
    frame: RayFrame
    axes: Axes
    tmin: float


@inlined
def octants_of(d) -> Octants:
    """Octants and dominant axes of directions."""
    ax, ay, az = absolute(d[0]), absolute(d[1]), absolute(d[2])
    on_x = (ax >= ay) & (ax >= az)
    return Octants(bits(d[0] < 0.0), bits(d[1] < 0.0), bits(d[2] < 0.0), bits(on_x), bits(~on_x & (ay >= az)))


@inlined
def same_octant_and_axis(octants: Octants, k: int) -> int:
    """Bits of the lanes that share the octant and the dominant axis of lane k."""
    same = -1
    for flags in octants:
        same &= flags if flags >> k & 1 else ~flags
    return same


@inlined
def axes_of(octants: Octants, k: int):
    """Dominant axis (0, 1, 2) of the ray in lane k, and its ``Axes``."""
    dominant = 0 if octants.dominant_x >> k & 1 else 1 if octants.dominant_y >> k & 1 else 2
    axes = Axes(
        24 if octants.negative_x >> k & 1 else 0,
        32 if octants.negative_y >> k & 1 else 8,
        40 if octants.negative_z >> k & 1 else 16,
        8 * ((dominant + 1) % 3), 8 * ((dominant + 2) % 3), 8 * dominant,
    )  # fmt: skip
    return dominant, axes


@inlined
def permute(dominant: int, a):
    """Components of a vector in cyclic order, with the dominant one last."""
    if dominant == 0:
        return a[1], a[2], a[0]
    if dominant == 1:
        return a[2], a[0], a[1]
    return a


@inlined
def make_ray_frame(dominant: int, o, d, scale) -> RayFrame:
    """Frame of rays that share their dominant axis."""
    ox, oy, oz = permute(dominant, o)
    dx, dy, dz = permute(dominant, d)
    return RayFrame(ox, oy, oz, dx, dy, dz, -(dx / dz), -(dy / dz), scale)
