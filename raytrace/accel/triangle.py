"""Rays against triangles: the watertight test, and the Moller-Trumbore test of the course for comparison."""

from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import absolute, bits, fma, maximum, minimum, select
from raytrace.jit import inlined, specialised
from raytrace.records import MollerTrumboreLeaves, WatertightLeaves

GRAZING = 0.125  # slope of a plane to the ray below which rounding can move a hit past the edge of the triangle
MIN_DETERMINANT = 1e-5  # Moller-Trumbore only: the absolute threshold of the course, in user units


class RayFrame(NamedTuple):
    """Rays in permuted axes, with the dominant one last; lanes, or scalars for one ray.

    In these axes the shear x' = x + sx z, y' = y + sy z makes the ray parallel to the z axis.
    """

    ox: float
    oy: float
    oz: float
    dx: float
    dy: float
    dz: float
    sx: float  # -dx / dz
    sy: float  # -dy / dz
    scale: float  # a power of two: d is the user's direction divided by it


class Triangle(NamedTuple):
    """Vertices and unit normal, in the axes of the rays: numbers for one triangle, lanes for the eight of a leaf."""

    v0: tuple  # x, y, z
    v1: tuple
    v2: tuple
    n: tuple


class Crossing(NamedTuple):
    """Where rays and triangles meet; t, u, v are meaningless where the mask is False."""

    inside: bool  # a mask
    t: float
    u: float
    v: float


class ShearedTriangle(NamedTuple):
    """Vertices relative to the origin of rays: numbers, or lanes."""

    a: tuple  # x, y, z of v0 in the axes of the rays
    b: tuple
    c: tuple
    ax: float  # x and y after the shear
    ay: float
    bx: float
    by: float
    cx: float
    cy: float


class PlaneDistance(NamedTuple):
    """Where rays meet the plane of a triangle."""

    t: float  # clamped
    height: float  # world units: of the plane over the origin, along the unit normal
    slope: float  # n . d / d_z


@inlined
def edge(px, py, qx, qy):
    """Twice the signed area of (origin, p, q). Rounding is monotonic, so its sign is exact unless the products tie."""
    return px * qy - py * qx


@inlined
def edge_tie(area, px, py, qx, qy):
    """``area``; where it is zero, the difference of the rounding errors of the products, which has the exact sign."""
    return select(area == 0.0, fma(px, qy, -(px * qy)) - fma(py, qx, -(py * qx)), area)


@inlined
def same_side(u, v, w):
    """Mask where no two of three areas have opposite signs."""
    return (minimum(minimum(u, v), w) >= 0.0) | (maximum(maximum(u, v), w) <= 0.0)


@inlined
def normal_part(n, a):
    """Scalar product n . a, in which each rounding error is relative to the terms that were added."""
    return fma(n[0], a[0], fma(n[1], a[1], n[2] * a[2]))


@inlined
def chord_end(z0, m0, z1, m1, low, high):
    """Widen [low, high] by the z where an edge crosses the plane of ray and normal; m: distances of its ends to it."""
    crosses = ((m0 <= 0.0) & (m1 >= 0.0)) | ((m0 >= 0.0) & (m1 <= 0.0))
    z = fma(m0 / (m0 - m1), z1 - z0, z0)
    z = maximum(minimum(z, maximum(z0, z1)), minimum(z0, z1))
    return minimum(select(crosses, z, np.inf), low), maximum(select(crosses, z, -np.inf), high)


@inlined
def shear(frame: RayFrame, triangle: Triangle) -> ShearedTriangle:
    """Move the origin of rays to zero, and shear triangles so that the rays are parallel to the z axis."""
    v0, v1, v2, _ = triangle
    a = v0[0] - frame.ox, v0[1] - frame.oy, v0[2] - frame.oz
    b = v1[0] - frame.ox, v1[1] - frame.oy, v1[2] - frame.oz
    c = v2[0] - frame.ox, v2[1] - frame.oy, v2[2] - frame.oz
    ax, ay = fma(frame.sx, a[2], a[0]), fma(frame.sy, a[2], a[1])
    bx, by = fma(frame.sx, b[2], b[0]), fma(frame.sy, b[2], b[1])
    cx, cy = fma(frame.sx, c[2], c[0]), fma(frame.sy, c[2], c[1])
    return ShearedTriangle(a, b, c, ax, ay, bx, by, cx, cy)


@inlined
def plane_distance(frame: RayFrame, n, sheared: ShearedTriangle, weights, inside) -> PlaneDistance:
    """Distance to the plane of a triangle along rays that pass inside its edges; ``inside`` is their mask.

    It comes from the plane, because the barycentric weights alone are too inaccurate in slivers: every vertex has the
    same height n . (v - o) over the origin, so z = height / (n . d / d_z). The vertex nearest to the hit has the
    largest weight. z is clamped to the range of the triangle's vertices; where the ray grazes the plane, to the chord
    of the triangle below the ray. Not where all three heights are 0: there the ray starts in the plane and leaves it at
    z = 0, but the chord of a neighbouring triangle may begin just beyond.
    """
    a, b, c, ax, ay, bx, by, cx, cy = sheared
    u, v, w = weights
    height_a, height_b, height_c = normal_part(n, a), normal_part(n, b), normal_part(n, c)
    height = fma(u, height_a, fma(v, height_b, w * height_c))
    slope = n[2] - fma(n[0], frame.sx, n[1] * frame.sy)
    z = height / slope
    low = minimum(minimum(a[2], b[2]), c[2])
    high = maximum(maximum(a[2], b[2]), c[2])
    grazing = inside & (absolute(slope) < GRAZING)
    if bits(grazing) != 0:
        grazing = grazing & ((height_a != 0.0) | (height_b != 0.0) | (height_c != 0.0))
        p, q, r = ax * n[1] - ay * n[0], bx * n[1] - by * n[0], cx * n[1] - cy * n[0]
        first, last = chord_end(a[2], p, b[2], q, np.inf, -np.inf)
        first, last = chord_end(b[2], q, c[2], r, first, last)
        first, last = chord_end(c[2], r, a[2], p, first, last)
        grazing = grazing & (first <= last)
        low, high = select(grazing, first, low), select(grazing, last, high)
    return PlaneDistance(maximum(minimum(z, high), low) / frame.dz, height, slope)


@inlined
def watertight(frame: RayFrame, triangle: Triangle) -> Crossing:
    """Watertight test of rays and triangles.

    Inclusion after Woop, Benthin and Wald 2013: neighbouring triangles use the same sheared vertices, and so agree
    exactly about their shared edge.
    """
    sheared = shear(frame, triangle)
    _, _, _, ax, ay, bx, by, cx, cy = sheared
    u = edge(cx, cy, bx, by)
    v = edge(ax, ay, cx, cy)
    w = edge(bx, by, ax, ay)
    inside = same_side(u, v, w)
    if bits(inside) == 0:
        return Crossing(inside, u, v, w)
    if bits(inside & ((u == 0.0) | (v == 0.0) | (w == 0.0))) != 0:
        u = edge_tie(u, cx, cy, bx, by)
        v = edge_tie(v, ax, ay, cx, cy)
        w = edge_tie(w, bx, by, ax, ay)
        inside = same_side(u, v, w)
    scale = 1.0 / (u + v + w)
    inside = inside & (absolute(scale) < np.inf)  # inf: the ray lies in the plane, to rounding; NaN: a miss
    u = u * scale
    v = v * scale
    w = w * scale
    return Crossing(inside, plane_distance(frame, triangle.n, sheared, (u, v, w), inside).t, v, w)


@inlined
def moller_trumbore(frame: RayFrame, triangle: Triangle) -> Crossing:
    """Test of Moller and Trumbore 1997 with the threshold of the course: small or grazed triangles are missed."""
    v0, v1, v2, _ = triangle
    e1x, e1y, e1z = v1[0] - v0[0], v1[1] - v0[1], v1[2] - v0[2]
    e2x, e2y, e2z = v2[0] - v0[0], v2[1] - v0[1], v2[2] - v0[2]
    px = frame.dy * e2z - frame.dz * e2y
    py = frame.dz * e2x - frame.dx * e2z
    pz = frame.dx * e2y - frame.dy * e2x
    det = e1x * px + e1y * py + e1z * pz
    scale = 1.0 / det
    sx, sy, sz = frame.ox - v0[0], frame.oy - v0[1], frame.oz - v0[2]
    u = (sx * px + sy * py + sz * pz) * scale
    qx = sy * e1z - sz * e1y
    qy = sz * e1x - sx * e1z
    qz = sx * e1y - sy * e1x
    v = (frame.dx * qx + frame.dy * qy + frame.dz * qz) * scale
    inside = (absolute(det) * frame.scale >= MIN_DETERMINANT) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
    return Crossing(inside, (e2x * qx + e2y * qy + e2z * qz) * scale, u, v)


def intersect(leaves, frame: RayFrame, triangle: Triangle) -> Crossing:
    """Test rays and triangles, by the test that belongs to the type of the leaves."""
    test = watertight if isinstance(leaves, WatertightLeaves) else moller_trumbore
    return test(frame, triangle)


@specialised(intersect)
def _intersect(leaves, frame, triangle):
    test = {WatertightLeaves: watertight, MollerTrumboreLeaves: moller_trumbore}[leaves.instance_class]
    return lambda leaves, frame, triangle: test(frame, triangle)
