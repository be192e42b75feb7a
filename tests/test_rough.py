"""Images of rough surfaces and of plastic: against ``rt.bsdf``, quadrature and closed forms."""

import itertools
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import raytrace as rt
from light_cases import environment, mesh
from raytrace.errors import OptionError, SceneError
from raytrace.passes.rough import facing
from raytrace.rendering.kernels import needs, traits_of
from raytrace.scene.plan import make_plan
from raytrace.textbook.path import fresnel, refuse
from scattering_oracles import at_angle
from small_scenes import quad

METAL = {"type": "conductor", "eta": [0.2, 0.9, 1.4], "k": [3.9, 2.5, 1.6]}
GLASS = {"type": "dielectric", "ior": 1.5}
PLASTIC = {"type": "plastic", "albedo": [0.2, 0.5, 0.8], "ior": 1.5}
PRECISIONS = ("float32", "float64")
SIGMAS = 4.5
PLANE = quad((-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0))
TURN = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3  # a rotation: no plane and no rounding error is special


def seen(material: Any, wo: np.ndarray, integrator: str = "path", depth: int = 1, **more: Any) -> dict[str, Any]:
    """A plane of a material, seen from the direction wo from its normal, above or below; all is turned by ``TURN``."""
    objects = [{"mesh": mesh(PLANE @ TURN.T), "material": "m"}, *more.pop("objects", [])]
    return {
        "camera": {"position": (TURN @ (5 * wo)).tolist(), "look_at": [0, 0, 0], "up": [0, 1, 0.001], "fov": 1e-4},
        "render": {"integrator": integrator, "max_depth": depth},
        "materials": {"m": material, **more.pop("materials", {})},
        "objects": objects,
        **more,
    }


def images(scene: dict[str, Any], precision: str, spp: int = 64, seeds: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Mean colour of an image and its standard error, over seeds."""
    loaded = rt.load(scene)
    means = [
        rt.render(loaded, spp=spp, size=(8, 8), seed=seed, precision=precision).rgb.mean(axis=(0, 1), dtype=np.float64)
        for seed in range(seeds)
    ]
    return np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / math.sqrt(seeds)


# Light from one point: no noise ---------------------------------------------------------------------------------------

LIT = [
    ({**METAL, "alpha": 0.001}, 30, -30.2),
    ({**METAL, "alpha": 0.2}, 60, 40),
    ({**GLASS, "alpha": 0.3}, 30, 20),
    ({**GLASS, "alpha": 0.3}, 30, 195),
    ({**GLASS, "alpha": 0.05}, 150, -45),
    ({**GLASS, "alpha": 0.3}, 150, 10),
    (PLASTIC, 60, 40),
]


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("material", "of", "to"), LIT)
def test_a_point_light_shows_the_scattering_function(material, of, to, precision):
    """L = f cos Phi / (4 pi r^2), above and below the surface; the light lies in the plane of the view."""
    wo, wi = at_angle(of), at_angle(to)
    light = {"type": "point", "position": (TURN @ (2 * wi)).tolist(), "flux": [4 * math.pi * 4] * 3}
    expected = rt.bsdf.eval(material, wo, wi)[0] * abs(wi[2])
    assert expected.max() > 1e-4
    for integrator in ("path", "direct"):
        image = rt.render(seen(material, wo, integrator, lights=[light]), spp=4, size=(4, 4), precision=precision)
        lobe = material.get("alpha", 1.0)  # the narrower, the more the offset of shadow rays changes
        tolerance = 5e-4 + (4e-6 if precision == "float32" else 2e-7) / lobe
        np.testing.assert_allclose(image.rgb.mean(axis=(0, 1)), expected, rtol=tolerance)


# Light that is sampled in two ways ------------------------------------------------------------------------------------

ABOVE = np.array([[-0.5, -0.5, 1.5], [-0.5, 0.5, 1.5], [0.5, 0.5, 1.5], [0.5, -0.5, 1.5]])
MIRRORED = ABOVE + [-0.9, -0.75, 0]  # around the direction in which a view at 40 degrees is reflected


def lamp_integral(material: dict[str, Any], wo: np.ndarray, corners: np.ndarray, n: int = 400) -> np.ndarray:
    """Integral of f cos cos' / r^2 over a rectangle of radiance 1, by midpoints."""
    at = (np.arange(n) + 0.5) / n
    u, v = np.meshgrid(at, at)
    first, second = corners[1] - corners[0], corners[3] - corners[0]
    q = corners[0] + u.reshape(-1, 1) * first + v.reshape(-1, 1) * second
    normal = np.cross(first, second)
    area, r2 = np.linalg.norm(normal), (q**2).sum(axis=1)
    wi = q / np.sqrt(r2)[:, None]
    cosines = np.abs(wi[:, 2]) * np.maximum(-(wi @ normal) / area, 0) / r2
    return np.asarray((rt.bsdf.eval(material, wo, wi) * cosines[:, None]).mean(axis=0) * area)


def coat(material: dict[str, Any], wo: np.ndarray) -> np.ndarray:
    """What a smooth surface of the same index reflects of light in the mirrored direction."""
    smooth = {**material, "type": "dielectric" if material["type"] == "plastic" else material["type"], "alpha": 0}
    smooth.pop("albedo", None)
    _, weight, _ = rt.bsdf.sample(smooth, wo, np.zeros(3))
    return weight[0] if material["type"] == "conductor" else np.full(3, fresnel(np.array(wo[2]), 1.5))


LAMPS = [
    (METAL | {"alpha": 0.001}, 40, MIRRORED),
    (METAL | {"alpha": 0.1}, 30, ABOVE),
    (GLASS | {"alpha": 0.1}, 160, ABOVE),
    (PLASTIC, 50, ABOVE),
    (PLASTIC, 40, MIRRORED),
]


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("material", "of", "corners"), LAMPS)
def test_a_lamp_counts_once(material, of, corners, precision):
    """A lamp above the plane, seen by reflection or through it: quadrature over its area, and what a coat mirrors."""
    lamp = {"materials": {"lamp": {"type": "diffuse", "albedo": [0, 0, 0], "emission": [1, 1, 1]}}}
    lamp["objects"] = [{"mesh": mesh(quad(*corners) @ TURN.T), "material": "lamp"}]
    wo, narrow = at_angle(of), material.get("alpha") == 0.001
    expected = np.zeros(3) if narrow else lamp_integral(material, wo, corners)
    if corners is MIRRORED:
        expected = expected + coat(material, wo)
    for integrator in ("path", "direct"):
        mean, spread = images(seen(material, wo, integrator, **lamp), precision)
        assert (np.abs(mean - expected) <= SIGMAS * spread + 1e-3 * expected).all()
        assert (spread < 0.05 * expected).all()


@pytest.mark.parametrize(
    ("material", "degrees"), [(METAL | {"alpha": 0.5}, 60), (GLASS | {"alpha": 0.3}, 130), (PLASTIC, 40)]
)
def test_even_light(material, degrees):
    """In an environment of radiance 1 a surface shows the mean weight of its samples."""
    wo = at_angle(degrees)
    u = np.random.default_rng(1).random((400_000, 3))
    weight = rt.bsdf.sample(material, np.broadcast_to(wo, u.shape), u)[1]
    mean, spread = images(seen(material, wo, lights=environment(1.0)), "float32")
    spread = np.hypot(spread, weight.std(axis=0) / len(u) ** 0.5)
    assert (np.abs(mean - weight.mean(axis=0)) <= SIGMAS * spread).all()
    assert (spread < 0.02).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    ("material", "expected"),
    [
        ({"type": "conductor", "reflectance": [1, 1, 1], "alpha": 1}, 1 - math.log(2)),
        ({"type": "plastic", "albedo": [1, 1, 1], "ior": 1.5}, 1.0),
    ],
)
def test_even_light_in_closed_form(material, expected, precision):
    """Head-on, alpha 1 reflects 1 - ln 2 of an even environment, as test_bsdf.py derives; white plastic all of it."""
    mean, spread = images(seen(material, at_angle(0), lights=environment(1.0)), precision)
    assert (np.abs(mean - expected) <= SIGMAS * spread + 1e-6).all()
    assert (spread < 0.01).all()


# Rules of the scene ---------------------------------------------------------------------------------------------------


def test_materials_that_scatter_do_not_disturb_each_other():
    """A light shines on four strips; each has the bits that it has where all strips are alike.

    No strip begins where a packet of 4 x 4 pixels does.
    """
    kinds = [{"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}, METAL | {"alpha": 0.3}, GLASS | {"alpha": 0.3}, PLASTIC]
    edges = -1.9, -1.3, 0.2, 0.75, 1.9
    strips = [quad((x, -1, 0), (y, -1, 0), (y, 1, 0), (x, 1, 0)) for x, y in itertools.pairwise(edges)]

    def image(materials):
        scene = seen(kinds[0], np.array([0.0, 0.001, 1.0]))
        scene["camera"] |= {"fov": 22, "position": [0, 0.001, 5]}
        scene["lights"] = [{"type": "point", "position": [0.3, 0.2, 1], "flux": [9, 9, 9]}]
        scene["materials"] = {f"m{k}": material for k, material in enumerate(materials)}
        scene["objects"] = [{"mesh": mesh(strip), "material": f"m{k}"} for k, strip in enumerate(strips)]
        return rt.render(scene, spp=1, size=(32, 16))

    mixed = image(kinds)
    strip = mixed.aov["prim_id"] // 2
    strip[:, 1:-1][(strip[:, 1:-1] != strip[:, :-2]) | (strip[:, 1:-1] != strip[:, 2:])] = -1  # a sample may be off it
    for k, kind in enumerate(kinds):
        assert mixed.rgb[strip == k].any()
        np.testing.assert_array_equal(mixed.rgb[strip == k], image([kind] * 4).rgb[strip == k])


@pytest.mark.parametrize("integrator", ["path", "direct"])
@pytest.mark.parametrize("material", [METAL | {"alpha": 0.1}, GLASS | {"alpha": 0.1}, PLASTIC])
def test_background_is_not_seen_in_surfaces_that_scatter(material, integrator):
    scene = seen(material, at_angle(30), integrator, depth=4)
    scene["lights"] = [{"type": "point", "position": (TURN @ [1, 1, 2]).tolist(), "flux": [9, 9, 9]}]
    dark, bright = (
        rt.render(scene | {"background": [colour] * 3}, spp=4, size=(4, 4), precision="float32").rgb
        for colour in (0, 1)
    )
    np.testing.assert_array_equal(dark, bright)


def test_below_the_least_alpha_a_surface_is_smooth():
    lamp = {"lights": environment(0.5)}
    for material in (METAL, GLASS):
        scenes = [seen(material | {"alpha": alpha}, at_angle(40), depth=3, **lamp) for alpha in (0, 9.9e-4)]
        first, second = (rt.render(scene, spp=4, size=(4, 4)).rgb for scene in scenes)
        np.testing.assert_array_equal(first, second)
        assert "roughness of m" not in str(rt.explain(scenes[0]))
        assert "alpha 0.00099 is below 0.001: the surface is smooth" in str(rt.explain(scenes[1]))
    rough = str(rt.explain(seen(METAL | {"alpha": 1e-3}, at_angle(40), **lamp)))
    assert "rough conductor  one ray more" in rough
    equal = str(rt.explain(seen({"type": "dielectric", "ior": 1, "alpha": 0.5}, at_angle(40), **lamp)))
    assert "its ior is 1" in equal


def test_a_rough_dielectric_of_almost_equal_media_needs_float64():
    plan = rt.explain(seen({"type": "dielectric", "ior": 1.0001, "alpha": 0.01}, at_angle(40)))
    assert plan.precision.name == "float64"
    assert "rough dielectric" in plan.precision.why
    assert rt.explain(seen(GLASS | {"alpha": 0.01}, at_angle(40))).precision.name == "float32"


def test_shadow_rays_pass_no_rough_surface():
    for shadows in ("transparent", "opaque"):
        with pytest.raises(SceneError, match=r"materials\.m\.shadows: shadow rays cannot pass a rough surface"):
            rt.load(seen(GLASS | {"alpha": 0.1, "shadows": shadows}, at_angle(40)))
    rt.load(seen(GLASS | {"alpha": 1e-4, "shadows": "transparent"}, at_angle(40)))


def test_the_albedo_layer():
    scenes = [seen(material, at_angle(40), lights=environment(1.0)) for material in (PLASTIC, GLASS, METAL)]
    layers = [rt.render(scene, spp=1, size=(2, 2)).aov["albedo"][0, 0] for scene in scenes]
    metal = [((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2) for eta, k in zip(METAL["eta"], METAL["k"], strict=True)]
    np.testing.assert_allclose(layers, [PLASTIC["albedo"], [1, 1, 1], metal], rtol=1e-6)


def test_the_viewer_behind_the_shading_normal_sees_the_geometric_one():
    wo, ng = ((np.array([x]), np.array([y]), np.array([z])) for x, y, z in ((0.8, 0, 0.6), (0, 0, 1)))
    for ns, expected in (((0.6, 0.0, 0.8), 0.8), ((-0.8, 0.0, 0.6), 1.0)):
        assert facing(wo, ng, tuple(np.array([x]) for x in ns))[2] == expected


@pytest.mark.parametrize("material", [METAL | {"alpha": 0.3}, GLASS | {"alpha": 0.3}, PLASTIC])
def test_coarse_smooth_meshes_stay_finite(material):
    scene = seen(material, at_angle(0), depth=8, lights=environment(0.5))
    ball = {"sphere": {"center": [0, 0, 0], "radius": 1, "tolerance": 0.3}, "normals": "smooth", "material": "m"}
    image = rt.render(scene | {"objects": [ball], "camera": scene["camera"] | {"fov": 22}}, spp=16, size=(16, 16)).rgb
    assert np.isfinite(image).all()
    assert image.min() >= 0
    assert image.max() < 2


def test_the_textbook_refuses_by_name():
    with pytest.raises(OptionError, match="does not have rough surfaces"):
        refuse(rt.load(seen(METAL | {"alpha": 0.1}, at_angle(40))))
    with pytest.raises(OptionError, match="does not have plastic"):
        refuse(rt.load(seen(PLASTIC, at_angle(40))))


def test_other_scenes_do_not_import_these_materials():
    program = (
        "from raytrace.rendering.scattering import scattering_passes as s; s({0}); import sys; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=600)
    assert not {"raytrace.passes.rough", "raytrace.passes.plastic"} & set(done.stdout.split())


@pytest.mark.parametrize("material", [METAL | {"alpha": 0.3}, GLASS | {"alpha": 0.3}, PLASTIC])
def test_warm_up_knows_the_kernels(material):
    scene = rt.load(seen(material, at_angle(40), lights=environment(1.0)))
    traits = traits_of(scene, make_plan(scene), "float32", scene.settings)
    names = {getattr(kernel, "__name__", "") for kernel, _ in needs(traits)}
    assert names & {"scatter_conductors", "scatter_dielectrics", "scatter_plastic"}
    assert "pick_lights" in names
