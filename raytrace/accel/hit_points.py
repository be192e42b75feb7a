"""Points of hits on triangles, and the bound on their rounding error: for kernels and for NumPy arrays.

A point has the rounding error of its coordinates. The test of a ray that starts there has that of the extent of the
triangle. 3 roundings of the first and 12 of the second bound both: gamma(3) (|p| + 4 extents), with
gamma(n) = n u / (1 - n u) [Higham2002, 3.1]. docs/numerics.md counts them.
"""

from raytrace.accel.lanes import absolute, maximum, minimum
from raytrace.jit import inlined

ROUNDINGS, EXTENTS = 3, 4


@inlined
def gamma(eps):
    """Return gamma(ROUNDINGS) for numbers whose machine epsilon is eps: the unit roundoff u is eps / 2."""
    return ROUNDINGS * (0.5 * eps) / (1.0 - ROUNDINGS * (0.5 * eps))


@inlined
def blend(a, b, c, u, v):
    """(1 - u - v) a + u b + v c, as a + (u (b - a) + v (c - a)): most roundings are of numbers no larger than edges."""
    return a + (u * (b - a) + v * (c - a))


@inlined
def blend3(a, b, c, u, v):
    """``blend`` of vectors."""
    return blend(a[0], b[0], c[0], u, v), blend(a[1], b[1], c[1], u, v), blend(a[2], b[2], c[2], u, v)


@inlined
def error_scale(p, a, b, c):
    """Bound on the error of one coordinate p of a point, in units of gamma; a, b, c are those of the vertices."""
    return absolute(p) + EXTENTS * (maximum(maximum(a, b), c) - minimum(minimum(a, b), c))
