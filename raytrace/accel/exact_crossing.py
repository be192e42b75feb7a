"""Rays and triangles in exact arithmetic, one pair after the other: whether they cross, and where; see ``crossing``."""

import numpy as np

from raytrace.accel.expansions import (
    TERMS,
    VECTOR,
    add_minor,
    grow,
    sign_of,
    triple_product,
    value_of,
    write_difference,
)
from raytrace.accel.hit_work import MARKED, ON_SURFACE, PAIRS, HitWork, keep_one
from raytrace.accel.lanes import machine_epsilon, machine_largest, peek
from raytrace.jit import inlined, kernel, subroutine
from raytrace.records import Columns, Rays

A, B, C, D = 0, VECTOR, 2 * VECTOR, 3 * VECTOR  # places of vectors: the vertices relative to the origin; the direction
E, F, G, H, S = (4 * VECTOR + k * TERMS for k in range(5))  # places of expansions
SMALLEST = 2.0**-288  # products of smaller components, relative to the largest, can underflow
ROUNDING = 2e-15  # bound on the error of a triple product, relative to the sum of the magnitudes of its terms
FLOOR = 1e-300  # more than all that underflows in one


@inlined
def number(columns: Columns, i: int, axis: int):
    """One component of ray i, as float64."""
    return np.float64(peek(columns.data, columns.start + i * columns.row + axis * columns.axis))


@inlined
def largest_of(a):
    """Largest magnitude of three numbers."""
    return max(max(abs(a[0]), abs(a[1])), abs(a[2]))


@subroutine
def power_below(a):
    """The largest power of two that is at most a > 0."""
    power = 1.0
    while power > a:
        power *= 0.5
    while power <= 0.5 * a:
        power *= 2.0
    return power


@subroutine
def scaled_down(a, unit):
    """Whether a vector divided by a power of two is exact and can be multiplied exactly; and the quotient."""
    x, y, z = a[0] / unit, a[1] / unit, a[2] / unit
    fine = (a[0] == 0.0 or abs(x) >= SMALLEST) and (a[1] == 0.0 or abs(y) >= SMALLEST)
    return fine and (a[2] == 0.0 or abs(z) >= SMALLEST), (x, y, z)


@subroutine
def quick_sign(x, p, q, r):
    """Sign of p . (q x r) where rounded arithmetic is certain of it, else 0."""
    total, size = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        first, second = x[q + 2 * j] * x[r + 2 * k], x[q + 2 * k] * x[r + 2 * j]
        total += x[p + 2 * i] * (first - second)
        size += abs(x[p + 2 * i]) * (abs(first) + abs(second))
    bound = size * ROUNDING + FLOOR
    return 1 if total > bound else -1 if total < -bound else 0


@subroutine
def side(x, at, p, q, r):
    """Sign of p . (q x r), exactly."""
    sign = quick_sign(x, p, q, r)
    return sign if sign != 0 else sign_of(x, at, triple_product(x, at, p, q, r))


@subroutine
def moved_side(x, sign, p, q, order):
    """Sign of an edge function of the moved line; ``sign`` is that of the line itself, for the edge from p to q.

    ``order`` is the axes of the ray.
    """
    if sign == 0:
        for axis in order[:2]:
            j, k = (axis + 1) % 3, (axis + 2) % 3
            n = add_minor(x, S, 0, (D, j, k), (q, j, k), 1.0)
            n = add_minor(x, S, n, (D, j, k), (p, j, k), -1.0)
            if n != 0:
                return sign_of(x, S, n)
    return sign


@inlined
def differ(u, v, w):
    """Whether three signs have two that are opposite."""
    return (u > 0 or v > 0 or w > 0) and (u < 0 or v < 0 or w < 0)


@subroutine
def holds_origin(x, u, v, w):
    """Whether a triangle with an area, whose plane holds the origin of a ray, holds it too.

    ``u``, ``v``, ``w`` are the signs of its edge functions for the line itself, no two opposite.
    """
    if u != 0 or v != 0 or w != 0:
        return True
    for axis in range(3):  # the plane holds the whole line: look along an axis that the plane does not hold
        j, k = (axis + 1) % 3, (axis + 2) % 3
        n = 0
        for p, q in ((C, B), (A, C), (B, A)):
            n = add_minor(x, S, n, (p, j, k), (q, j, k), 1.0)
        if n != 0:
            u = sign_of(x, S, add_minor(x, S, 0, (C, j, k), (B, j, k), 1.0))
            v = sign_of(x, S, add_minor(x, S, 0, (A, j, k), (C, j, k), 1.0))
            w = sign_of(x, S, add_minor(x, S, 0, (B, j, k), (A, j, k), 1.0))
            return not differ(u, v, w)
    return False


@subroutine
def measure(x, unit, limits):
    """Exact t, u, v of a crossing, rounded; ``unit``: of positions, and of directions; limits of |t|."""
    e, f, g = triple_product(x, E, D, C, B), triple_product(x, F, D, A, C), triple_product(x, G, D, B, A)
    height = value_of(x, H, triple_product(x, H, A, B, C))
    v, w = value_of(x, F, f), value_of(x, G, g)
    for k in range(f):
        e = grow(x, E, e, x[F + k])
    for k in range(g):
        e = grow(x, E, e, x[G + k])
    total = value_of(x, E, e)
    t = 0.0
    if height != 0.0:
        t = min(max(abs(height / total) * unit[0] / unit[1], limits[0]), limits[1])
        t = -t if (height > 0.0) == (total > 0.0) else t
    return t, min(v / total, 1.0), min(w / total, 1.0)


@subroutine
def read_pair(x, o, d, triangles, row):
    """Write the vectors of a ray and a triangle; return whether they are exact, and their units."""
    size = largest_of(o)
    for k in range(9):
        size = max(size, abs(np.float64(peek(triangles, row + k))))
    size, length = power_below(max(size, FLOOR)), power_below(largest_of(d))
    fine, near_o = scaled_down(o, size)
    fine_d, near_d = scaled_down(d, length)
    fine = fine and fine_d
    for k in range(3):
        at = row + 3 * k
        corner = np.float64(triangles[at]), np.float64(triangles[at + 1]), np.float64(triangles[at + 2])
        fine_v, vertex = scaled_down(corner, size)
        fine = fine and fine_v
        write_difference(x, A + k * VECTOR, vertex, near_o)
    for axis in range(3):
        x[D + 2 * axis], x[D + 2 * axis + 1] = near_d[axis], 0.0
    return fine, (size, length)  # their quotient can overflow


@subroutine
def axes_in_order(d):
    """Axes of a ray, with the dominant one last."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    if x >= y and x >= z:
        return 1, 2, 0
    return (2, 0, 1) if y >= z else (0, 1, 2)


@kernel
def decide(triangles, rays: Rays, counts, work: HitWork):
    """Decide all pairs of rays and triangles that are noted, and add their crossings to the counts and the hits.

    Pairs that cannot be decided, because products would underflow, stay noted; all others are removed. Counts of rays
    whose origins lie on a triangle are marked if ``ON_SURFACE`` says so.
    """
    x, left = work.exact, 0
    largest = np.float64(machine_largest(triangles))
    limits = np.float64(machine_epsilon(triangles)) * (4.0 / largest), largest
    for pair in range(work.state[PAIRS]):
        ray, prim = work.pair_ray[pair], work.pair_prim[pair]
        o = number(rays.o, ray, 0), number(rays.o, ray, 1), number(rays.o, ray, 2)
        d = number(rays.d, ray, 0), number(rays.d, ray, 1), number(rays.d, ray, 2)
        fine, unit = read_pair(x, o, d, triangles, 12 * np.int64(prim))
        if not fine:
            work.pair_ray[left], work.pair_prim[left] = ray, prim
            left += 1
            continue
        u, v, w = side(x, E, D, C, B), side(x, F, D, A, C), side(x, G, D, B, A)
        if differ(u, v, w):
            continue
        if work.state[ON_SURFACE] != 0 and side(x, H, A, B, C) == 0 and holds_origin(x, u, v, w):
            counts[ray] |= np.int32(MARKED)
        order = axes_in_order(d)
        u, v, w = moved_side(x, u, C, B, order), moved_side(x, v, A, C, order), moved_side(x, w, B, A, order)
        if u == 0 or u != v or u != w:
            continue
        t, u, v = measure(x, unit, limits)
        last = len(work.hit_t) - 1
        work.hit_t[last] = t
        t = np.float64(work.hit_t[last])  # rounded to the precision of the tree
        if t > number(rays.tmin, ray, 0) and t < number(rays.tmax, ray, 0):
            counts[ray] += np.int32(1)
            keep_one(t, u, v, prim, ray, work)
    work.state[PAIRS] = left
