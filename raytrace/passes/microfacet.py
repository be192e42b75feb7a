"""The GGX distribution of microfacets: density, masking, visible normals. Vectors are in the frame of the normal, z up.

No square of a cosine is taken from 1: what lies across the normal comes from the components x and y, so the smallest
alpha keeps its digits in float32.
"""

import numpy as np

from raytrace.accel.lanes import absolute, maximum, minimum, select, splat, sqrt
from raytrace.accel.vectors import unit
from raytrace.jit import inlined
from raytrace.passes.fresnel import dielectric_reflectance
from raytrace.passes.warp import disc

RIM = 1e-12  # least 1 - r^2 of a point of the disc: keeps a normal of length 0 away


@inlined
def ggx(h, alpha):
    """Density of microfacet normals per area and solid angle, 1 / sr: its integral times h_z is 1.

    D = alpha^2 / (pi (sin^2 + alpha^2 cos^2)^2) of the angle between h and the normal; 0 below the surface
    [Walter2007, equation 33].
    """
    t = alpha / (h[0] * h[0] + h[1] * h[1] + (alpha * h[2]) * (alpha * h[2]))
    return select(h[2] > 0.0, t * t * (1.0 / np.pi), splat(0.0, t))


@inlined
def slanted(v, alpha):
    """abs(cos) + sqrt(cos^2 + alpha^2 sin^2) of the angle between v and the normal."""
    x, y = alpha * v[0], alpha * v[1]
    return absolute(v[2]) + sqrt(v[2] * v[2] + (x * x + y * y))


@inlined
def masking(v, alpha):
    """Share of microfacets that v sees unblocked: Smith's G1 = 2 / (1 + sqrt(1 + alpha^2 tan^2)) [Walter2007]."""
    return 2.0 * absolute(v[2]) / slanted(v, alpha)


@inlined
def visible(v, alpha):
    """G1 / cos: times D and dot(v, h), it is the density of the normals h that v sees [Heitz2018]."""
    return 2.0 / slanted(v, alpha)


@inlined
def visible_normal(o, alpha, u, v):
    """A microfacet normal of the density D (G1 / cos) dot(o, h), by a spherical cap [Dupuy2023].

    The view is stretched until the distribution is a hemisphere. Its reflections fill a cap evenly: a point of the
    disc, whose r^2 is the height. The normal is halfway, and is stretched back. With c the stretched cosine, the cap's
    height is 1 - r^2 (1 + c), and its normal's is (1 - r^2) (1 + c); 1 - c = sin^2 / (1 + c).
    """
    x, y, c = unit((alpha * o[0], alpha * o[1], o[2]))
    a, b, rest = disc(u, v)
    rest = maximum(rest, RIM)
    high = 1.0 + c
    radius = sqrt(high * (rest * high + (x * x + y * y) / high))
    return unit((alpha * (a * radius + x), alpha * (b * radius + y), rest * high))


@inlined
def fresnel(cosine, eta):
    """Reflectance of a dielectric and the cosine behind it; eta = n_t / n_i. Total reflection: 1 and 0."""
    cosine = minimum(cosine, 1.0)
    sin2 = (1.0 - cosine) * (1.0 + cosine) / (eta * eta)
    inside = select(sin2 < 1.0, sqrt(maximum(1.0 - sin2, 0.0)), splat(0.0, sin2))
    return select(sin2 < 1.0, dielectric_reflectance(cosine, inside, eta), splat(1.0, sin2)), inside


@inlined
def reflection_density(o, h, alpha):
    """Density of the direction that h reflects to o, 1 / sr, for visible normals: D (G1 / cos) / 4 [Walter2007]."""
    return 0.25 * (ggx(h, alpha) * visible(o, alpha))


@inlined
def transmission_density(o, h, alpha, cosines, eta):
    """Density of the direction that h refracts to o, 1 / sr, for visible normals [Walter2007, equation 17].

    D (G1 / cos) c_o eta^2 c_t / (c_o - eta c_t)^2, with the cosines c_o and c_t before and behind h. By Snell's law
    c_o - eta c_t = (1 - eta^2) / (c_o + eta c_t), which loses no digits.
    """
    before, behind = cosines
    bend = eta / (1.0 + eta) * ((before + eta * behind) / (1.0 - eta))
    return ggx(h, alpha) * visible(o, alpha) * (before * behind) * (bend * bend)
