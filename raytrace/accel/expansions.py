"""Exact arithmetic in kernels: sums and products of floats as expansions [Shewchuk1997].

An expansion is a sum of floats that do not overlap, the smallest first and none of them zero. It holds a number
exactly, and its last term has the sign of that number. Expansions lie in one array ``x``; one that begins at ``at`` has
n terms.
A vector of exact differences has six numbers there: x, y, z, each with its rounding error.

Products must neither overflow nor underflow; the callers see to that.
"""

from raytrace.jit import inlined, subroutine

VECTOR = 6  # numbers of a vector
TERMS = 192  # most terms of a triple product


@inlined
def product_error(a, b, p):
    """A b - p exactly, for p = a b rounded, by splitting both factors into halves [Dekker1971]."""
    ca, cb = 134217729.0 * a, 134217729.0 * b
    a_high, b_high = ca - (ca - a), cb - (cb - b)
    a_low, b_low = a - a_high, b - b_high
    return ((a_high * b_high - p) + a_high * b_low + a_low * b_high) + a_low * b_low


@inlined
def two_sum(a, b):
    """Rounded sum, and its rounding error."""
    s = a + b
    part = s - a
    return s, (a - (s - part)) + (b - part)


@subroutine
def grow(x, at, n, b):
    """Add a number to an expansion of n terms; return its new number of terms."""
    total, m = b, 0
    for k in range(at, at + n):
        total, error = two_sum(total, x[k])
        if error != 0.0:
            x[at + m] = error
            m += 1
    if total != 0.0:
        x[at + m] = total
        m += 1
    return m


@subroutine
def add_product(x, at, n, a, b, c):
    """Add a b c to an expansion of n terms; return its new number of terms."""
    p = a * b
    p_error = product_error(a, b, p)
    for factor in (p_error, p):
        if factor != 0.0:
            q = factor * c
            q_error = product_error(factor, c, q)
            if q_error != 0.0:
                n = grow(x, at, n, q_error)
            if q != 0.0:
                n = grow(x, at, n, q)
    return n


@subroutine
def add_minor(x, at, n, p, q, factor):
    """Add factor (p_j q_k - p_k q_j) to an expansion; p and q are (start, j, k) of vectors with exact differences."""
    start_p, j, k = p
    start_q, _, _ = q
    for i in range(4):
        a, b = x[start_p + 2 * j + i % 2], x[start_q + 2 * k + i // 2]
        if a != 0.0 and b != 0.0:
            n = add_product(x, at, n, a, b, factor)
        a, b = x[start_p + 2 * k + i % 2], x[start_q + 2 * j + i // 2]
        if a != 0.0 and b != 0.0:
            n = add_product(x, at, n, a, b, -factor)
    return n


@subroutine
def triple_product(x, at, p, q, r):
    """Write p . (q x r) of three vectors as an expansion; return its number of terms."""
    n = 0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for part in range(2):
            factor = x[p + 2 * i + part]
            if factor != 0.0:
                n = add_minor(x, at, n, (q, j, k), (r, j, k), factor)
    return n


@subroutine
def write_difference(x, at, a, b):
    """Write a - b of two vectors of numbers, exactly."""
    for axis in range(3):
        s, error = two_sum(a[axis], -b[axis])
        x[at + 2 * axis], x[at + 2 * axis + 1] = s, error


@inlined
def sign_of(x, at, n):
    """Sign of an expansion: -1, 0 or 1."""
    return 0 if n == 0 else 1 if x[at + n - 1] > 0.0 else -1


@subroutine
def value_of(x, at, n):
    """An expansion, rounded to about one number."""
    total = 0.0
    for k in range(at, at + n):
        total += x[k]
    return total
