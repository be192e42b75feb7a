"""Pairs of floats (high, low) that stand for their unevaluated sum: twice the precision, in lanes.

|low| is at most half a unit in the last place of high; u is the unit roundoff. Sums and products without error are
those of [Dekker1971] and [Knuth1997]. Scalar products and determinants add the errors of all terms, as in [Ogita2005].
"""

from typing import NamedTuple

from raytrace.accel.lanes import fma, select, sqrt
from raytrace.jit import inlined


class Pair(NamedTuple):
    """The number high + low; lanes."""

    high: float
    low: float


class Vector(NamedTuple):
    """A vector of three pairs."""

    x: Pair
    y: Pair
    z: Pair


@inlined
def exact_sum(a, b) -> Pair:
    """A + b without error, for two floats [Knuth1997, 4.2.2, theorem B]."""
    s = a + b
    part = s - a
    return Pair(s, (a - (s - part)) + (b - part))


@inlined
def tidy(a, b) -> Pair:
    """A + b without error, for two floats with |a| >= |b| or a = 0."""
    s = a + b
    return Pair(s, b - (s - a))


@inlined
def exact_difference(p, q) -> Vector:
    """P - q without error, for two points with float coordinates."""
    return Vector(exact_sum(p[0], -q[0]), exact_sum(p[1], -q[1]), exact_sum(p[2], -q[2]))


@inlined
def sum_of(a: Pair, b: Pair) -> Pair:
    """A + b; error at most about 3 u^2 |a + b|."""
    s, t = exact_sum(a.high, b.high), exact_sum(a.low, b.low)
    s = tidy(s.high, s.low + t.high)
    return tidy(s.high, s.low + t.low)


@inlined
def minus(a: Pair) -> Pair:
    """The pair -a."""
    return Pair(-a.high, -a.low)


@inlined
def product(a: Pair, b: Pair) -> Pair:
    """A b; relative error at most about 5 u^2."""
    p = a.high * b.high
    return tidy(p, fma(a.high, b.low, fma(a.low, b.high, fma(a.high, b.high, -p))))


@inlined
def quotient(a: Pair, b: Pair) -> Pair:
    """A / b; relative error at most about 10 u^2."""
    q = a.high / b.high
    p = q * b.high
    rest = ((a.high - p) - fma(q, b.high, -p)) + (a.low - q * b.low)
    return tidy(q, rest / b.high)


@inlined
def cross_terms(a: Pair, b: Pair, p):
    """What the rounded product p of the high parts of a and b lacks."""
    return fma(a.high, b.high, -p) + fma(a.high, b.low, a.low * b.high)


@inlined
def scalar_product(a: Vector, b: Vector) -> Pair:
    """Scalar product; error at most about 10 u^2 times the sum of the |a_k b_k|, and u relative to the low part."""
    px, py, pz = a.x.high * b.x.high, a.y.high * b.y.high, a.z.high * b.z.high
    s = exact_sum(px, py)
    t = exact_sum(s.high, pz)
    low = (s.low + t.low) + (cross_terms(a.x, b.x, px) + (cross_terms(a.y, b.y, py) + cross_terms(a.z, b.z, pz)))
    return exact_sum(t.high, low)


@inlined
def determinant(a: Pair, b: Pair, c: Pair, d: Pair) -> Pair:
    """A d - b c; error at most about 10 u^2 (|a d| + |b c|)."""
    p, q = a.high * d.high, b.high * c.high
    s = exact_sum(p, -q)
    return exact_sum(s.high, s.low + (cross_terms(a, d, p) - cross_terms(b, c, q)))


@inlined
def cross_product(a: Vector, b: Vector) -> Vector:
    """Cross product of two vectors."""
    return Vector(
        determinant(a.y, a.z, b.y, b.z), determinant(a.z, a.x, b.z, b.x), determinant(a.x, a.y, b.x, b.y)
    )  # fmt: skip


@inlined
def multiple(a: Vector, s: Pair) -> Vector:
    """Vector times a pair."""
    return Vector(product(a.x, s), product(a.y, s), product(a.z, s))


@inlined
def difference(a: Vector, b: Vector) -> Vector:
    """Difference of two vectors of pairs."""
    return Vector(sum_of(a.x, minus(b.x)), sum_of(a.y, minus(b.y)), sum_of(a.z, minus(b.z)))


@inlined
def times_power(a: Pair, s) -> Pair:
    """A times a power of two, without error where nothing underflows."""
    return Pair(a.high * s, a.low * s)


@inlined
def scaled_vector(a: Vector, s) -> Vector:
    """Vector times a power of two, without error where nothing underflows."""
    return Vector(times_power(a.x, s), times_power(a.y, s), times_power(a.z, s))


@inlined
def pick(mask, a: Pair, b: Pair) -> Pair:
    """The pair ``a`` where the mask holds, else ``b``."""
    return Pair(select(mask, a.high, b.high), select(mask, a.low, b.low))


@inlined
def pick_vector(mask, a: Vector, b: Vector) -> Vector:
    """The vector ``a`` where the mask holds, else ``b``."""
    return Vector(pick(mask, a.x, b.x), pick(mask, a.y, b.y), pick(mask, a.z, b.z))


@inlined
def less(a: Pair, b: Pair):
    """Mask where a < b."""
    return (a.high < b.high) | ((a.high == b.high) & (a.low < b.low))


@inlined
def rounded_root(a: Pair):
    """Square root of a pair that is not negative, rounded once: a step of Newton's method from the root of ``high``.

    The step is rounded to 26 bits first [Dekker1971]. So roots that lie halfway between two floats are rounded to even,
    whatever the last bits of the pair; other roots change by less than 2^-26 of half a unit in the last place.
    """
    root = sqrt(a.high)
    square = root * root
    step = ((a.high - square) + (a.low - fma(root, root, -square))) / (root + root)
    spread = 134217729.0 * step
    return select(root > 0.0, root + (spread - (spread - step)), 0.0)
