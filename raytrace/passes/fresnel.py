"""Fresnel's equations for unpolarised light, exact."""

from raytrace.accel.lanes import maximum, select, splat, sqrt
from raytrace.jit import inlined


@inlined
def transmitted_cosine(cos_i, eta):
    """Cosine of the refracted ray; eta = n_t / n_i; 0 where reflection is total.

    cos_t^2 is 1 - sin_t^2, or ((eta - 1) (eta + 1) + cos_i^2) / eta^2: the second where sin_t^2 and eta^2 are above
    1/2, so that nothing is lost at grazing incidence on an interface of nearly equal indices [docs/numerics.md].
    """
    eta2 = eta * eta
    sin2 = (1.0 - cos_i) * (1.0 + cos_i) / eta2
    grazing = ((eta - 1.0) * (eta + 1.0) + cos_i * cos_i) / eta2
    return sqrt(maximum(select((sin2 < 0.5) | (eta2 < 0.5), 1.0 - sin2, grazing), 0.0))


@inlined
def dielectric_reflectance(cos_i, cos_t, eta):
    """Share of the light that an interface of two dielectrics reflects; eta = n_t / n_i.

    r_s = (cos_i - eta cos_t) / (cos_i + eta cos_t) = (1 - eta^2) / (cos_i + eta cos_t)^2, by Snell's law, and
    r_p = r_s (cos_i cos_t - sin_i sin_t) / (cos_i cos_t + sin_i sin_t), with sin_i sin_t = sin_i^2 / eta: no difference
    of numbers that are nearly equal, but for the zero at Brewster's angle, where it is harmless
    [Pharr2023, 9.3; docs/numerics.md].
    """
    total = cos_i + eta * cos_t
    rs = (1.0 - eta) * (1.0 + eta) / (total * total)
    both, sines = cos_i * cos_t, (1.0 - cos_i) * (1.0 + cos_i) / eta
    rp = rs * (both - sines) / (both + sines)
    share = 0.5 * (rs * rs + rp * rp)
    return select(both + sines > 0.0, share, splat(1.0, share))


@inlined
def conductor_reflectance(cos_i, eta, k):
    """Share of the light that the surface of a conductor of index eta - i k reflects [Pharr2023, 9.3.6; Born1999].

    With a^2 + b^2 = |(eta - i k)^2 - sin^2|: the squares of r_s and r_p, written so that all terms are positive but for
    two differences whose results are at least as large as what rounding does to them.
    """
    cos2 = cos_i * cos_i
    sin2 = (1.0 - cos_i) * (1.0 + cos_i)
    t0 = (eta - k) * (eta + k) - sin2
    norm = sqrt(t0 * t0 + 4.0 * (eta * k) * (eta * k))
    a = sqrt(maximum(0.5 * (norm + t0), 0.0))
    t1, t2 = norm + cos2, 2.0 * a * cos_i
    rs = (t1 - t2) / (t1 + t2)
    t3, t4 = cos2 * norm + sin2 * sin2, t2 * sin2
    share = 0.5 * rs * (1.0 + (t3 - t4) / (t3 + t4))
    everything = ~(k < 1e8) | ~(t1 + t2 > 0.0) | ~(t3 + t4 > 0.0)
    return select(everything, splat(1.0, share), share)
