"""The frustum of a bundle: no ray of the bundle can hit what lies outside.

Rays with one dominant axis z, and one sense along it, are straight lines x(z), y(z). Between two planes of constant z,
all of them lie between the straight lines through their extremes on both planes. So a box or triangle that lies
entirely beyond one of these four lines can be skipped, eight at a time [Reshetov2005].
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import (
    NODE,
    fma,
    group_max,
    group_min,
    group_size,
    lane_max,
    lane_min,
    lane_numbers,
    load,
    machine_epsilon,
    maximum,
    minimum,
    packet,
    peek,
    select,
    splat,
)
from raytrace.accel.layout import V0, V1, V2
from raytrace.accel.octants import Axes
from raytrace.accel.scratch import FRAME_DZ, FRAME_SX, FRAME_X, FRAME_Z, TMAX, TMIN, read_row
from raytrace.jit import inlined
from raytrace.work_records import Work

HIGH = 3 * NODE  # from the low planes of a node's boxes to the high ones
FRUSTUM_ROUNDINGS = 16.0  # machine epsilons of the largest coordinate: twice what rounding moves lines and triangles by
SHORTEST = 2.0**-10  # of the scene's size: the least distance between the two planes
# Sides of a usual leaf: where the widths at both ends have a larger sum, packets are faster. Of nearest hits, of any.
NARROW, NARROW_ANY = 12.0, 6.0


class Line(NamedTuple):
    """x = at + slope z; numbers, or lanes."""

    at: float
    slope: float


class Frustum(NamedTuple):
    """Bounds of rays in their own axes, with the dominant one as z."""

    low_x: Line
    high_x: Line
    low_y: Line
    high_y: Line
    sense: float  # 1 or -1: along the dominant axis, or against it
    start: float  # sense * z where the first ray begins
    margin: float  # world units: bound on the error of heights


class Frusta(NamedTuple):
    """Frusta of a bundle."""

    whole: Frustum  # of all rays: numbers
    groups: Frustum  # of each group of rays: lanes
    narrow: bool  # whether the bundle is narrow enough for frusta to pay


class Heights(NamedTuple):
    """Bounds of the heights z at which rays begin and end."""

    start_low: float
    start_high: float
    end_low: float
    end_high: float


class Extremes(NamedTuple):
    """Bounds of x, or of y, of each group of rays on the planes z0 and z1: lanes."""

    low0: float
    high0: float
    low1: float
    high1: float


@inlined
def heights(count: int, work: Work) -> Heights:
    """Bounds of the heights at which the rays alive of a bundle begin and end."""
    like = packet(work.lanes)
    low, end_low = splat(np.inf, like), splat(np.inf, like)
    high, end_high = splat(-np.inf, like), splat(-np.inf, like)
    for r in range(count):
        tmax = read_row(work, r, TMAX, like)
        alive = read_row(work, r, TMIN, like) < tmax
        z = read_row(work, r, FRAME_Z, like)
        end = fma(tmax, read_row(work, r, FRAME_DZ, like), z)
        low, high = select(alive, minimum(z, low), low), select(alive, maximum(z, high), high)
        end_low = select(alive, minimum(end, end_low), end_low)
        end_high = select(alive, maximum(end, end_high), end_high)
    return Heights(lane_min(low), lane_max(high), lane_min(end_low), lane_max(end_high))


@inlined
def extremes(axis: int, z0, z1, count: int, work: Work) -> Extremes:
    """Bounds of x (axis 0) or y (axis 1) of each group of rays on the planes z0 and z1.

    Lane m + group_size * k is group k of packet m.
    """
    like = packet(work.lanes)
    low0, low1 = splat(np.inf, like), splat(np.inf, like)
    high0, high1 = splat(-np.inf, like), splat(-np.inf, like)
    member = lane_numbers(like) & np.int32(group_size(work.lanes) - 1)
    for r in range(count):
        alive = read_row(work, r, TMIN, like) < read_row(work, r, TMAX, like)
        x, z = read_row(work, r, FRAME_X + axis, like), read_row(work, r, FRAME_Z, like)
        shear = read_row(work, r, FRAME_SX + axis, like)
        x0, x1 = fma(shear, z - z0, x), fma(shear, z - z1, x)
        mine = member == np.int32(r)
        low0 = select(mine, group_min(select(alive, x0, np.inf)), low0)
        low1 = select(mine, group_min(select(alive, x1, np.inf)), low1)
        high0 = select(mine, group_max(select(alive, x0, -np.inf)), high0)
        high1 = select(mine, group_max(select(alive, x1, -np.inf)), high1)
    return Extremes(low0, high0, low1, high1)


@inlined
def line(first, last, z0, z1, shift) -> Line:
    """The line through (first, z0) and (last, z1), shifted."""
    slope = (last - first) / (z1 - z0)
    return Line((first - slope * z0) + shift, slope)


@inlined
def size_of(extent):
    """Largest |coordinate| and largest side of the bounds of a tree."""
    largest, size = 0.0, 0.0
    for axis in range(3):
        low, high = peek(extent, axis), peek(extent, 3 + axis)
        largest, size = max(largest, max(-low, high)), max(size, high - low)
    return largest, size


@inlined
def planes_between(extent, dominant: int, sense, heights: Heights, size):
    """Two heights between which rays can meet anything of the tree."""
    low, high = peek(extent, dominant), peek(extent, 3 + dominant)
    if sense > 0.0:
        return heights.start_low, max(min(heights.end_high, high), heights.start_low + size * SHORTEST)
    return heights.start_high, min(max(heights.end_low, low), heights.start_high - size * SHORTEST)


@inlined
def make_frusta(extent, dominant: int, sense, count: int, nearest: bool, work: Work) -> Frusta:
    """Frusta of the rays alive of a bundle, for nearest hits or for any.

    The triangle test has the rounding error of sheared vertices, and a line that of the two points that it is computed
    from. Together they are at most 8 machine epsilons of the largest coordinate, because shears are at most 1
    (docs/numerics.md). Each line is shifted by more than that, in x and in z.
    """
    ends = heights(count, work)
    largest, size = size_of(extent)
    z0, z1 = planes_between(extent, dominant, sense, ends, size)
    x, y = extremes(0, z0, z1, count, work), extremes(1, z0, z1, count, work)
    xl0, xh0, xl1, xh1 = lane_min(x.low0), lane_max(x.high0), lane_min(x.low1), lane_max(x.high1)
    yl0, yh0, yl1, yh1 = lane_min(y.low0), lane_max(y.high0), lane_min(y.low1), lane_max(y.high1)
    leaf = peek(extent, 6)
    narrow = max(xh0 - xl0, yh0 - yl0) + max(xh1 - xl1, yh1 - yl1) <= leaf * (NARROW if nearest else NARROW_ANY)
    steepest = max(max(xh1 - xl0, xh0 - xl1), max(yh1 - yl0, yh0 - yl1)) / abs(z1 - z0)
    largest = largest + max(-ends.start_low, ends.start_high) + max(max(-xl0, xh0), max(-yl0, yh0))
    margin = largest * (FRUSTUM_ROUNDINGS * machine_epsilon(work.lanes))
    shift, start = margin * (1.0 + steepest), z0 * sense - margin
    whole = Frustum(
        line(xl0, xl1, z0, z1, -shift), line(xh0, xh1, z0, z1, shift),
        line(yl0, yl1, z0, z1, -shift), line(yh0, yh1, z0, z1, shift), sense, start, margin,
    )  # fmt: skip
    groups = Frustum(
        line(x.low0, x.low1, z0, z1, -shift), line(x.high0, x.high1, z0, z1, shift),
        line(y.low0, y.low1, z0, z1, -shift), line(y.high0, y.high1, z0, z1, shift), sense, start, margin,
    )  # fmt: skip
    return Frusta(whole, groups, narrow)


@inlined
def height_where_lowest(slope, axes: Axes):
    """Offset of the z planes of boxes on which a line of that slope is lowest."""
    return axes.z if slope > 0.0 else axes.z + HIGH


@inlined
def boxes_in(bounds, at: int, frustum: Frustum, axes: Axes, end):
    """Mask of the eight boxes of a node that meet a frustum before sense * z = end; and sense * z where they begin."""
    near = axes.z if frustum.sense > 0.0 else axes.z + HIGH
    far = axes.z + HIGH if frustum.sense > 0.0 else axes.z
    first, last = load(bounds, at + near, NODE) * frustum.sense, load(bounds, at + far, NODE) * frustum.sense
    inside = (first <= end) & (last >= frustum.start)
    z = load(bounds, at + height_where_lowest(frustum.low_x.slope, axes), NODE)
    inside = inside & (load(bounds, at + axes.x + HIGH, NODE) >= fma(z, frustum.low_x.slope, frustum.low_x.at))
    z = load(bounds, at + height_where_lowest(-frustum.high_x.slope, axes), NODE)
    inside = inside & (load(bounds, at + axes.x, NODE) <= fma(z, frustum.high_x.slope, frustum.high_x.at))
    z = load(bounds, at + height_where_lowest(frustum.low_y.slope, axes), NODE)
    inside = inside & (load(bounds, at + axes.y + HIGH, NODE) >= fma(z, frustum.low_y.slope, frustum.low_y.at))
    z = load(bounds, at + height_where_lowest(-frustum.high_y.slope, axes), NODE)
    inside = inside & (load(bounds, at + axes.y, NODE) <= fma(z, frustum.high_y.slope, frustum.high_y.at))
    return inside, first


@inlined
def between(low, high, low_z, high_z, low_line: Line, high_line: Line):
    """Mask of the groups between whose lines a part of the rectangle low .. high in x, low_z .. high_z in z lies."""
    lowest = minimum(fma(low_line.slope, low_z, low_line.at), fma(low_line.slope, high_z, low_line.at))
    highest = maximum(fma(high_line.slope, low_z, high_line.at), fma(high_line.slope, high_z, high_line.at))
    return (lowest <= high) & (highest >= low)


@inlined
def groups_at(bounds, at: int, groups: Frustum, axes: Axes, ends):
    """Mask of the groups of a bundle whose frusta meet one box before sense * z = ends."""
    low_z, high_z = peek(bounds, at + axes.z), peek(bounds, at + axes.z + HIGH)
    first = low_z if groups.sense > 0.0 else -high_z
    x = between(peek(bounds, at + axes.x), peek(bounds, at + axes.x + HIGH), low_z, high_z, groups.low_x, groups.high_x)
    y = between(peek(bounds, at + axes.y), peek(bounds, at + axes.y + HIGH), low_z, high_z, groups.low_y, groups.high_y)
    return x & y & (ends >= first)


@inlined
def relative(rows, vertex: int, x: int, z: int, slope):
    """Distance x - slope z of one vertex of each of eight triangles from a line through the origin."""
    return fma(load(rows, vertex + z, NODE), -slope, load(rows, vertex + x, NODE))


@inlined
def triangles_between(rows, at: int, x: int, z: int, low: Line, high: Line):
    """Mask of the eight triangles that have a vertex on or above the low line, and one on or below the high one."""
    a, b = relative(rows, at + V0, x, z, low.slope), relative(rows, at + V1, x, z, low.slope)
    c = relative(rows, at + V2, x, z, low.slope)
    above = maximum(maximum(a, b), c) >= low.at
    a, b = relative(rows, at + V0, x, z, high.slope), relative(rows, at + V1, x, z, high.slope)
    c = relative(rows, at + V2, x, z, high.slope)
    return above & (minimum(minimum(a, b), c) <= high.at)


@inlined
def triangles_in(rows, at: int, frustum: Frustum, axes: Axes):
    """Mask of the eight triangles of a leaf that are not entirely beyond one side of a frustum."""
    x = triangles_between(rows, at, axes.x, axes.z, frustum.low_x, frustum.high_x)
    return x & triangles_between(rows, at, axes.y, axes.z, frustum.low_y, frustum.high_y)


@inlined
def triangles_on_the_way(rows, at: int, frustum: Frustum, axes: Axes, end):
    """The same, without triangles that are entirely before the first ray begins, or beyond sense * z = end."""
    a, b = load(rows, at + V0 + axes.z, NODE) * frustum.sense, load(rows, at + V1 + axes.z, NODE) * frustum.sense
    c = load(rows, at + V2 + axes.z, NODE) * frustum.sense
    within = (minimum(minimum(a, b), c) <= end) & (maximum(maximum(a, b), c) >= frustum.start)
    return within & triangles_in(rows, at, frustum, axes)
