"""Mappings from the unit square to where samples are wanted, and frames around normals; no function of a C library."""

import numpy as np

from raytrace.accel.lanes import absolute, maximum, select, splat, sqrt
from raytrace.jit import inlined

# Taylor coefficients of sin x and cos x; for |x| <= pi / 4 the first that is left out is below 5e-17
SIN = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880, -1 / 39916800, 1 / 6227020800, -1 / 1307674368000
COS = -1 / 2, 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800, 1 / 479001600, -1 / 87178291200, 1 / 20922789888000
QUARTER = np.pi / 4


@inlined
def sin_cos(x):
    """Sine and cosine of |x| <= pi / 4, by Horner's rule."""
    z = x * x
    s = SIN[0] + z * (SIN[1] + z * (SIN[2] + z * (SIN[3] + z * (SIN[4] + z * (SIN[5] + z * SIN[6])))))
    c = COS[0] + z * (COS[1] + z * (COS[2] + z * (COS[3] + z * (COS[4] + z * (COS[5] + z * (COS[6] + z * COS[7]))))))
    return x + x * (z * s), 1.0 + z * c


@inlined
def disc(u, v):
    """Point of the unit disc, uniform by area, and 1 - r^2: the concentric map [Shirley1997].

    Squares around the centre of the unit square become circles, so strata stay compact.
    """
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    wide = absolute(a) > absolute(b)
    r, across = select(wide, a, b), select(wide, b, a)
    s, c = sin_cos(QUARTER * (across / select(r == 0.0, splat(1.0, r), r)))
    rim = absolute(r)
    return r * select(wide, c, s), r * select(wide, s, c), (1.0 - rim) * (1.0 + rim)


@inlined
def cosine_hemisphere(u, v):
    """Unit vector around z of density z / pi: a point of the disc, lifted [Pharr2023, A.5.3]."""
    x, y, z2 = disc(u, v)
    return x, y, sqrt(maximum(z2, 0.0))


@inlined
def sphere(u, v):
    """Unit vector of density 1 / (4 pi): the disc, by the azimuthal map that preserves areas [Shirley1997]."""
    x, y, rest = disc(u, v)  # r^2 = 1 - rest; height 1 - 2 r^2; radius 2 r sqrt(1 - r^2)
    radius = 2.0 * sqrt(maximum(rest, 0.0))
    return x * radius, y * radius, 2.0 * rest - 1.0


@inlined
def triangle(u, v):
    """Barycentric coordinates of v1 and v2, uniform by area [Pharr2023, A.5.1]."""
    root = sqrt(u)
    return (1.0 - v) * root, v * root


@inlined
def around(n, w):
    """A vector of the frame whose z axis is n, in world space; the frame is that of [Duff2017]."""
    sign = select(n[2] < 0.0, splat(-1.0, n[2]), 1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    x = w[0] * (1.0 + sign * n[0] * n[0] * a) + (w[1] * b + w[2] * n[0])
    y = w[0] * (sign * b) + (w[1] * (sign + n[1] * n[1] * a) + w[2] * n[1])
    z = w[2] * n[2] - (w[0] * (sign * n[0]) + w[1] * n[1])
    return x, y, z


@inlined
def to_frame(n, w):
    """A vector of world space in the frame of ``around``: the transposed matrix."""
    sign = select(n[2] < 0.0, splat(-1.0, n[2]), 1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    x = w[0] * (1.0 + sign * n[0] * n[0] * a) + (w[1] * (sign * b) - w[2] * (sign * n[0]))
    y = w[0] * b + (w[1] * (sign + n[1] * n[1] * a) - w[2] * n[1])
    return x, y, w[0] * n[0] + (w[1] * n[1] + w[2] * n[2])
