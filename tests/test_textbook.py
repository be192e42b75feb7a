"""The textbook package: each function against an answer known by hand or a twin, and whole images."""

from pathlib import Path

import numpy as np
import pytest

import naive
import naive_sampling
import raytrace as rt
from raytrace import textbook
from raytrace.scene.load import load
from shipped_scenes import SCENES as DIRECT

SCENES = Path(__file__).parents[1] / "scenes"
SIZE, SPP = (64, 64), 4


def soup(count, seed):
    """Random triangles, as vertices and faces."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-1, 1, (count, 1, 3))
    return (centre + rng.normal(0, 0.2, (count, 3, 3))).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def rays(count, seed):
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(count, 3))
    return rng.uniform(-1, 1, (count, 3)), d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.parametrize("name", [path.stem for path in DIRECT])
def test_it_renders_every_scene_as_the_kernels_do(name):
    scene = load(SCENES / f"{name}.json")
    settings = scene.settings
    fast = rt.render(scene, spp=SPP, size=SIZE, precision="float64").rgb
    positions = naive_sampling.film_points(settings.sampler, settings.seed, SPP, (0, 0, *SIZE))
    slow = textbook.render(scene, size=SIZE, positions=positions)
    differ = (np.abs(slow - fast) > 1e-5 * np.maximum(1.0, fast)).any(axis=2)
    assert differ.mean() <= 0.005  # pixels at edges, where an epsilon of 1e-9 may decide
    assert slow.max() > 0.01


def test_moller_trumbore_solves_the_equation_of_the_ray_and_the_triangle():
    vertices, faces = soup(200, 1)
    corners = np.moveaxis(vertices[faces], 1, 0)
    o, _ = rays(200, 2)
    weights = np.random.default_rng(3).dirichlet((1, 1, 1, 0.3), 200)  # the fourth moves the target off the triangle
    d = np.einsum("kn,nkc->nc", weights[:, :3].T, vertices[faces]) + weights[:, 3:] * (1.0, 0, 0) - o
    t, u, v = textbook.moller_trumbore(o, d, *corners)
    hit = np.isfinite(t)
    assert 50 < hit.sum() < 150
    v0, v1, v2 = np.moveaxis(vertices[faces[hit]], 1, 0)
    w = np.stack([1 - u - v, u, v])[:, hit, None]
    np.testing.assert_allclose(o[hit] + t[hit, None] * d[hit], w[0] * v0 + w[1] * v1 + w[2] * v2, atol=1e-12)
    assert (w >= 0).all()


def test_a_ray_in_the_plane_of_a_triangle_misses():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert textbook.moller_trumbore(np.array([-1.0, 0.2, 0]), np.array([1.0, 0, 0]), *triangle)[0] == np.inf


@pytest.mark.parametrize(
    ("o", "d", "tmax", "met"),
    [
        ((-1, 0.5, 0.5), (1, 0, 0), np.inf, True),
        ((-1, 0.5, 0.5), (-1, 0, 0), np.inf, False),  # behind
        ((-1, 0.5, 0.5), (1, 0, 0), 0.5, False),  # ends before
        ((0.5, 0.5, 0.5), (0, 0, 1), np.inf, True),  # starts inside
        ((-1, 0, 0.5), (1, 0, 0), np.inf, True),  # in a face: 0 times infinity
        ((-1, 0, 0.5), (1, -0.0, 0), np.inf, True),
        ((-1, 1, 0.5), (1, -0.0, 0), np.inf, True),
        ((-1, 1.5, 0.5), (1, 0, 0), np.inf, False),
        ((-1, -1, -1), (1, 1, 1), np.inf, True),  # through two corners
    ],
)
def test_slab(o, d, tmax, met):
    with np.errstate(divide="ignore"):
        inverse = 1 / np.array([d], float)
    enter, leave = textbook.slab(np.array([o], float), inverse, np.zeros(3), np.ones(3))
    assert ((enter <= leave) & (leave >= 0) & (enter <= tmax)) == [met]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_no_ray_misses_a_box_whose_corner_it_aims_at(dtype):
    rng = np.random.default_rng(9)
    low = rng.random((20_000, 3)).astype(dtype)
    high = low + rng.random((20_000, 3)).astype(dtype)
    corner = np.where(rng.random(low.shape) < 0.5, low, high)
    o = np.array([3.1, 2.7, 4.3], dtype)
    enter, leave = textbook.slab(o, 1 / (corner - o), low, high)
    assert (enter <= leave).all()
    assert (leave >= 0).all()


def test_irradiance_over_a_closed_surface_is_the_flux():
    theta, phi = (np.mgrid[0:200, 0:400] + 0.5) * np.pi / 200
    p = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1).reshape(-1, 3)
    patch = np.sin(theta).reshape(-1, 1) * (np.pi / 200) ** 2  # area on the unit sphere
    flux = np.array([10.0, 20.0, 30.0])
    light = np.array([0.3, 0.5, -0.2])
    np.testing.assert_allclose((textbook.irradiance(p, -p, light, flux) * patch).sum(axis=0), flux, rtol=1e-3)
    assert (textbook.irradiance(p, p, light, flux) == 0).all()  # from behind


def test_pixel_centres():
    centres = textbook.pixel_centres((3, 2))
    assert centres.shape == (2, 3, 1, 2)
    assert centres[1, 2, 0].tolist() == [2.5, 1.5]


def test_the_tree_holds_every_triangle_once_and_boxes_hold_what_is_below_them():
    tree = textbook.median_split(*soup(101, 3))
    assert sorted(tree.prim_id) == list(range(101))
    for low, high, first, count in zip(tree.low, tree.high, tree.first, tree.length, strict=True):
        below = tree.corners[:, first : first + count]
        assert (low == below.min(axis=(0, 1))).all()
        assert (high == below.max(axis=(0, 1))).all()


def test_traversal_finds_what_a_list_of_all_triangles_gives():
    vertices, faces = soup(150, 4)
    o, d = rays(500, 5)
    found, listed = (
        textbook.traverse(textbook.median_split(vertices, faces), o, d),
        naive.closest_hit(vertices, faces, o, d),
    )
    assert (found.prim_id == listed.prim_id).all()
    assert 50 < (found.prim_id >= 0).sum() < 450
    for ours, theirs in zip(found, listed, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_of_hits_at_the_same_t_the_lowest_prim_id_wins():
    vertices, faces = soup(12, 6)
    tree = textbook.median_split(vertices, np.concatenate([faces, faces]))
    hits = textbook.traverse(tree, *rays(300, 7))
    assert (hits.prim_id < 12).all()
    assert (hits.prim_id >= 0).any()


def test_refraction_follows_snell_and_is_total_beyond_the_critical_angle():
    angle = np.linspace(0.0, 1.5, 31)
    d = np.stack([np.sin(angle), -np.cos(angle), 0 * angle], axis=1)
    n = np.broadcast_to([0.0, 1.0, 0.0], d.shape)
    for eta in (1.5, 1 / 1.5):
        t, total = textbook.refract(d, n, eta)
        np.testing.assert_allclose(np.linalg.norm(t, axis=1), 1, atol=1e-15)
        np.testing.assert_array_equal(total, np.sin(angle) / eta >= 1)
        np.testing.assert_allclose(t[~total, 0], np.sin(angle[~total]) / eta, atol=1e-15)
        np.testing.assert_allclose(t[total], d[total] * [1, -1, 1], atol=1e-15)


@pytest.mark.parametrize("spp", [1, 2, 4, 5, 9, 12])
def test_stratified_samples_lie_in_cells_of_their_own(spp):
    width, height = 5, 3
    xy = textbook.stratified((width, height), spp, seed=8)
    nx = int(np.ceil(np.sqrt(spp)))
    ny = int(np.ceil(spp / nx))
    row, column = np.mgrid[:height, :width]
    local = xy - np.stack([column, row], axis=-1)[:, :, None]
    assert (local >= 0).all()
    assert (local < 1).all()
    cells = np.floor(local[..., 0] * nx) + nx * np.floor(local[..., 1] * ny)
    assert all(len(set(pixel)) == spp for pixel in cells.reshape(-1, spp).tolist())


def test_the_mean_of_many_images_is_the_converged_image():
    scene = load(SCENES / "glass-slab.json")
    images = np.array([textbook.render(scene, spp=4, size=(6, 6), seed=seed) for seed in range(48)])
    reference = rt.render(scene, spp=1024, size=(6, 6), precision="float64").rgb
    spread = images.std(axis=0, ddof=1) / np.sqrt(len(images))
    assert (np.abs(images.mean(axis=0) - reference) < 5 * spread + 1e-4).all()


def test_its_path_tracer_agrees_with_the_kernels():
    """Two implementations that share no code but the records: t-test of the means of images with fixed seeds."""
    scene = load(SCENES / "caustic.json")
    slow = np.array([textbook.render(scene, spp=4, size=(12, 12), seed=seed).mean() for seed in range(16)])
    fast = np.array([rt.render(scene, spp=64, size=(12, 12), seed=seed).rgb.mean() for seed in range(16)])
    spread = np.sqrt(slow.var(ddof=1) / 16 + fast.var(ddof=1) / 16)
    assert abs(slow.mean() - fast.mean()) < 4 * spread
    assert spread < 0.05 * fast.mean()


LAMP = {"type": "diffuse", "albedo": [0.3, 0.2, 0.1], "emission": [3, 2, 1]}
GREY = {"type": "diffuse", "albedo": [0.6, 0.5, 0.4]}
POINT = [{"type": "point", "position": [0.2, 0.9, 0.4], "flux": [20, 25, 30]}]
MATERIALS = {  # of a ball in a room, and lights
    "a ball that is a lamp": (LAMP, []),
    "a mirror and a point light": ({"type": "mirror", "reflectance": [0.9, 0.7, 0.5]}, POINT),
    "glass": ({"type": "dielectric", "ior": 1.5}, POINT),
    "glass of the course": ({"type": "refractive", "ior": 1.5}, POINT),
}


@pytest.mark.parametrize("name", MATERIALS)
def test_its_path_tracer_agrees_with_the_kernels_on_each_material_and_light(name):
    """t-test of the means of 3 x 3 blocks and of the whole image, with fixed seeds."""
    ball, lights = MATERIALS[name]
    turned = {"axis": [1, 0, 0], "angle": 90}
    scene = load(
        {
            "camera": {"position": [0, 0, 0.99], "look_at": [0, -0.2, 0], "fov": 90},
            "render": {"integrator": "path", "max_depth": 4},
            "lights": lights,
            "materials": {"ball": ball, "lamp": LAMP, "grey": GREY},
            "objects": [
                {"box": {}, "material": "grey", "flip": True},
                {"sphere": {"center": [0, -0.4, -0.2], "radius": 0.45, "tolerance": 0.02}, "material": "ball"},
                {"rectangle": {}, "material": "lamp", "scale": 0.4, "rotate": turned, "translate": [0.3, 0.97, 0]},
                {"rectangle": {}, "material": "lamp", "scale": 0.2, "translate": [-0.3, 0, -0.9]},
            ],
        }
    )

    def blocks(rgb):
        means = rgb.reshape(3, 3, 3, 3, 3).mean(axis=(1, 3, 4))
        return np.append(means.ravel(), means.mean())

    slow = np.array([blocks(textbook.render(scene, spp=16, size=(9, 9), seed=seed)) for seed in range(6)])
    fast = np.array([blocks(rt.render(scene, spp=64, size=(9, 9), seed=seed).rgb) for seed in range(8)])
    spread = np.sqrt(slow.var(axis=0, ddof=1) / len(slow) + fast.var(axis=0, ddof=1) / len(fast))
    assert (np.abs(slow.mean(axis=0) - fast.mean(axis=0)) < 5.5 * spread).all()
    assert spread[-1] < 0.03 * fast.mean()


@pytest.mark.parametrize(
    ("lights", "what"),
    [
        ([{"type": "environment", "radiance": [1, 1, 1]}], "environments"),
        ([{"type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1]}], "directional lights"),
    ],
)
def test_its_path_tracer_refuses_by_name_what_it_does_not_have(lights, what):
    scene = {
        "camera": {"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 30},
        "render": {"integrator": "path"},
        "lights": lights,
        "materials": {"white": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
        "objects": [{"rectangle": {}, "material": "white"}],
    }
    with pytest.raises(rt.OptionError, match=what):
        textbook.render(scene, spp=1, size=(4, 4))


def test_its_path_tracer_refuses_lamps_among_transparent_shadows():
    scene = {
        "camera": {"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 30},
        "render": {"integrator": "path"},
        "materials": {"lamp": LAMP, "glass": {"type": "dielectric", "ior": 1.5, "shadows": "transparent"}},
        "objects": [{"rectangle": {}, "material": "lamp"}, {"box": {}, "material": "glass", "translate": [0, 0, 2]}],
    }
    with pytest.raises(rt.OptionError, match="transparent shadows among lamps"):
        textbook.render(scene, spp=1, size=(4, 4))
