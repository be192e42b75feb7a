"""Angles of directions, without a function of a C library: they differ between platforms.

All are polynomials on lanes, within 2 ulp [docs/numerics.md], and bit-identical at every lane width.
"""

import numpy as np

from raytrace.accel.lanes import absolute, fma, maximum, minimum, select, splat, to_int, to_real
from raytrace.jit import inlined
from raytrace.passes.warp import sin_cos

# (atan(z) / z - 1) / z^2 as a polynomial of z^2, Chebyshev fit for |z| <= tan(pi / 8); relative error of atan 5.4e-18
ATAN = (
    -0.3333333333333333, 0.1999999999999552, -0.14285714284666542, 0.11111111015256361, -0.09090904578123903,
    0.07692183190826087, -0.06664511447381948, 0.0585814891280221, -0.0508544973794026, 0.03923165829558719,
    -0.01917688711906226,
)  # fmt: skip
EIGHTH = 0.41421356237309503  # tan(pi / 8)


@inlined
def small_atan(z, error):
    """Arc tangent of z + error, |z| <= tan(pi / 8), by Horner's rule; 1 - z^2 is near its derivative."""
    w = z * z
    p = ATAN[6] + w * (ATAN[7] + w * (ATAN[8] + w * (ATAN[9] + w * ATAN[10])))
    p = ATAN[0] + w * (ATAN[1] + w * (ATAN[2] + w * (ATAN[3] + w * (ATAN[4] + w * (ATAN[5] + w * p)))))
    return z + (z * (w * p) + error * (1.0 - w))


@inlined
def atan2(y, x):
    """Angle of the point (x, y), -pi .. pi; 0 for the origin.

    With low and high the smaller and the larger of |x| and |y|: atan(low / high) = pi / 4 + atan of
    (low - high) / (low + high) where low / high is above tan(pi / 8).
    """
    ax, ay = absolute(x), absolute(y)
    low, high = minimum(ax, ay), maximum(ax, ay)
    steep = low > EIGHTH * high
    above, below = select(steep, low - high, low), select(steep, low + high, high)
    below = select(below > 0.0, below, splat(1.0, x))
    z = above / below
    lost = select(steep, (low - (above + high)) - z * (low - (below - high)), 0.0)  # by the sum and the difference
    rest = small_atan(z, (fma(-z, below, above) + lost) / below)
    eighths = select(steep, splat(1.0, x), 0.0)  # the angle is so many eighths of a turn, plus or minus the rest
    swapped, back = ay > ax, x < 0.0
    eighths, rest = select(swapped, 2.0 - eighths, eighths), select(swapped, -rest, rest)
    eighths, rest = select(back, 4.0 - eighths, eighths), select(back, -rest, rest)
    angle = eighths * (np.pi / 4) + rest
    return select(y < 0.0, -angle, angle)


@inlined
def sin_cos_of_turns(u):
    """Sine and cosine of 2 pi u, for u in 0 .. 1; the quarter turns are taken off exactly."""
    quarter = to_int(4.0 * u + 0.5)
    s, c = sin_cos((4.0 * u - to_real(quarter, u)) * (np.pi / 2))
    swap = (quarter & np.int32(1)) > np.int32(0)
    sine, cosine = select(swap, c, s), select(swap, s, c)
    back = (quarter & np.int32(2)) > np.int32(0)
    other = ((quarter + np.int32(1)) & np.int32(2)) > np.int32(0)
    return select(back, -sine, sine), select(other, -cosine, cosine)
