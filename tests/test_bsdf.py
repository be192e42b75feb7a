"""``rt.bsdf``: scattering functions against quadrature, closed forms and exact arithmetic."""

import math

import mpmath
import numpy as np
import pytest

import raytrace as rt
from raytrace.errors import OptionError, SceneError
from raytrace.passes.microfacet import reflection_density, transmission_density, visible_normal
from raytrace.passes.plastic import coat_escape
from raytrace.passes.rough import evaluate_conductor, evaluate_dielectric
from raytrace.testing.charts import cell_integrals
from raytrace.textbook.path import fresnel
from scattering_oracles import MATERIALS, at_angle, chi_square, energy, side_chart

ALL = {
    **{name: {**material, "alpha": 0.3} for name, material in MATERIALS.items() if name != "plastic"},
    "plastic": MATERIALS["plastic"],
    "diffuse": {"type": "diffuse", "albedo": [0.2, 0.5, 0.8]},
    "mirror": {"type": "mirror", "reflectance": [0.2, 0.5, 0.8]},
    "smooth conductor": MATERIALS["conductor"],
    "smooth dielectric": MATERIALS["dielectric"],
    "refractive": {"type": "refractive", "ior": 1.5},
}
ABOVE, BELOW = (0, 30, 60, 80), (100, 130, 170)


def directions(n, seed=0):
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


# Sampling -------------------------------------------------------------------------------------------------------------

DRAWN = [
    *(("conductor", alpha, degrees) for alpha, degrees in ((1e-3, 30), (1e-3, 80), (0.1, 60), (0.4, 0), (1.0, 80))),
    *(("dielectric", alpha, degrees) for alpha, degrees in ((1e-3, 30), (0.1, 60), (0.4, 130), (1.0, 0), (1.0, 170))),
    *(("plastic", None, degrees) for degrees in (0, 80)),
]


@pytest.mark.parametrize(("name", "alpha", "degrees"), DRAWN)
def test_samples_have_the_density_that_pdf_states(name, alpha, degrees):
    material = {**MATERIALS[name], **({"alpha": alpha} if alpha else {})}
    assert chi_square(material, at_angle(degrees), 20_000, 64) > 1e-4


def test_the_chi_square_test_sees_a_wrong_density():
    rough, rougher = ({**MATERIALS["dielectric"], "alpha": alpha} for alpha in (0.3, 0.33))
    assert chi_square(rough, at_angle(30), 20_000, 64, drawn=rougher) < 1e-6


@pytest.mark.parametrize("name", ALL)
def test_weights_are_f_cos_over_pdf(name):
    material, wo = ALL[name], directions(2000)
    wi, weight, pdf = rt.bsdf.sample(material, wo, np.random.default_rng(1).random((2000, 3)))
    np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1, atol=1e-14)
    some = np.isfinite(pdf) & (pdf > 0)
    assert some.any() == ("smooth" not in name and name not in ("mirror", "refractive"))
    expected = rt.bsdf.eval(material, wo, wi) * np.abs(wi[:, 2:])
    np.testing.assert_allclose((weight * pdf[:, None])[some], expected[some], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(pdf[some], rt.bsdf.pdf(material, wo, wi)[some], rtol=1e-7)
    assert (weight[pdf == 0] == 0).all()


# What the functions are -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [1e-3, 0.1, 1.0])
@pytest.mark.parametrize("degrees", [0, 60, 85])
def test_weak_white_furnace(alpha, degrees):
    """The integral of D G1(o) / (4 cos) over all directions is 1, also over those below the surface [Walter2007]."""
    o = at_angle(degrees)

    def density(i):
        h = o + i
        h = tuple((h / np.linalg.norm(h, axis=1, keepdims=True)).T)
        seen = (h[2] > 0) & (sum(a * b for a, b in zip(o, h, strict=True)) > 0)
        return seen * reflection_density(tuple(np.full(len(i), x) for x in o), h, alpha)

    mirror = np.array([-o[0], -o[1], o[2]])
    total = sum(
        cell_integrals(density, chart, 24, np.arange(24 * 24), 12).sum()
        for chart in (side_chart(mirror, alpha), side_chart(-mirror, 1.0))
    )
    assert total == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("degrees", [0, 60, 85])
def test_weak_white_furnace_of_transmission(degrees):
    """Without Fresnel's factor the transmitted density integrates to 1 too, into a denser medium."""
    o, eta, alpha = at_angle(degrees), 1.5, 0.3

    def density(i):
        h = -(o + eta * i)
        h = h / np.linalg.norm(h, axis=1, keepdims=True)
        before, behind = h @ o, -(h * i).sum(axis=1)
        there = (h[:, 2] > 0) & (before > 0) & (behind > 0)
        view = tuple(np.full(len(i), x) for x in o)
        return np.where(there, transmission_density(view, tuple(h.T), alpha, (before, behind), eta), 0.0)

    through = np.array([*(-o[:2] / eta), -math.sqrt(1 - (o[:2] @ o[:2]) / eta**2)])
    total = sum(
        cell_integrals(density, chart, 24, np.arange(24 * 24), 16).sum()
        for chart in (side_chart(through, 0.2), side_chart(np.array([-through[0], -through[1], -through[2]]), 1.0))
    )
    assert total == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("name", ["conductor", "dielectric", "plastic", "diffuse"])
def test_reciprocity(name):
    """f(o, i) = f(i, o); through an interface f / n^2 of the viewer's side is what is symmetric [Veach1997, 5.2]."""
    material, wo, wi = (
        {**ALL[name], **({"two_sided": True} if name == "plastic" else {})},
        *directions(4000).reshape(2, -1, 3),
    )
    there, back = rt.bsdf.eval(material, wo, wi), rt.bsdf.eval(material, wi, wo)
    n2 = np.where(wo[:, 2] > 0, 1.0, material["ior"] ** 2) if name == "dielectric" else np.ones(len(wo))
    m2 = np.where(wi[:, 2] > 0, 1.0, material["ior"] ** 2) if name == "dielectric" else n2
    assert (there > 0).any(axis=1).mean() > 0.1
    np.testing.assert_allclose(there / n2[:, None], back / m2[:, None], rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("name", ["conductor", "dielectric"])
def test_no_more_light_leaves_than_arrives(name):
    for alpha in (0.1, 1.0):
        for degrees in (*ABOVE, *(BELOW if name == "dielectric" else ())):
            assert (energy({**MATERIALS[name], "alpha": alpha}, at_angle(degrees), 12) < 1.002).all()


def test_what_one_scattering_loses():
    """At normal incidence and alpha 1, D = 1 / pi, G1 = 2 c / (1 + c), and f cos is c / (1 + c) / (2 pi): 1 - ln 2."""
    white = {"type": "conductor", "reflectance": [1, 1, 1]}
    share = [energy({**white, "alpha": alpha}, at_angle(0))[0] for alpha in (0.1, 0.3, 0.5, 1.0)]
    assert share[3] == pytest.approx(1 - math.log(2), abs=1e-4)
    assert np.round(share[:3], 3).tolist() == [0.988, 0.877, 0.688]  # as in docs/light-transport.md


# Plastic --------------------------------------------------------------------------------------------------------------


def closed_form(n):
    """Diffuse reflectance from outside, in closed form [Walsh 1926]; loses digits near n = 1."""
    a = (n - 1) * (3 * n + 1) / (6 * (n + 1) ** 2) + n**2 * (n**2 - 1) ** 2 / (n**2 + 1) ** 3 * math.log(
        (n - 1) / (n + 1)
    )
    b = 2 * n**3 * (n**2 + 2 * n - 1) / ((n**2 + 1) * (n**4 - 1))
    return 0.5 + a - b + 8 * n**4 * (n**4 + 1) / ((n**2 + 1) * (n**4 - 1) ** 2) * math.log(n)


@pytest.mark.parametrize("n", [1.01, 1.33, 1.5, 2.4, 10.0])
def test_diffuse_reflectance_from_inside(n):
    inside, outside = 1 - coat_escape(np.array([n, 1 / n]))
    assert outside == pytest.approx(closed_form(n), abs=1e-12)  # 1 / n: from the dense side of the other interface
    assert inside == pytest.approx(1 - (1 - closed_form(n)) / n**2, abs=1e-12)
    c = (np.arange(200_000) + 0.5) / 200_000
    share = np.where(1 - c**2 < 1 / n**2, fresnel(c, 1 / n), 1.0)
    assert inside == pytest.approx(2 * (share * c).mean(), abs=1e-6)


@pytest.mark.parametrize("degrees", ABOVE)
def test_plastic_in_even_light(degrees):
    """F + (1 - F) a (1 - F_in) / (1 - a F_in): reflected at once, or let in, scattered and let out."""
    a, inner = np.array(MATERIALS["plastic"]["albedo"]), 1 - coat_escape(np.array([1.5]))[0]
    f = fresnel(np.array(math.cos(math.radians(degrees))), 1.5)
    expected = f + (1 - f) * a * (1 - inner) / (1 - a * inner)
    wo, u = np.broadcast_to(at_angle(degrees), (100_000, 3)), np.random.default_rng(5).random((100_000, 3))
    weight = rt.bsdf.sample(MATERIALS["plastic"], wo, u)[1]
    assert (np.abs(weight.mean(axis=0) - expected) < 4 * weight.std(axis=0) / len(u) ** 0.5).all()


def test_plastic_without_a_coat_is_diffuse():
    wo, wi = directions(2000).reshape(2, -1, 3)
    plastic = rt.bsdf.eval({"type": "plastic", "albedo": [0.2, 0.5, 0.8], "ior": 1}, wo, wi)
    np.testing.assert_allclose(plastic, rt.bsdf.eval(ALL["diffuse"], wo, wi), rtol=1e-12)


def test_white_plastic_loses_nothing():
    white = {"type": "plastic", "albedo": [1, 1, 1], "ior": 1.5}
    wo, u = np.broadcast_to(at_angle(60), (200_000, 3)), np.random.default_rng(5).random((200_000, 3))
    weight = rt.bsdf.sample(white, wo, u)[1][:, 0]
    assert weight.mean() == pytest.approx(1, abs=5 * weight.std() / len(weight) ** 0.5)


# Rounding -------------------------------------------------------------------------------------------------------------


def exact_density(o, i, alpha, eta):
    """Density of i among reflections (eta None) or transmissions, without Fresnel's factor, to 50 digits."""
    with mpmath.workdps(50):
        o, i = ([mpmath.mpf(float(x)) for x in v] for v in (o, i))
        o, i = ([x / mpmath.sqrt(sum(y * y for y in v)) for x in v] for v in (o, i))
        h = [a + (1 if eta is None else eta) * b for a, b in zip(o, i, strict=True)]
        length = mpmath.sqrt(sum(x * x for x in h)) * (1 if eta is None or eta < 1 else -1)
        h = [x / length for x in h]
        alpha = mpmath.mpf(alpha)
        d = alpha**2 / (mpmath.pi * (h[0] ** 2 + h[1] ** 2 + alpha**2 * h[2] ** 2) ** 2)
        visible = 2 / (o[2] + mpmath.sqrt(o[2] ** 2 + alpha**2 * (o[0] ** 2 + o[1] ** 2)))
        before, behind = (abs(sum(x * y for x, y in zip(v, h, strict=True))) for v in (o, i))
        if eta is None:
            return float(d * visible / 4)
        return float(d * visible * before * behind * eta**2 / (before - eta * behind) ** 2)


@pytest.mark.parametrize(("dtype", "limit"), [(np.float32, 2e-3), (np.float64, 4e-12)])
@pytest.mark.parametrize("eta", [None, 1.5, 1 / 1.5])
def test_the_smallest_alpha_keeps_its_digits(dtype, limit, eta):
    """Densities at alpha = 1e-3 of the directions that sampling finds, where they matter; errors cancel on average."""
    rng, n, alpha = np.random.default_rng(3), 400, dtype(1e-3)
    o = np.stack([at_angle(degrees) for degrees in rng.uniform(0, 40 if eta else 80, n)], axis=1).astype(dtype)
    full = np.full(n, alpha)
    h = np.stack(visible_normal(tuple(o), full, *rng.random((2, n)).astype(dtype)))
    assert h.dtype == dtype
    cosine = (o * h).sum(axis=0)
    if eta is None:
        i = (2 * cosine * h - o).astype(dtype)
        _, got = evaluate_conductor(
            tuple(o), tuple(i), full, tuple(np.ones((3, n), dtype)), tuple(np.ones((3, n), dtype))
        )
        share = np.ones(n)
    else:
        behind = np.sqrt(1 - (1 - cosine**2) / dtype(eta) ** 2)
        i = ((cosine / dtype(eta) - behind) * h - o / dtype(eta)).astype(dtype)
        _, got = evaluate_dielectric(tuple(o), tuple(i), full, np.full(n, dtype(eta)))
        share = 1 - fresnel(cosine.astype(np.float64), eta)
    exact = np.array(
        [exact_density(o[:, k], i[:, k], float(alpha), None if eta is None else float(dtype(eta))) for k in range(n)]
    )
    error = got / (exact * share) - 1
    assert np.abs(error).max() < limit
    assert abs(error.mean()) < limit / 20


@pytest.mark.parametrize("degrees", [0, 60, 85])
def test_sampled_normals_keep_their_digits(degrees):
    """Slopes of visible normals at alpha = 1e-3, in float32 against float64."""
    u, v = np.random.default_rng(4).random((2, 2000)).astype(np.float32)
    o = at_angle(degrees)
    slopes = {}
    for dtype in (np.float32, np.float64):
        view = tuple(np.full(2000, x, dtype) for x in o)
        x, y, z = visible_normal(view, np.full(2000, 1e-3, dtype), u.astype(dtype), v.astype(dtype))
        slopes[dtype] = np.stack([x / z, y / z]).astype(np.float64)
    steep = np.linalg.norm(slopes[np.float64], axis=0)
    assert (np.linalg.norm(slopes[np.float32] - slopes[np.float64], axis=0) < 1e-4 * steep + 1e-9).all()


# The interface --------------------------------------------------------------------------------------------------------


def test_smooth_materials_have_one_direction():
    wo, u = at_angle(40), [[0.5, 0.5, 0.99], [0.5, 0.5, 0.0]]
    wi, weight, pdf = rt.bsdf.sample(ALL["smooth dielectric"], wo, u)
    assert np.isinf(pdf).all()
    np.testing.assert_allclose(wi[0], [*(-wo[:2] / 1.5), -math.sqrt(1 - (wo[:2] @ wo[:2]) / 2.25)], atol=1e-15)
    np.testing.assert_allclose(wi[1], [-wo[0], -wo[1], wo[2]], atol=1e-15)
    np.testing.assert_allclose(weight, [[1 / 2.25] * 3, [1.0] * 3], rtol=1e-12)
    for name in ("mirror", "smooth conductor", "smooth dielectric", "refractive"):
        assert not rt.bsdf.eval(ALL[name], wo, wi).any()
        assert not rt.bsdf.pdf(ALL[name], wo, wi).any()
    assert rt.bsdf.sample(ALL["smooth conductor"], wo, u)[1] == pytest.approx(
        rt.bsdf.sample({**ALL["smooth conductor"], "alpha": 1e-4}, wo, u)[1]
    )


@pytest.mark.parametrize("name", ["diffuse", "plastic"])
def test_backs_reflect_only_where_the_material_says_so(name):
    wo, wi, u = at_angle(130), at_angle(120), [0.3, 0.3, 0.9]
    assert not rt.bsdf.eval(ALL[name], wo, wi).any()
    assert rt.bsdf.sample(ALL[name], wo, u)[2] == 0
    both = {**ALL[name], "two_sided": True}
    np.testing.assert_allclose(rt.bsdf.eval(both, wo, wi), rt.bsdf.eval(both, at_angle(50), at_angle(60)), rtol=1e-12)
    assert rt.bsdf.sample(both, wo, u)[0][0, 2] < 0


def test_shapes_broadcast():
    wo, wi = np.ones((4, 1, 3)), np.ones((5, 3))
    assert rt.bsdf.eval(ALL["diffuse"], wo, wi).shape == (4, 5, 3)
    assert rt.bsdf.pdf(ALL["diffuse"], [0, 0, 1], wi).shape == (5,)
    assert [x.shape for x in rt.bsdf.sample(ALL["conductor"], wo, np.zeros((5, 3)))] == [(4, 5, 3), (4, 5, 3), (4, 5)]


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: rt.bsdf.eval({"type": "diffuse"}, [0, 0, 1], [0, 0, 1]), SceneError, 'missing key "albedo"'),
        (lambda: rt.bsdf.eval({**ALL["conductor"], "alpha": 2}, [0, 0, 1], [0, 0, 1]), SceneError, "alpha: expected"),
        (lambda: rt.bsdf.pdf(ALL["diffuse"], [0, 0, 0], [0, 0, 1]), OptionError, "other than 0"),
        (lambda: rt.bsdf.pdf(ALL["diffuse"], [0, 1], [0, 0, 1]), OptionError, "rows of three"),
        (lambda: rt.bsdf.pdf(ALL["diffuse"], np.ones((2, 3)), np.ones((3, 3))), OptionError, "broadcast"),
        (lambda: rt.bsdf.sample(ALL["diffuse"], [0, 0, 1], [0, 0, 1]), OptionError, r"\[0, 1\)"),
        (
            lambda: rt.bsdf.pdf({"type": "diffuse", "albedo": {"image": "a.png"}}, [0, 0, 1], [0, 0, 1]),
            OptionError,
            "uv",
        ),
    ],
)
def test_mistakes_are_named(call, error, text):
    with pytest.raises(error, match=text):
        call()
