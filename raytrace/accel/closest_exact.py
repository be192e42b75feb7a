"""The closest point of a triangle to a point, in pairs of float64: errors are about 2^-100 of the distances involved.

Edges and triangles are computed from their corners in lexicographic order. So triangles that share an edge or a vertex,
and triangles that are equal, get bit-identical distances, whatever the order of their corners.
"""

from typing import NamedTuple

from raytrace.accel.lanes import NODE, absolute, bits, load, maximum, power_of_two, select, splat, store
from raytrace.accel.pairs import (
    Pair,
    Vector,
    cross_product,
    difference,
    exact_difference,
    exact_sum,
    less,
    multiple,
    pick,
    pick_vector,
    quotient,
    rounded_root,
    scalar_product,
    scaled_vector,
)
from raytrace.accel.vectors import choose3
from raytrace.jit import inlined, subroutine

CORNERS, ANSWER, ROWS = 0, 9, 15  # rows of lanes: the corners; then p x y z, distance, u, v
SHORTEST = 2.0**-1000  # largest difference of coordinates up to which lengths are not made larger by a power of two
POINT = 2.0**-900  # squared length of an edge that is no more than a point as seen from the query point
THIN = 2.0**-51  # height over distance: a thinner triangle is as good as its edges
ZERO = 2.0**-96  # distance over the largest distance of a corner: what is smaller is 0
ZERO_SLIVER = 2.0**-60  # the largest such ratio in slivers


class Corner(NamedTuple):
    """A corner of triangles, and its number in the order of the caller: 0, 1 or 2; lanes."""

    position: tuple  # x, y, z
    number: float


class Nearest(NamedTuple):
    """The point of a triangle, or of its boundary, that is closest to the query point; lanes."""

    away: Vector  # from the point to the query point
    square: Pair  # the squared length of ``away``
    a: float  # weights of the three corners
    b: float
    c: float


class Sides(NamedTuple):
    """A triangle as seen from the query point, in units of a power of two: its largest coordinate is below 2."""

    a: Vector  # from each corner to the query point
    b: Vector
    c: Vector
    e: Vector  # from a to b
    f: Vector  # from a to c
    g: Vector  # from b to c
    reach: float  # the largest |coordinate| of a, b, c
    longest: float  # the largest squared length of an edge


@inlined
def corner(rows, k: int) -> Corner:
    """Corner k of the triangles."""
    at = (CORNERS + 3 * k) * NODE
    x, y, z = load(rows, at, 8), load(rows, at + NODE, 8), load(rows, at + 2 * NODE, 8)
    return Corner((x, y, z), splat(float(k), x))


@inlined
def in_order(p: Corner, q: Corner):
    """Two corners in lexicographic order of their coordinates."""
    (ax, ay, az), (bx, by, bz) = p.position, q.position
    swap = (bx < ax) | ((bx == ax) & ((by < ay) | ((by == ay) & (bz < az))))
    first = Corner(choose3(swap, q.position, p.position), select(swap, q.number, p.number))
    return first, Corner(choose3(swap, p.position, q.position), select(swap, p.number, q.number))


@inlined
def largest(a: Vector, b):
    """The largest |coordinate| of a vector, or b if that is larger."""
    return maximum(maximum(absolute(a.x.high), absolute(a.y.high)), maximum(absolute(a.z.high), b))


@inlined
def make_sides(p, first: Corner, second: Corner, third: Corner):
    """The triangle as seen from p, and the power of two that is its unit of length. No error, but for underflow."""
    a, b = exact_difference(p, first.position), exact_difference(p, second.position)
    c = exact_difference(p, third.position)
    reach = largest(a, largest(b, largest(c, splat(0.0, a.x.high))))
    unit = power_of_two(maximum(reach, SHORTEST))
    s = 1.0 / unit
    e = scaled_vector(exact_difference(second.position, first.position), s)
    f = scaled_vector(exact_difference(third.position, first.position), s)
    g = scaled_vector(exact_difference(third.position, second.position), s)
    a, b, c = scaled_vector(a, s), scaled_vector(b, s), scaled_vector(c, s)
    ee, ff, gg = scalar_product(e, e).high, scalar_product(f, f).high, scalar_product(g, g).high
    return Sides(a, b, c, e, f, g, reach * s, maximum(maximum(ee, ff), gg)), unit


@inlined
def on_face(sides: Sides):
    """The foot of the perpendicular to the plane, and a mask where it lies in the triangle.

    n = e x f, away = n (n . a) / n^2. The weights are n . (a x f) / n^2 and n . (e x a) / n^2.
    """
    n = cross_product(sides.e, sides.f)
    nn = scalar_product(n, n)
    away = multiple(n, quotient(scalar_product(n, sides.a), nn))
    b = quotient(scalar_product(n, cross_product(sides.a, sides.f)), nn)
    c = quotient(scalar_product(n, cross_product(sides.e, sides.a)), nn)
    rest = exact_sum(1.0 - b.high, -c.high)
    a = rest.high + (rest.low + (((1.0 - (1.0 - b.high)) - b.high) - (b.low + c.low)))
    thin = THIN * sides.reach
    inside = (nn.high > thin * thin * sides.longest) & (b.high >= 0.0) & (c.high >= 0.0) & (a >= 0.0)
    square = scalar_product(away, away)
    least, most = ZERO * sides.reach * sides.longest, ZERO_SLIVER * sides.reach  # ``away`` errs by 20 w^2 R / sine
    nothing = (square.high * nn.high <= least * least) & (square.high <= most * most)
    return Nearest(away, pick(nothing, times_zero(square), square), a, b.high + b.low, c.high + c.low), inside


@inlined
def times_zero(a: Pair) -> Pair:
    """Zero in the lanes of a."""
    zero = splat(0.0, a.high)
    return Pair(zero, zero)


@inlined
def on_edge(p: Vector, q: Vector, edge: Vector, reach):
    """The closest point of an edge: away, squared distance, weight of its end. p, q: from its ends to the point."""
    along, square = scalar_product(edge, p), scalar_product(edge, edge)
    t = quotient(along, square)
    away = difference(p, multiple(edge, t))
    start, end = (along.high <= 0.0) | (square.high < POINT), ~less(along, square)
    away = pick_vector(start, p, pick_vector(end, q, away))
    distance = scalar_product(away, away)
    distance = pick(distance.high <= (ZERO * reach) * (ZERO * reach), times_zero(distance), distance)
    return away, distance, select(start, 0.0, select(end, 1.0, t.high))


@inlined
def on_boundary(sides: Sides) -> Nearest:
    """The closest point of the three edges."""
    away, square, t = on_edge(sides.a, sides.b, sides.e, sides.reach)
    a, b, c = 1.0 - t, t, times_zero(square).high
    other, distance, t = on_edge(sides.a, sides.c, sides.f, sides.reach)
    nearer = less(distance, square)
    away, square = pick_vector(nearer, other, away), pick(nearer, distance, square)
    a, b, c = select(nearer, 1.0 - t, a), select(nearer, 0.0, b), select(nearer, t, c)
    other, distance, t = on_edge(sides.b, sides.c, sides.g, sides.reach)
    nearer = less(distance, square)
    away, square = pick_vector(nearer, other, away), pick(nearer, distance, square)
    return Nearest(away, square, select(nearer, 0.0, a), select(nearer, 1.0 - t, b), select(nearer, t, c))


@inlined
def either(mask, x: Nearest, y: Nearest) -> Nearest:
    """``x`` where the mask holds, else ``y``."""
    weights = choose3(mask, (x.a, x.b, x.c), (y.a, y.b, y.c))
    return Nearest(pick_vector(mask, x.away, y.away), pick(mask, x.square, y.square), *weights)


@inlined
def moved(p, away: Pair, unit):
    """One coordinate of p - away, rounded once."""
    s = exact_sum(p, -(away.high * unit))
    return s.high + (s.low - away.low * unit)


@subroutine
def closest_on_triangles(x: float, y: float, z: float, rows, n: int):
    """Write the points of n <= 8 triangles that are closest to (x, y, z); ``rows`` holds eight float64 per quantity."""
    first, second, third = corner(rows, 0), corner(rows, 1), corner(rows, 2)
    first, second = in_order(first, second)
    second, third = in_order(second, third)
    first, second = in_order(first, second)
    like = first.number
    p = splat(x, like), splat(y, like), splat(z, like)
    sides, unit = make_sides(p, first, second, third)
    nearest, inside = on_face(sides)
    if bits(~inside) & ((1 << n) - 1) != 0:
        nearest = either(inside, nearest, on_boundary(sides))
    at = ANSWER * NODE
    zero = nearest.square.high == 0.0
    store(rows, at, select(zero, p[0], moved(p[0], nearest.away.x, unit)))
    store(rows, at + NODE, select(zero, p[1], moved(p[1], nearest.away.y, unit)))
    store(rows, at + 2 * NODE, select(zero, p[2], moved(p[2], nearest.away.z, unit)))
    store(rows, at + 3 * NODE, rounded_root(nearest.square) * unit)
    u = select(first.number == 1.0, nearest.a, select(second.number == 1.0, nearest.b, nearest.c))
    v = select(first.number == 2.0, nearest.a, select(second.number == 2.0, nearest.b, nearest.c))
    store(rows, at + 4 * NODE, u)
    store(rows, at + 5 * NODE, v)
