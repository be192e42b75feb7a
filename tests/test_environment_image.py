"""Environment images: lookup, sampling, and light, against twins and closed forms."""

import json

import numpy as np
import pytest

import raytrace as rt
from raytrace.errors import SceneError
from raytrace.passes import angles, environment
from raytrace.rendering.environment_table import begins_of, make_environment_table
from raytrace.texture_records import BILINEAR, EnvironmentImage, Texture

SHAPE = 6, 12  # texels
PLANE = [{"rectangle": {}, "material": "grey"}]


def image_of(texels, turn=None):
    """An environment image of texels (h, w, 3), row 0 up."""
    codes = np.ascontiguousarray(np.asarray(texels, np.float32)[::-1])
    return EnvironmentImage(Texture(BILINEAR, codes, None, (1.0, 1.0), codes.mean((0, 1))), 1.0, np.eye(3))


def random_texels(seed=1):
    """Some texels are black, some far brighter than others."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1, (*SHAPE, 3)) * 10.0 ** rng.integers(-1, 2, (*SHAPE, 1)) * (rng.random((*SHAPE, 1)) > 0.3)


@pytest.fixture(scope="module")
def write(tmp_path_factory):
    """A function that writes an EXR of texels, and returns its scene with one light."""
    OpenEXR = pytest.importorskip("OpenEXR")
    folder = tmp_path_factory.mktemp("images")

    def written(texels, name="sky.exr", objects=PLANE, look=(0, 0, -1), integrator="direct", **light):
        channels = {"RGB": np.ascontiguousarray(texels, np.float32)}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, channels).write(str(folder / name))
        data = {
            "camera": {"position": [0, 0, 4], "look_at": [*look[:2], 4 + look[2]], "fov": 40},
            "film": {"size": [8, 8]},
            "render": {"integrator": integrator, "max_depth": 4},
            "lights": [{"type": "environment", "image": name, **light}],
            "materials": {
                "grey": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]},
                "mirror": {"type": "mirror", "reflectance": [1, 1, 1]},
            },
            "objects": objects,
        }
        return load(data, folder)

    return written


def load(data, folder):
    """Load a scene whose files lie in a folder."""
    path = folder / "scene.json"
    path.write_text(json.dumps(data))
    return rt.load(path)


def filtered(texels, u, v):
    """Bilinear radiance at (u, v), as design and documents state it: a slow twin."""
    h, w = texels.shape[:2]
    x, y = u * w - 0.5, np.clip(v * h - 0.5, 0, h - 1)
    i, j = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), h - 1)
    s, t = (x - i)[:, None], (y - j)[:, None]
    below = np.minimum(j + 1, h - 1)
    top = texels[j, i % w] * (1 - s) + texels[j, (i + 1) % w] * s
    return top * (1 - t) + t * (texels[below, i % w] * (1 - s) + texels[below, (i + 1) % w] * s)


def uv_of(d):
    """(u, v) of unit directions (3, n)."""
    return np.arctan2(d[0], -d[2]) / (2 * np.pi) % 1, np.arccos(np.clip(d[1], -1, 1)) / np.pi


def samples(table, n, seed):
    """Directions (3, n) that the pass draws, their densities and radiances."""
    rng = np.random.default_rng(seed)
    first, second = rng.integers(0, 2**32, (2, n), dtype=np.uint32)
    j, i, corners, s, t, some = environment.sample_cell(table, first, second, np.zeros(n, table.texels.dtype))
    colour = environment.filtered(corners, s, t)
    d, sine = environment.direction(table, j, i, s, t)
    assert some.all()
    return np.array(d, np.float64), environment.density(table, j, i, corners, colour, sine), np.array(colour)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_angles_are_within_2_ulp(dtype):
    rng = np.random.default_rng(2)
    x, y = (rng.uniform(-1, 1, (2, 3000)) * 10.0 ** rng.integers(-6, 1, (2, 3000))).astype(dtype)
    exact = np.arctan2(y.astype(np.float64), x.astype(np.float64))  # within 1 ulp of float64
    assert (np.abs(angles.atan2(y, x) - exact) <= 2 * np.spacing(np.abs(exact).astype(dtype))).all()
    u = rng.random(3000).astype(dtype)
    sine, cosine = angles.sin_cos_of_turns(u)
    turns = 2 * np.pi * u.astype(np.float64)
    bound = 4 * np.finfo(dtype).eps
    assert np.abs(sine - np.sin(turns)).max() < bound
    assert np.abs(cosine - np.cos(turns)).max() < bound


def test_angles_at_the_axes():
    y, x = np.array([0.0, 1.0, 0.0, -1.0, 0.0]), np.array([1.0, 0.0, -1.0, 0.0, 0.0])
    np.testing.assert_array_equal(angles.atan2(y, x), [0, np.pi / 2, np.pi, -np.pi / 2, 0])
    sine, cosine = angles.sin_cos_of_turns(np.array([0, 0.25, 0.5, 0.75, 1.0]))
    np.testing.assert_array_equal(sine, [0, 1, 0, -1, 0])
    np.testing.assert_array_equal(cosine, [1, 0, -1, 0, 1])


def test_every_weight_gets_a_number_and_no_other():
    weights = np.array([0, 1e-30, 5, 0, 1, 1e-12, 0])
    counts = np.diff(begins_of(weights).astype(np.int64))
    assert ((counts > 0) == (weights > 0)).all()
    assert counts.sum() == 2**32 - 1
    np.testing.assert_allclose(counts[[2, 4]] / 2**32, [5 / 6, 1 / 6], rtol=1e-8)


def test_the_radiance_is_the_filtered_image():
    texels = random_texels()
    table = make_environment_table(image_of(texels), 1.0, np.float64)
    d = np.random.default_rng(3).normal(size=(3, 2000))
    d /= np.linalg.norm(d, axis=0)
    colour, _ = environment.seen(table, tuple(d))
    np.testing.assert_allclose(
        np.array(colour).T, filtered(texels.astype(np.float32), *uv_of(d)), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_sampled_direction_has_the_density_and_the_radiance_that_are_seen_there(dtype):
    table = make_environment_table(image_of(random_texels()), 0.25, np.dtype(dtype))
    d, pdf, colour = samples(table, 1500, 4)
    seen, density = environment.seen(table, tuple(d.astype(dtype)))
    tolerance = 1e-3 if dtype == "float32" else 1e-10
    np.testing.assert_allclose(density, pdf, rtol=tolerance, atol=tolerance * np.median(pdf))
    np.testing.assert_allclose(np.array(seen), colour, rtol=tolerance, atol=tolerance)


def test_directions_follow_their_density():
    """Chi-square over quarters of cells, against sums of the filtered luminance times the sine."""
    texels, n = random_texels(), 200_000
    table = make_environment_table(image_of(texels), 1.0, np.float64)
    d, pdf, _ = samples(table, n, 5)
    u, v = uv_of(d)
    h, w = SHAPE
    places = (np.floor(v * 2 * h).astype(int) * 2 * w + np.floor(u * 2 * w).astype(int)).ravel()
    observed = np.bincount(places, minlength=4 * h * w)
    expected = n * exact_shares(texels)
    assert observed[expected == 0].sum() == 0
    many = expected > 10
    rest = np.append(expected[many], expected[~many].sum()), np.append(observed[many], observed[~many].sum())
    kept = rest[0] > 0
    chi2, freedom = (((rest[1] - rest[0]) ** 2)[kept] / rest[0][kept]).sum(), kept.sum() - 1
    z = ((chi2 / freedom) ** (1 / 3) - (1 - 2 / (9 * freedom))) / np.sqrt(2 / (9 * freedom))  # Wilson and Hilferty
    assert abs(z) < 3.3
    np.testing.assert_allclose(np.mean(1 / pdf), visible_solid_angle(texels), rtol=0.02)


def exact_shares(texels):
    """Probability of each quarter of a cell: that of the cell, times its part of the integral of the luminance."""
    luminance = texels.astype(np.float32).astype(np.float64) @ np.array([0.2126, 0.7152, 0.0722])
    h, w = SHAPE
    edges = np.concatenate([[0], (np.arange(h) + 0.5) / h, [1]])
    solid = np.cos(np.pi * edges[:-1]) - np.cos(np.pi * edges[1:])
    shares = np.zeros((2 * h, 2 * w))
    for j in range(h + 1):
        for i in range(w):
            a, b = luminance[max(j - 1, 0), i - 1], luminance[max(j - 1, 0), i]
            c, e = luminance[min(j, h - 1), i - 1], luminance[min(j, h - 1), i]
            halves = (0,) if j in (0, h) else (0, 1)
            for down in halves:
                for across in (0, 1):
                    s = 0.25 + 0.5 * across
                    t = 0.5 if len(halves) == 1 else 0.25 + 0.5 * down
                    middle = (a * (1 - s) + b * s) * (1 - t) + (c * (1 - s) + e * s) * t
                    row = 0 if j == 0 else 2 * h - 1 if j == h else 2 * j - 1 + down
                    shares[row, (2 * i - 1 + across) % (2 * w)] += middle * solid[j] / (2 * len(halves))
    return (shares / shares.sum()).ravel()


def visible_solid_angle(texels):
    """Solid angle where the filtered radiance is above 0: the mean of 1 / pdf."""
    u, v = np.random.default_rng(6).random((2, 400_000))
    return 4 * np.pi * np.average(filtered(texels, u, v).sum(axis=1) > 0, weights=np.sin(np.pi * v))


def test_axes_of_the_image(write):
    """Camera rays see the texel whose centre they point at: u runs from -z over +x, v from +y down."""
    texels = np.arange(8 * 16 * 3, dtype=np.float32).reshape(8, 16, 3) / 384
    for j, i in ((3, 0), (4, 5), (2, 11)):
        phi, theta = 2 * np.pi * (i + 0.5) / 16, np.pi * (j + 0.5) / 8
        look = np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)
        far = [{"rectangle": {}, "scale": 1e-3, "translate": [0, 90, 0], "material": "grey"}]
        scene = write(texels, objects=far, look=look)
        image = rt.render(scene, size=(65, 65), spp=1)
        np.testing.assert_allclose(image.rgb[32, 32], texels[j, i], rtol=2e-2)


def test_rotate_turns_the_image_as_an_object(write):
    texels = random_texels()
    mirror = [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "mirror"}]
    turned = rt.render(write(texels, objects=mirror, rotate={"axis": [0, 1, 0], "angle": 90}), spp=4).rgb
    rolled = np.roll(texels, -SHAPE[1] // 4, axis=1)  # counter-clockwise from above: what stood at +x stands at -z
    np.testing.assert_allclose(turned, rt.render(write(rolled, "rolled.exr", mirror), spp=4).rgb, rtol=1e-3, atol=1e-4)


def test_a_bright_texel_is_a_directional_light(write):
    """Irradiance L (pi / h)^2 sin(theta_j) on a plane that faces it, to a relative (pi / h)^2."""
    height, j, bright = 32, 12, 3000.0
    texels = np.zeros((height, 2 * height, 3))
    texels[j, height] = bright  # seen at u = (h + 1/2) / 2h: nearly +z, slightly towards -x
    theta, phi = np.pi * (j + 0.5) / height, 2 * np.pi * (height + 0.5) / (2 * height)
    towards = [np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)]
    turn = {"axis": np.cross([0, 0, 1], towards).tolist(), "angle": float(np.degrees(np.arccos(towards[2])))}
    scene = write(texels, objects=[{"rectangle": {}, "scale": 3, "rotate": turn, "material": "grey"}])
    image = rt.render(scene, spp=16, size=(4, 4)).rgb
    expected = 0.5 / np.pi * bright * (np.pi / height) ** 2 * np.sin(theta)
    np.testing.assert_allclose(image, expected, rtol=(np.pi / height) ** 2)


def test_a_sun_of_one_pixel_converges_at_once(write):
    texels = np.full((64, 128, 3), 0.01)
    texels[20, 70] = 1e3
    plane = [{"rectangle": {}, "scale": 9, "material": "grey"}]
    image = rt.render(write(texels, objects=plane), spp=16, size=(16, 16))
    theta, phi = np.pi * 20.5 / 64, 2 * np.pi * 70.5 / 128
    sun = (1e3 - 0.01) * (np.pi / 64) ** 2 * np.sin(theta) * -np.sin(theta) * np.cos(phi)
    expected = 0.5 / np.pi * (sun + 0.01 * np.pi)
    # with a density that is constant per texel, 44 % of the sun is found by one sample of some 10^5
    assert image.rgb.std(axis=(0, 1)).max() < 0.1 * image.rgb.mean()
    np.testing.assert_allclose(image.rgb.mean(), expected, rtol=0.01)


def test_a_constant_image_is_the_constant_environment(write):
    texels = np.full((4, 8, 3), 0.5)
    ball = [{"sphere": {"center": [0, 0, 0], "radius": 3}, "material": "grey"}]  # it fills the view
    scene = write(texels, objects=ball, integrator="path", scale=2.0)
    means = np.array([rt.render(scene, spp=16, seed=seed, sampler="independent").rgb.mean() for seed in range(8)])
    assert abs(means.mean() - 0.5) < 4 * means.std(ddof=1) / np.sqrt(8)  # a convex body shows albedo times radiance


@pytest.mark.parametrize(
    ("light", "text"),
    [
        ({"image": "none.exr"}, "none.exr: no such file"),
        ({"radiance": [1, 1, 1], "image": "sky.exr"}, '"radiance" and "image" exclude each other'),
        ({"radiance": [1, 1, 1], "scale": 2}, '"radiance" and "scale" exclude each other'),
        ({}, 'missing key "radiance", or "image" instead'),
        ({"image": "sky.exr", "scale": -1}, "expected a number >= 0"),
        ({"image": "sky.exr", "rotate": {"axis": [0, 0, 0], "angle": 1}}, "axis"),
    ],
)
def test_wrong_environments_are_named(write, tmp_path, light, text):
    write(np.full((2, 4, 3), 0.5))
    data = {
        "camera": {"position": [0, 0, 4], "look_at": [0, 0, 0], "fov": 40},
        "lights": [{"type": "environment", **light}],
        "materials": {"grey": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
        "objects": PLANE,
    }
    with pytest.raises((SceneError, rt.FileError), match=text.replace('"', ".")):
        load(data, tmp_path)


@pytest.mark.parametrize("light", [{"scale": 4e36}, {"scale": 1e308}])
def test_radiance_near_the_end_of_float32_is_refused(write, light):
    with pytest.raises(SceneError, match=r"sky.*: with scale \S+ its radiance is up to \S+; at most 1e\+36"):
        write(np.full((2, 4, 3), 0.5), **light)


def test_an_unknown_key_of_an_environment_is_one_problem(write):
    with pytest.raises(SceneError, match=r"unknown key .encoding.") as caught:
        write(np.full((2, 4, 3), 0.5), encoding="srgb")
    assert len(str(caught.value).splitlines()) == 1


def test_negative_radiance_is_counted(write):
    texels = np.full((2, 4, 3), 0.5)
    texels[0, :3, 1] = -1
    with pytest.raises(SceneError, match="3 of 8 texels are negative or not finite"):
        write(texels, "negative.exr")
