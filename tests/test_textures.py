"""Textures: what is looked up, against slow twins and closed forms; their scenes, plans and hashes."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import raytrace as rt
import texture_twins as twins
from light_cases import above_square
from raytrace.conformance.formulas import opposed_squares
from raytrace.image.texels import srgb_table
from raytrace.passes import textures
from raytrace.textbook.integrator import render as textbook

RNG = np.random.default_rng(7)
CODES = RNG.integers(0, 256, (4, 6, 3), np.uint8)
SIZE = (24, 24)
GREY = 51  # a code; 51 / 255 is 0.2
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face 1
property list uchar int vertex_indices
end_header
-0.9 -0.9 0.1 51 51 51
0.9 -0.9 0.1 51 51 51
0 0.9 0.1 51 51 51
3 0 1 2
"""
BLACK = {"type": "diffuse", "albedo": [0, 0, 0]}
SUN = {"type": "directional", "direction": [0, 0, -1], "irradiance": [math.pi] * 3}
PRECISIONS = ["float32", "float64"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with images and a mesh."""
    monkeypatch.chdir(tmp_path)
    twins.save_png(tmp_path / "noise.png", CODES)
    twins.save_png(tmp_path / "grey.png", np.full((3, 5, 3), GREY, np.uint8))
    twins.save_png16(tmp_path / "grey16.png", np.full((2, 7, 3), 257 * GREY, np.uint16))
    (tmp_path / "grey.exr").write_bytes(twins.exr(np.full((5, 3, 3), 0.25)))
    (tmp_path / "grey.ply").write_text(PLY)
    return tmp_path


def with_all(scene: dict[str, Any]) -> dict[str, Any]:
    """A scene with a textured lamp and a triangle of vertex colours out of sight: one set of kernels for all tests."""
    lamp = {**BLACK, "emission": {"checkerboard": [[1e-9] * 3] * 2}}  # so dim that it is never sampled
    baked = {"type": "diffuse", "albedo": {"attribute": "color"}}
    hidden = [
        {"rectangle": {}, "material": "lamp", "translate": [50, 0, 0]},
        {"mesh": "grey.ply", "material": "baked", "translate": [60, 0, 0]},
    ]
    materials = scene["materials"] | {"lamp": lamp, "baked": baked}
    return scene | {"materials": materials, "objects": scene["objects"] + hidden, "lights": [SUN]}


# Lookup ---------------------------------------------------------------------------------------------------------------

SCALES = [(1.0, 1.0), (3.5, -2.25), (-0.3, 7.0)]
LOOKUPS = {
    "bilinear": ({"image": "noise.png"}, twins.bilinear),
    "nearest": ({"image": "noise.png", "filter": "nearest"}, twins.nearest),
    "checkerboard": ({"checkerboard": [[0.5, 0.25, 0], [0, 0.125, 1]]}, twins.checkerboard),
}


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("kind", LOOKUPS)
def test_a_plane_seen_head_on_is_its_texture(folder, kind, precision):
    given, twin = LOOKUPS[kind]
    image = np.array(given["checkerboard"]) if kind == "checkerboard" else srgb_table(8)[CODES]
    for scale in SCALES:
        want = twins.expected(lambda u, v: twin(image, u, v), SIZE, scale)
        texture = given | {"scale": scale}
        for material in ({"type": "diffuse", "albedo": texture}, BLACK | {"emission": texture}):
            scene = with_all(twins.head_on(SIZE, material, integrator="direct", precision=precision))
            found = rt.render(scene).rgb
            near = np.isclose(found, want, atol=1e-3 if precision == "float32" else 1e-6, rtol=1e-5).all(axis=2)
            assert near.mean() > (0.99 if precision == "float32" else 0.9999)  # near an edge, rounding decides


def test_the_bottom_row_of_an_image_is_v_0(folder):
    codes = np.zeros((2, 1, 3), np.uint8)
    codes[0] = 255  # the upper half is white
    twins.save_png(folder / "halves.png", codes)
    texture = {"image": "halves.png", "filter": "nearest"}
    picture = rt.render(with_all(twins.head_on((4, 4), BLACK | {"emission": texture}))).rgb[..., 0]
    np.testing.assert_array_equal(picture, [[1] * 4] * 2 + [[0] * 4] * 2)


def test_the_albedo_layer_is_the_texture_at_the_pixel_centres(folder):
    y, x = (np.mgrid[: SIZE[1], : SIZE[0]] + 0.5) / SIZE[1]
    uv = np.stack([(1 + (2 * x - SIZE[0] / SIZE[1]) * 0.999) / 2, (1 + (1 - 2 * y) * 0.999) / 2], axis=-1)
    for given, twin in LOOKUPS.values():
        image = np.array(given["checkerboard"]) if "checkerboard" in given else srgb_table(8)[CODES]
        want = [[twin(image, u * 3, v * 2) for u, v in row] for row in uv.tolist()]
        material = {"type": "diffuse", "albedo": given | {"scale": [3, 2]}}
        layer = rt.render(with_all(twins.head_on(SIZE, material, precision="float64"))).aov["albedo"]
        np.testing.assert_allclose(layer, want, atol=1e-6)
    plain = twins.head_on((4, 4), {"type": "diffuse", "albedo": {"attribute": "color"}})
    plain["objects"][0] = {"mesh": "grey.ply", "material": "a"}
    np.testing.assert_array_equal(rt.render(plain).aov["albedo"][2, 2], np.full(3, 0.2, np.float32))


@pytest.mark.parametrize("dtype", PRECISIONS)
def test_floors_and_fractions_are_exact(dtype):
    eps = np.finfo(dtype).eps
    sizes = np.geomspace(1e-30, 1e30, 700) * RNG.uniform(1, 2, 700)
    whole = np.array([0, 1, 2, 7, 2**22 + 0.5, 2**23 - 0.5, 2**23 + 1, 2**31, 2**33 + 1, 2**52 + 1, 2**63])
    numbers = np.concatenate([sizes, whole, whole + 0.5, np.nextafter(whole, -1)]).astype(dtype)
    numbers = np.concatenate([numbers, -numbers])
    exact = [math.floor(Fraction(float(x))) for x in numbers]
    assert [int(x) for x in textures.floor(numbers, eps)] == exact
    assert textures.is_odd(numbers, eps).tolist() == [bool(x % 2) for x in exact]
    part = textures.fraction(numbers, eps)
    rest = np.array([Fraction(float(x)) - whole for x, whole in zip(numbers, exact, strict=True)]).astype(dtype)
    np.testing.assert_array_equal(part, np.where(rest < 1, rest, 0))
    strange = np.array([np.inf, -np.inf, np.nan], dtype)
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(textures.fraction(strange, eps), 0)
        assert not textures.is_odd(strange, eps).any()


def test_huge_and_negative_uv_in_kernels(folder):
    obj = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt {0} {0}\nvt {1} {0}\nvt {1} {1}\nvt {0} {1}\nf 1/1 2/2 3/3 4/4\n"
    board = BLACK | {"emission": {"checkerboard": [[1, 1, 1], [0, 0, 0]]}}
    for low, high in ((-3e4, 5e4), (-1e9, 1e9), (3e38, -3e38), (1e300, -1e300)):
        (folder / "plane.obj").write_text(obj.format(low, high))
        scene = with_all(twins.head_on((64, 64), board, precision="float32"))
        scene["objects"][0] = {"mesh": "plane.obj", "material": "a"}
        picture = rt.render(scene).rgb[..., 0]
        assert set(np.unique(picture)) <= {0, 1}
        if high == 5e4:
            assert abs(picture.mean() - 0.5) < 0.05


# Light ----------------------------------------------------------------------------------------------------------------


def of_kinds(textured: bool) -> dict[str, Any]:
    """A room of all kinds of materials and textures: constant textures, or the same colours."""

    def pick(texture: dict[str, Any], value: float) -> Any:
        return texture if textured else [value] * 3

    eight, sixteen = srgb_table(8)[GREY], srgb_table(16)[257 * GREY]
    materials = {
        "floor": {"type": "diffuse", "albedo": pick({"image": "grey.png", "scale": [3.3, -2]}, eight)},
        "wall": {"type": "diffuse", "albedo": pick({"image": "grey16.png", "filter": "nearest"}, sixteen)},
        "board": {"type": "diffuse", "albedo": pick({"checkerboard": [[0.3] * 3] * 2, "scale": [9, 9]}, 0.3)},
        "baked": {"type": "diffuse", "albedo": pick({"attribute": "color"}, 0.2), "two_sided": True},
        "plain": {"type": "diffuse", "albedo": [0.6, 0.5, 0.4]},
        "mirror": {"type": "mirror", "reflectance": pick({"image": "grey.png", "encoding": "linear"}, 0.2)},
        "lamp": {**BLACK, "emission": pick({"image": "grey.exr"}, 0.25)},
        "screen": {"type": "diffuse", "albedo": [0.1] * 3, "emission": pick({"checkerboard": [[4, 4, 4]] * 2}, 4.0)},
    }
    down = {"axis": [1, 0, 0], "angle": 90}
    return {
        "camera": {"position": [0, 0.3, 3.4], "look_at": [0, 0, 0], "fov": 50},
        "film": {"size": [24, 24]},
        "materials": materials,
        "objects": [
            {
                "rectangle": {},
                "material": "floor",
                "rotate": {"axis": [1, 0, 0], "angle": -90},
                "translate": [0, -1, 0],
            },
            {"rectangle": {}, "material": "wall", "translate": [0, 0, -1]},
            {
                "rectangle": {},
                "material": "mirror",
                "rotate": {"axis": [0, 1, 0], "angle": 90},
                "translate": [-1, 0, 0],
            },
            {"box": {}, "material": "board", "scale": 0.25, "translate": [0.3, -0.7, 0.3]},
            {"sphere": {"center": [-0.4, -0.6, 0.4], "radius": 0.3, "tolerance": 0.1}, "material": "plain"},
            {"mesh": "grey.ply", "material": "baked", "scale": 0.4, "translate": [0.5, 0.2, 0.6]},
            {"rectangle": {}, "material": "lamp", "rotate": down, "scale": 0.4, "translate": [0, 1, 0]},
            {"rectangle": {}, "material": "screen", "scale": 0.2, "translate": [0.5, 0.4, -0.9]},
        ],
    }


@pytest.mark.parametrize("integrator", ["direct", "path"])
@pytest.mark.parametrize("precision", PRECISIONS)
def test_constant_textures_are_constant_colours_bit_for_bit(folder, precision, integrator):
    textured, plain = rt.load(of_kinds(True)), rt.load(of_kinds(False))
    assert len(textured.textures.table) == 7
    assert plain.textures is None
    render = {"precision": precision, "integrator": integrator, "spp": 4, "sampler": "independent"}
    found = rt.render(textured, **render).rgb
    np.testing.assert_array_equal(found, rt.render(plain, **render).rgb)
    assert len(np.unique(found[..., 0])) > 100


def test_a_constant_reflectance_of_metal(folder):
    def scene(reflectance):
        metal = {"type": "conductor", "reflectance": reflectance}
        return with_all(twins.head_on((8, 8), metal, integrator="path", max_depth=2)) | {"background": [1, 0.5, 0.25]}

    for code in (GREY, 255):
        twins.save_png(folder / "metal.png", np.full((2, 2, 3), code, np.uint8))
        texture = {"image": "metal.png", "encoding": "linear"}
        pair = [[rt.render(scene(each), precision=p).rgb for each in (texture, [code / 255] * 3)] for p in PRECISIONS]
        np.testing.assert_allclose(*pair[0], rtol=1e-6)  # float32: k is rounded once for a constant
        np.testing.assert_array_equal(*pair[1])
        np.testing.assert_allclose(pair[0][0][4, 4], np.array([1, 0.5, 0.25]) * code / 255, rtol=1e-3)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_light_of_a_textured_lamp_is_that_of_its_mean(folder, integrator):
    """Two opposed squares: by symmetry, each quarter of the lamp sends a quarter of the light [Howell C-11]."""
    board = {"checkerboard": [[3.5, 0, 1], [0.5, 2, 0]], "scale": [2, 2]}
    lamp = {"rectangle": {}, "material": "b", "scale": 0.5, "flip": True, "translate": [0, 0, 1]}
    scene = {
        "camera": above_square(),
        "film": {"size": [16, 16]},
        "render": {"integrator": integrator, "max_depth": 1, "spp": 16, "precision": "float32"},
        "materials": {"a": {"type": "diffuse", "albedo": [0.8] * 3}, "b": BLACK | {"emission": board}},
        "objects": [{"rectangle": {}, "material": "a", "scale": 0.5}, lamp],
    }
    loaded = rt.load(scene)
    means = np.array([rt.render(loaded, seed=seed).rgb.mean(axis=(0, 1), dtype=np.float64) for seed in range(8)])
    want = 0.8 * opposed_squares() * np.array([2, 1, 0.5])
    spread = means.std(axis=0, ddof=1) / math.sqrt(8)
    assert (abs(means.mean(axis=0) - want) <= 4.5 * spread + 1e-5 * want).all()
    assert (spread < 0.02 * want).all()


def test_a_textured_lamp_lights_as_lamps_of_its_texels(folder):
    """A lamp of 2 x 2 texels close to a floor, and four lamps in the same places: the same light on each quarter."""
    values = np.array([[1.0, 8.0], [4.0, 0.25]])  # row 0 at the top
    (folder / "quarters.exr").write_bytes(twins.exr(values[:, :, None] * [1, 1, 1]))
    one = {"rectangle": {}, "material": "all", "scale": 0.5, "flip": True, "translate": [0, 0, 0.3]}
    materials = {"all": BLACK | {"emission": {"image": "quarters.exr", "filter": "nearest"}}}
    scene = {
        "camera": {"position": [0, 0, 0.25], "look_at": [0, 0, 0], "fov": math.degrees(2 * math.atan(2))},
        "film": {"size": [16, 16]},
        "render": {"max_depth": 1, "spp": 16, "precision": "float32"},
    }
    floor, white = {"rectangle": {}, "material": "a", "scale": 0.5}, {"type": "diffuse", "albedo": [0.8] * 3}
    textured = scene | {"materials": materials | {"a": white}, "objects": [floor, one]}
    four, materials = [], {"a": white}
    for (row, column), value in np.ndenumerate(values):
        place = [column / 2 - 0.25, 0.25 - row / 2, 0.3]
        materials[f"{row}{column}"] = BLACK | {"emission": [value] * 3}
        four.append({**one, "material": f"{row}{column}", "scale": 0.25, "translate": place})
    means = []
    for each in (textured, scene | {"materials": materials, "objects": [floor, *four]}):
        loaded = rt.load(each)
        films = np.array([rt.render(loaded, seed=seed).rgb[..., 0] for seed in range(8)], np.float64)
        means.append(films.reshape(8, 2, 8, 2, 8).mean(axis=(2, 4)))
    first, second = means
    spread = np.sqrt((first.var(axis=0, ddof=1) + second.var(axis=0, ddof=1)) / 8)
    assert (abs(first.mean(axis=0) - second.mean(axis=0)) <= 4.5 * spread).all()
    assert (spread < 0.02 * second.mean(axis=0)).all()
    assert (second.mean(axis=0).argsort(axis=None) == values.argsort(axis=None)).all()


# Scenes ---------------------------------------------------------------------------------------------------------------


def test_the_plan_names_what_runs_and_what_is_left_out(folder):
    plan = rt.explain(twins.head_on(SIZE, {"type": "diffuse", "albedo": {"image": "noise.png"}}, integrator="direct"))
    assert plan.paths
    assert dict(plan.passes)["texture"] == "the reflectance there, of 1 image; 24 texels"
    assert {"textures of lamps", "vertex colours"} <= dict(plan.left_out).keys()
    plan = rt.explain(twins.head_on(SIZE, BLACK | {"emission": {"checkerboard": [[1, 1, 1], [0, 0, 0]]}}))
    assert "texture" not in dict(plan.passes)
    assert {"texture pass", "vertex colours"} <= dict(plan.left_out).keys()
    assert "textures" in dict(rt.explain(twins.head_on(SIZE, BLACK, integrator="path")).left_out)


def test_a_texture_that_no_object_has_is_not_read(folder):
    scene = twins.head_on(SIZE, BLACK, integrator="direct")
    scene["materials"]["b"] = {"type": "diffuse", "albedo": {"image": "noise.png"}}
    assert rt.load(scene).textures is None
    assert not rt.explain(scene).paths
    scene["materials"]["b"]["albedo"]["image"] = "nowhere.png"
    with pytest.raises(rt.FileError, match=r"nowhere\.png: no such file"):
        rt.load(scene)


def test_a_lamp_of_a_black_texture_is_none(folder):
    scene = rt.load(twins.head_on(SIZE, BLACK | {"emission": {"checkerboard": [[0, 0, 0]] * 2}}))
    assert scene.materials.emission is None
    assert not rt.render(scene, size=(4, 4)).rgb.any()


def test_the_hash_covers_what_is_looked_up(folder):
    def hash_of(albedo):
        return rt.load(twins.head_on(SIZE, {"type": "diffuse", "albedo": albedo})).sha256

    given = [
        {"image": "noise.png"},
        {"image": "noise.png", "filter": "nearest"},
        {"image": "noise.png", "scale": [1, 2]},
        {"image": "noise.png", "encoding": "linear"},
        {"checkerboard": [[0.5] * 3, [0.25] * 3]},
        {"checkerboard": [[0.25] * 3, [0.5] * 3]},
    ]
    hashes = [hash_of(each) for each in given]
    assert len(set(hashes)) == len(given)
    assert hash_of(given[0]) == hashes[0]
    codes = CODES.copy()
    codes[[0, 1], 0, 0] = codes[[1, 0], 0, 0]  # the mean stays
    twins.save_png(folder / "noise.png", codes)
    assert hash_of(given[0]) != hashes[0]


def test_the_textbook_refuses_textures(folder):
    for integrator in ("direct", "path"):
        scene = twins.head_on((4, 4), {"type": "diffuse", "albedo": {"image": "noise.png"}}, integrator=integrator)
        with pytest.raises(rt.OptionError, match="does not have textures"):
            textbook(scene)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_the_drawing_of_a_path_is_that_of_the_sample(folder, integrator):
    """A lamp whose emission is a texture, and a wall whose albedo is one."""
    image = {"image": "noise.png"}
    scene = twins.head_on((4, 4), {"type": "diffuse", "albedo": image, "emission": image}, integrator=integrator)
    rgb = rt.render(scene, spp=1).rgb
    for x, y in ((1, 1), (3, 2)):
        steps = rt.show.path(scene, (x, y)).steps
        np.testing.assert_array_equal(np.float32(steps.radiance), rgb[y, x])
        assert steps.path[0].weight == pytest.approx(1, rel=1e-6)  # the camera's ray finds the lamp by itself


def test_an_image_is_stored_once(folder):
    from raytrace.rendering.compiled_scene import trees_of
    from raytrace.rendering.texture_table import make_texture_table, texture_bytes

    scene = twins.head_on(
        SIZE, {"type": "diffuse", "albedo": {"image": "noise.png"}, "emission": {"image": "noise.png"}}
    )
    loaded = rt.load(scene)
    table = make_texture_table(loaded, np.dtype(np.float32))
    assert len(table.texels) == CODES.size
    assert texture_bytes(loaded, 4) == table.texels.nbytes + table.uv.nbytes
    assert trees_of(loaded, rt.explain(loaded), "float32", paths=True).textures == texture_bytes(loaded, 4)
