"""Crossings of rays and a closed surface: each counts once, so that their parity is exact.

The ray's line is moved by (h, h^2, 0) in its own axes, the dominant one last, for an infinitely small h > 0
[Edelsbrunner1990]. The moved line meets no vertex and no edge, and crosses a triangle if it passes all three edges on
the same side. For the edge from a to b, both relative to the origin o, that side is the sign of

    d . (a x b) + h (d x (b - a))_x + h^2 (d x (b - a))_y

Lanes compute the first term with a bound on its rounding error, and whether the plane lies before the origin. What they
cannot decide is decided one by one in exact arithmetic. docs/numerics.md has the proof that the parity is exact.
"""

from raytrace.accel.hit_work import HitWork
from raytrace.accel.lanes import (
    absolute,
    bits,
    machine_epsilon,
    machine_largest,
    maximum,
    minimum,
)
from raytrace.accel.triangle import Crossing, RayFrame, Triangle, edge, plane_distance, shear
from raytrace.jit import inlined
from raytrace.records import Tree

SHEAR_ERROR = 4.0  # machine epsilons of the reach: bound on the error of a sheared coordinate
EDGE_ERROR = 8.0  # times that: bound on the error of an edge function, per size of the sheared triangle
HEIGHT_ERROR = 16.0  # machine epsilons of the reach: bound on the error of the height of a plane
SLOPE_ERROR = 8.0  # machine epsilons: bound on the error of n . d / d_z


@inlined
def meet_crossing(tree: Tree, frame: RayFrame, triangle: Triangle, reach, work: HitWork):
    """Where rays cross triangles of a closed surface, and a mask of those that must be decided exactly."""
    sheared = shear(frame, triangle)
    _, _, _, ax, ay, bx, by, cx, cy = sheared
    u, v, w = edge(cx, cy, bx, by), edge(ax, ay, cx, cy), edge(bx, by, ax, ay)
    x = maximum(maximum(absolute(ax), absolute(bx)), absolute(cx))
    y = maximum(maximum(absolute(ay), absolute(by)), absolute(cy))
    delta = reach * (SHEAR_ERROR * machine_epsilon(work.lanes))
    bound = (maximum(x, y) + delta) * (delta * EDGE_ERROR) + 4.0 / machine_largest(work.lanes)
    above = (u > bound) | (v > bound) | (w > bound)
    below = (u < -bound) | (v < -bound) | (w < -bound)
    possible = ~(above & below)
    if bits(possible) == 0:
        return Crossing(possible, u, v, w), possible
    sure = (u > bound) & (v > bound) & (w > bound) | (u < -bound) & (v < -bound) & (w < -bound)
    scale = 1.0 / (u + v + w)
    u, v, w = u * scale, v * scale, w * scale
    t, height, slope = plane_distance(frame, triangle.n, sheared, (u, v, w), sure)
    sign = height / slope / frame.dz
    largest = machine_largest(work.lanes)
    t = maximum(minimum(t / frame.scale, largest), -largest)
    sure = sure & (absolute(height) > reach * (HEIGHT_ERROR * machine_epsilon(work.lanes)))
    sure = sure & (absolute(slope) > SLOPE_ERROR * machine_epsilon(work.lanes))
    sure = sure & ((sign > 0.0) & (t > 0.0) | (sign < 0.0) & (t < 0.0))
    return Crossing(sure, t, v, w), possible & ~sure
