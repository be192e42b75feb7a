"""Vectors as tuples (x, y, z) of components: registers in kernels, NumPy arrays of any length elsewhere."""

from raytrace.accel.lanes import select, sqrt
from raytrace.jit import inlined


@inlined
def dot(a, b):
    """Scalar product of two vectors."""
    return a[0] * b[0] + (a[1] * b[1] + a[2] * b[2])


@inlined
def scaled(a, s):
    """Vector times a number."""
    return a[0] * s, a[1] * s, a[2] * s


@inlined
def unit(a):
    """Vector divided by its length."""
    return scaled(a, 1.0 / sqrt(dot(a, a)))


@inlined
def choose3(mask, a, b):
    """Vector ``a`` where the mask holds, else ``b``."""
    return select(mask, a[0], b[0]), select(mask, a[1], b[1]), select(mask, a[2], b[2])
