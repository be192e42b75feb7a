"""One ray and one triangle in exact arithmetic: whether the ray crosses it, and where; see ``crossing``."""

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
from raytrace.accel.hit_work import FIRST, MARKED, ON_SURFACE, PAIRS, SIZE, USER_DIRECTION, HitWork
from raytrace.accel.lanes import machine_epsilon, machine_largest, packet_width, peek, poke
from raytrace.accel.layout import PRIM_ID, V0, V1, Leaves
from raytrace.accel.octants import Axes
from raytrace.accel.scratch import ORIGIN, SCALE
from raytrace.jit import inlined, subroutine

A, B, C, D = 0, VECTOR, 2 * VECTOR, 3 * VECTOR  # places of vectors: the vertices relative to the origin; the direction
E, F, G, H, S = (4 * VECTOR + k * TERMS for k in range(5))  # places of expansions
SMALLEST = 2.0**-288  # smaller coordinates, relative to the largest, can underflow
ROUNDING = 2e-15  # bound on the error of a triple product, relative to the sum of the magnitudes of its terms
FLOOR = 1e-300


@inlined
def vector_at(a, at, step, axes: Axes):
    """Three numbers of an array as float64, in the order of the ray's axes."""
    x, y, z = axes.x // 8, axes.y // 8, axes.z // 8
    return (
        np.float64(peek(a, at + x * step)),
        np.float64(peek(a, at + y * step)),
        np.float64(peek(a, at + z * step)),
    )


@inlined
def too_small(a):
    """Whether any component of a vector is not 0, but so small that products may underflow."""
    found = False
    for axis in range(3):
        found = found or (a[axis] != 0.0 and abs(a[axis]) < SMALLEST)
    return found


@inlined
def divided(a, s):
    """Vector divided by a power of two; exact unless it underflows."""
    return a[0] / s, a[1] / s, a[2] / s


@inlined
def vanished(a, b):
    """Whether a component of the vector a is not 0 where that of b is."""
    return (a[0] != 0.0 and b[0] == 0.0) or (a[1] != 0.0 and b[1] == 0.0) or (a[2] != 0.0 and b[2] == 0.0)


@inlined
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
def plain_side(x, at, p, q, r):
    """Sign of p . (q x r), exactly."""
    sign = quick_sign(x, p, q, r)
    return sign if sign != 0 else sign_of(x, at, triple_product(x, at, p, q, r))


@subroutine
def moved_side(x, sign, p, q):
    """Sign of an edge function of the moved line; ``sign`` is that of the line itself, for the edge from p to q."""
    if sign != 0:
        return sign
    for axis in range(2):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        n = add_minor(x, S, 0, (D, j, k), (q, j, k), 1.0)
        n = add_minor(x, S, n, (D, j, k), (p, j, k), -1.0)
        if n != 0:
            return sign_of(x, S, n)
    return 0


@subroutine
def holds_origin(x, u, v, w):
    """Whether a triangle with an area, whose plane holds the origin of a ray, holds it too.

    ``u``, ``v``, ``w`` are the signs of its edge functions for the line itself.
    """
    if u != 0 or v != 0 or w != 0:
        return not ((u > 0 or v > 0 or w > 0) and (u < 0 or v < 0 or w < 0))
    for axis in range(3):  # the plane holds the whole line: look along an axis that the plane does not hold
        j, k = (axis + 1) % 3, (axis + 2) % 3
        u = sign_of(x, S, add_minor(x, S, 0, (C, j, k), (B, j, k), 1.0))
        v = sign_of(x, S, add_minor(x, S, 0, (A, j, k), (C, j, k), 1.0))
        w = sign_of(x, S, add_minor(x, S, 0, (B, j, k), (A, j, k), 1.0))
        n = add_minor(x, S, 0, (C, j, k), (B, j, k), 1.0)
        n = add_minor(x, S, n, (A, j, k), (C, j, k), 1.0)
        n = add_minor(x, S, n, (B, j, k), (A, j, k), 1.0)
        if n != 0:
            return not ((u > 0 or v > 0 or w > 0) and (u < 0 or v < 0 or w < 0))
    return False


@subroutine
def note_pair(leaves: Leaves, at, count, work: HitWork):
    """Append a ray and a triangle to the list of those that must be decided elsewhere."""
    pairs = work.state[PAIRS]
    work.state[PAIRS] = pairs + 1
    if pairs < len(work.pair_ray):
        work.pair_ray[pairs] = work.state[FIRST] + count - packet_width(work.lanes)
        work.pair_prim[pairs] = peek(leaves.prim_id, at + PRIM_ID)


@subroutine
def read_pair(leaves: Leaves, at, axes: Axes, ray, work: HitWork):
    """Write the vectors of a ray and a triangle; return the units of positions and of the direction.

    The unit of positions is 0 where products could underflow.
    """
    x, width = work.exact, packet_width(work.lanes)
    size = np.float64(peek(work.lanes, ray + SIZE * width))
    scale = np.float64(peek(work.lanes, ray + SCALE * width))
    user_o = vector_at(work.lanes, ray + ORIGIN * width, width, axes)
    user_d = vector_at(work.lanes, ray + USER_DIRECTION * width, width, axes)
    o, d = divided(user_o, size), divided(user_d, scale)
    small = too_small(o) or too_small(d) or vanished(user_o, o) or vanished(user_d, d)
    for k in range(3):
        given = vector_at(leaves.rows, at + (V1 - V0) * k, 8, axes)
        vertex = divided(given, size)
        small = small or too_small(vertex) or vanished(given, vertex)
        write_difference(x, A + k * VECTOR, vertex, o)
    for axis in range(3):
        x[D + 2 * axis], x[D + 2 * axis + 1] = d[axis], 0.0
    return 0.0 if small else size, scale


@subroutine
def cross_exactly(leaves: Leaves, at, axes: Axes, place, work: HitWork):
    """Whether a ray crosses a triangle; and t, u, v.

    ``place`` is that of the ray in row 0 of its slot, and that of its count. Marks the count if the ray's origin lies
    on the triangle and ``ON_SURFACE`` says so.
    """
    x, (ray, count) = work.exact, place
    size, scale = read_pair(leaves, at, axes, ray, work)
    if size == 0.0:
        note_pair(leaves, at, count, work)
        return False, 0.0, 0.0, 0.0
    u, v, w = plain_side(x, E, D, C, B), plain_side(x, F, D, A, C), plain_side(x, G, D, B, A)
    if (u > 0 or v > 0 or w > 0) and (u < 0 or v < 0 or w < 0):
        return False, 0.0, 0.0, 0.0
    if work.state[ON_SURFACE] != 0 and plain_side(x, H, A, B, C) == 0 and holds_origin(x, u, v, w):
        poke(work.prim_id, count, peek(work.prim_id, count) | np.int32(MARKED))
    u, v, w = moved_side(x, u, C, B), moved_side(x, v, A, C), moved_side(x, w, B, A)
    if u == 0 or u != v or u != w:
        return False, 0.0, 0.0, 0.0
    e, f, g = triple_product(x, E, D, C, B), triple_product(x, F, D, A, C), triple_product(x, G, D, B, A)
    height = value_of(x, H, triple_product(x, H, A, B, C))
    v_part, w_part = value_of(x, F, f), value_of(x, G, g)
    for k in range(f):
        e = grow(x, E, e, x[F + k])
    for k in range(g):
        e = grow(x, E, e, x[G + k])
    total = value_of(x, E, e)
    t = -height / total * size / scale
    largest = np.float64(machine_largest(work.lanes))
    least = np.float64(machine_epsilon(work.lanes)) * (4.0 / largest)
    if t > 0.0 or (t == 0.0 and height != 0.0 and (height > 0.0) != (total > 0.0)):
        t = min(max(t, least), largest)
    elif t < 0.0 or height != 0.0:
        t = max(min(t, -least), -largest)
    return True, t, v_part / total, w_part / total
