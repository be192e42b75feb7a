"""Rounding in the mappings and formulas of light transport, in both precisions: the bounds of docs/numerics.md.

References have 40 digits, or float64 where float32 is judged.
"""

from collections.abc import Callable
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

import raytrace as rt
from raytrace.passes import fresnel, warp
from raytrace.passes.lights import COLUMNS, DENSITY, TRIANGLE, high_product
from raytrace.rendering.light_table import make_light_table
from raytrace.scene.metals import INDEX

F8 = NDArray[np.float64]
PRECISIONS = ("float32", "float64")
BITS = 24  # of a random number
COUNT = {"float32": 200_000, "float64": 600}
SEED = 11


def unit_roundoff(precision: str) -> float:
    return float(np.finfo(precision).eps) / 2


def high(function: Callable[..., object], *columns: NDArray[np.floating]) -> NDArray[np.object_]:
    """A function of numbers with 40 digits, row by row."""
    with mpmath.workdps(40):
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return np.array([function(*map(mpmath.mpf, row)) for row in rows], object)


def relative(found: NDArray[np.floating], exact: NDArray) -> float:
    """Largest relative error; where the answer is 0, so must be what was found."""
    with mpmath.workdps(40):
        wide = found.astype(np.float64).astype(exact.dtype)
        zero = exact == 0
        assert not np.any(found[zero])
        return float(np.max(np.abs(wide - exact)[~zero] / np.abs(exact[~zero])))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_sine_and_cosine_are_right_within_two_units_in_the_last_place(precision):
    rng, n = np.random.default_rng(SEED), COUNT[precision]
    largest = np.asarray(np.pi / 4).astype(precision)
    x = np.concatenate([np.linspace(-1, 1, n) * (np.pi / 4), 10.0 ** rng.uniform(-30, -0.2, n // 4)])
    x = np.clip(x.astype(precision), -largest, largest)
    x = x[x != 0]
    for found, double, many in zip(warp.sin_cos(x), (np.sin, np.cos), (mpmath.sin, mpmath.cos), strict=True):
        exact = double(x.astype(np.float64)) if precision == "float32" else high(many, x)
        ulp = np.spacing(np.abs(exact.astype(np.float64)).astype(precision)).astype(np.float64)
        assert found.dtype == x.dtype
        with mpmath.workdps(40):
            errors = np.abs(found.astype(np.float64).astype(exact.dtype) - exact) / ulp
        assert 0.3 < float(errors.max()) <= 2


def squares(precision: str) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Points of the unit square that random numbers can be; corners, middle and axes too."""
    rng = np.random.default_rng(SEED)
    whole = rng.integers(0, 2**BITS, (2, COUNT[precision]))
    ends = np.array([0, 1, 2 ** (BITS - 1) - 1, 2 ** (BITS - 1), 2 ** (BITS - 1) + 1, 2**BITS - 1])
    u, v = np.concatenate([whole, np.stack(np.meshgrid(ends, ends)).reshape(2, -1)], axis=1)
    return (u * 2.0**-BITS).astype(precision), (v * 2.0**-BITS).astype(precision)


def exact_disc(u, v):
    """Shirley's and Chiu's map, with 40 digits."""
    a, b = 2 * u - 1, 2 * v - 1
    wide = abs(a) > abs(b)
    r, across = (a, b) if wide else (b, a)
    angle = mpmath.pi / 4 * across / r if r else mpmath.mpf(0)
    s, c = r * mpmath.sin(angle), r * mpmath.cos(angle)
    return (c, s, (1 - r) * (1 + r)) if wide else (s, c, (1 - r) * (1 + r))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_disc_map_has_small_relative_errors(precision):
    u, v = (column[-636:] for column in squares(precision))
    with mpmath.workdps(40):
        exact = np.array(
            [exact_disc(mpmath.mpf(a), mpmath.mpf(b)) for a, b in zip(u.tolist(), v.tolist(), strict=True)]
        )
    found = warp.disc(u, v)
    for axis, roundings in enumerate((8, 8, 2)):
        assert relative(found[axis], exact[:, axis]) <= roundings * unit_roundoff(precision) * (1 + 1e-6)
    assert (found[2] >= 0).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("mapping", "roundings"), [(warp.cosine_hemisphere, 9), (warp.sphere, 18)])
def test_directions_have_unit_length(precision, mapping, roundings):
    u, v = squares(precision)
    w = [column.astype(np.longdouble) for column in mapping(u, v)]  # no narrower than float64
    length = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    assert np.abs(length - 1).max() <= roundings * unit_roundoff(precision)


def exact_reflectance(cos_i, eta):
    """Fresnel's equations as books have them, with 40 digits."""
    sin2 = (1 - cos_i**2) / eta**2
    if sin2 >= 1:
        return mpmath.mpf(1)
    cos_t = mpmath.sqrt(1 - sin2)
    rs = (cos_i - eta * cos_t) / (cos_i + eta * cos_t) if cos_i + eta * cos_t else mpmath.mpf(1)
    rp = (eta * cos_i - cos_t) / (eta * cos_i + cos_t) if eta * cos_i + cos_t else mpmath.mpf(1)
    return (rs**2 + rp**2) / 2


def cosines(precision: str, least: float = 0.0) -> NDArray[np.floating]:
    """Cosines from the least to 1: evenly, and close to both ends."""
    near = 10.0 ** np.linspace(-7, 0, 150)
    spread = np.concatenate([np.linspace(0, 1, 200)[1:], near, 1 - near[:-1]])
    return np.clip(least + (1 - least) * spread, 0, 1).astype(precision)


def reflectance(cos_i, eta):
    return fresnel.dielectric_reflectance(cos_i, fresnel.transmitted_cosine(cos_i, eta), eta)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("index", [1 + 2.0**-20, 1 + 2.0**-12, 1.5, 1e3])
def test_reflectance_from_outside_is_right_to_twenty_roundings(precision, index):
    cos_i = cosines(precision)
    eta = np.full_like(cos_i, index)
    found = reflectance(cos_i, eta)
    assert relative(found, high(exact_reflectance, cos_i, eta)) <= 20 * unit_roundoff(precision)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_an_interface_of_equal_indices_reflects_nothing(precision):
    cos_i = cosines(precision)
    assert not reflectance(cos_i, np.ones_like(cos_i)).any()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("index", [1 - 2.0**-12, 1 / 1.5, 0.1])
def test_reflectance_from_inside_is_that_of_a_cosine_four_roundings_away(precision, index):
    """Near the critical angle the reflectance has no derivative, so the error is that of the question."""
    u = unit_roundoff(precision)
    least = np.sqrt(1 - float(np.asarray(index).astype(precision)) ** 2)
    cos_i = cosines(precision, least)
    eta = np.full_like(cos_i, index)
    with mpmath.workdps(40):
        above = high(lambda c, e: exact_reflectance(c * (1 - 4 * u), e), cos_i, eta)
        below = high(lambda c, e: exact_reflectance(min(c * (1 + 4 * u), mpmath.mpf(1)), e), cos_i, eta)
        found = np.clip(reflectance(cos_i, eta), 0, 1).astype(np.float64).astype(object)
        low, top = np.minimum(above, below), np.maximum(above, below)
        assert (found >= low * (1 - 20 * u)).all()
        assert (found <= top * (1 + 20 * u)).all()


def exact_metal(cos_i, eta, k):
    """Fresnel's equations with the complex index eta - i k."""
    n = mpmath.mpc(eta, -k)
    cos_t = mpmath.sqrt(n * n - (1 - cos_i**2))
    rs, rp = (cos_i - cos_t) / (cos_i + cos_t), (n * n * cos_i - cos_t) / (n * n * cos_i + cos_t)
    return (abs(rs) ** 2 + abs(rp) ** 2) / 2


@pytest.mark.parametrize("precision", PRECISIONS)
def test_reflectance_of_metals_is_right_to_sixty_four_roundings(precision):
    cosine = cosines(precision)[::5]
    indices = np.array([rgb for metal in INDEX.values() for rgb in zip(*metal, strict=True)], precision)
    eta, k = (np.repeat(column, len(cosine)) for column in indices.T)
    cos_i = np.tile(cosine, len(indices))
    found = fresnel.conductor_reflectance(cos_i, eta, k)
    assert relative(found, high(exact_metal, cos_i, eta, k)) <= 64 * unit_roundoff(precision)


@pytest.mark.parametrize("n", [1, 3, 1000, 65_537, 2**24 - 1])
def test_rows_of_the_alias_table_are_drawn_evenly_to_two_to_the_minus_32(n):
    """Row k has the random numbers h with h n / 2^32 in [k, k + 1): 2^32 / n of them, rounded down or up."""
    rng = np.random.default_rng(SEED)
    rows = np.unique(np.concatenate([[0, n - 1], rng.integers(0, n, 200)]))
    first = [-(-(int(k) << 32) // n) for k in (*rows, n)]  # the smallest h of a row
    ends = [-(-((int(k) + 1) << 32) // n) - 1 for k in rows]  # the largest
    for places in (first[:-1], ends):
        h = np.array(places, np.uint32)
        assert (high_product(h, np.uint32(n)) == rows.astype(np.uint32)).all()
    counts = np.array([end - start + 1 for start, end in zip(first[:-1], ends, strict=True)])
    assert (np.abs(counts / 2**32 - 1 / n) <= 2.0**-32).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_table_of_lights_holds_the_probabilities_with_which_they_are_drawn(precision):
    """A light of a ten-millionth of the power is drawn by a few of 2^24 numbers: its share is not that of its power."""
    grey = {"type": "diffuse", "albedo": [0.5] * 3}
    powers = (1, 1e-7, 3, 1e-3, 0.2)
    scene = rt.load(
        {
            "camera": {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 40},
            "lights": [{"type": "point", "position": [0, 0, k + 1], "flux": [p] * 3} for k, p in enumerate(powers)],
            "materials": {"grey": grey, "lamp": grey | {"emission": [1e-5] * 3}},
            "objects": [{"rectangle": {}, "material": "grey"}, {"box": {}, "material": "lamp", "scale": 0.1}],
        }
    )
    table = make_light_table(scene, rt.BVH(scene.mesh.vertices, scene.mesh.faces, precision))
    n = len(table.share)
    exact = [Fraction(0)] * n
    for row, (keep, other) in enumerate(zip(table.keep.tolist(), table.other.tolist(), strict=True)):
        of_row = Fraction(-(-((row + 1) << 32) // n) + (-(row << 32) // n), 2**32)
        kept = -(-Fraction(keep) * 2**24 // 1)  # how many multiples of 2^-24 lie below keep
        exact[row] += of_row * Fraction(kept, 2**24)
        exact[other] += of_row * (1 - Fraction(kept, 2**24))
    assert sum(exact) == 1
    np.testing.assert_allclose(table.share, np.array(exact, np.float64), rtol=2 * np.finfo(precision).eps)
    assert abs(table.share[1] / (1e-7 / sum(powers)) - 1) > 1e-3
    lamp = table.kind == TRIANGLE
    densities = table.numbers.reshape(n, COLUMNS)[lamp, DENSITY]
    np.testing.assert_allclose(densities, table.share[lamp] / 0.02, rtol=4 * np.finfo(precision).eps)
