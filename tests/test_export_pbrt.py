"""The export to pbrt: its file is parsed by pbrt's grammar, and compared with the scene value by value."""

import numpy as np
import pytest

import raytrace as rt
from export_scenes import (
    CHECKS,
    EVEN,
    IMAGE,
    LAMP,
    LENS,
    PARALLEL,
    PIXELS,
    POINT,
    SKY_LIGHT,
    SPOT,
    SUN,
    WHITE,
    directions,
    looked_up,
    made,
)
from pbrt_grammar import parse
from raytrace.exporting.equal_area import square_to_sphere
from raytrace.exporting.export import export_files
from raytrace.exporting.images import equal_area_square
from raytrace.image.files import load as load_image
from raytrace.image.files import srgb_decode
from raytrace.textbook import pinhole_rays, pixel_centres

SHOWN = WHITE | {"two_sided": True}  # pbrt's diffuse reflects on both sides


class Pbrt:
    """A scene of pbrt, parsed."""

    def __init__(self, scene, approximate=False):
        self.exported = export_files(scene, "pbrt", approximate)
        self.all = parse(self.exported.files[self.exported.scene].decode())
        assert not (self.exported.warnings and not approximate)
        names = {each.value("filename") for each in self.all if "filename" in each.parameters and each.name != "Film"}
        assert sorted({*names, self.exported.scene}) == sorted(self.exported.files)

    def of(self, name, word=None):
        (found,) = (each for each in self.all if each.name == name and word in (None, *each.words))
        return found

    def material(self, name):
        return self.of("MakeNamedMaterial", name)


def test_render_settings(tmp_path):
    pbrt = Pbrt(made(tmp_path, {"white": SHOWN}))
    assert pbrt.of("Integrator", "path").value("maxdepth") == 7
    assert pbrt.of("Sampler").value("pixelsamples") == 9
    film = pbrt.of("Film", "rgb")
    assert (film.value("xresolution"), film.value("yresolution"), film.value("savefp16")) == (12, 8, False)
    assert film.value("filename") == "small.exr"
    assert pbrt.of("PixelFilter", "box").value("xradius") == 0.5
    assert pbrt.of("Option", "disabletexturefiltering").words[1] == "true"


def test_direct_light_is_a_path_of_one_surface(tmp_path):
    pbrt = Pbrt(made(tmp_path, {"white": SHOWN}, render={"integrator": "direct", "max_depth": 7}))
    assert pbrt.of("Integrator").value("maxdepth") == 1


def camera_space(pbrt):
    """Rows of the matrix from world directions to pbrt's camera space: x to the right, y up, z ahead, left-handed."""
    scale, look = (pbrt.of(name).numbers for name in ("Scale", "LookAt"))
    eye, at, up = np.array(look).reshape(3, 3)
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(up, ahead)
    right /= np.linalg.norm(right)
    return np.diag(scale) @ np.array([right, np.cross(ahead, right), ahead]), eye


def test_pinhole_has_our_rays(tmp_path):
    """Film position (x, y) of 0 to 1, y down, is a point of the screen window at distance 1 / tan(fov / 2)."""
    scene = made(tmp_path, {"white": SHOWN})
    pbrt = Pbrt(scene)
    camera, (matrix, eye) = pbrt.of("Camera", "perspective"), camera_space(pbrt)
    left, right, bottom, top = camera.values("screenwindow")
    centres = pixel_centres((12, 8)).reshape(-1, 2)
    x = left + (right - left) * centres[:, 0] / 12
    y = top + (bottom - top) * centres[:, 1] / 8
    ahead = np.full(len(x), 1 / np.tan(np.radians(camera.value("fov")) / 2))
    theirs = np.stack([x, y, ahead], axis=1) @ matrix  # the rows are orthonormal: the transpose is the inverse
    theirs /= np.linalg.norm(theirs, axis=1, keepdims=True)
    origins, ours = pinhole_rays(scene.camera, (12, 8), centres)
    np.testing.assert_allclose(theirs, ours, atol=1e-14)
    np.testing.assert_array_equal(origins, np.broadcast_to(eye, origins.shape))


def test_thin_lens(tmp_path):
    camera = Pbrt(made(tmp_path, {"white": SHOWN}, camera=LENS)).of("Camera", "perspective")
    assert (camera.value("lensradius"), camera.value("focaldistance")) == (0.05, 4.5)


def test_orthographic_camera(tmp_path):
    camera = Pbrt(made(tmp_path, {"white": SHOWN}, camera=PARALLEL)).of("Camera", "orthographic")
    assert camera.values("screenwindow") == [-2.25, 2.25, -1.5, 1.5]


def test_filters(tmp_path):
    for name, kind, radius in (("tent", "triangle", 1), ("gaussian", "gaussian", 2)):
        pbrt = Pbrt(made(tmp_path, {"white": SHOWN}, film={"size": [12, 8], "filter": name}))
        assert pbrt.of("PixelFilter", kind).value("yradius") == radius
    assert pbrt.of("PixelFilter").value("sigma") == 0.5


def test_lights(tmp_path):
    hard = SPOT | {"beam": 40}
    pbrt = Pbrt(made(tmp_path, {"white": SHOWN}, lights=[POINT, hard, SUN, EVEN]))
    point, spot, sun = (pbrt.of("LightSource", kind) for kind in ("point", "spot", "distant"))
    np.testing.assert_allclose(point.values("I"), np.array([40, 30, 20]) / (4 * np.pi), rtol=1e-15)
    assert point.values("from") == [1, 4, 2]
    assert spot.values("I") == [9, 8, 7]
    assert (spot.value("coneangle"), spot.value("conedeltaangle")) == (pytest.approx(40), 0)
    axis = np.subtract(spot.values("to"), spot.values("from"))
    np.testing.assert_allclose(axis, np.array([1, -3, -1]) / np.sqrt(11), atol=1e-15)
    way = np.subtract(sun.values("to"), sun.values("from"))
    np.testing.assert_allclose(way, np.array([1, -3, 2]) / np.sqrt(14), rtol=1e-15)
    assert sun.values("L") == [1.5, 1.25, 1]
    assert pbrt.of("LightSource", "infinite").values("L") == [0.5, 0.75, 1]


def test_a_spot_that_fades_is_approximated(tmp_path):
    scene = made(tmp_path, {"white": SHOWN}, lights=[SPOT])
    with pytest.raises(rt.SceneError, match=r"lights\.spot: pbrt has no spot that fades linearly"):
        export_files(scene, "pbrt")
    spot = Pbrt(scene, approximate=True).of("LightSource", "spot")
    assert [spot.value("coneangle"), spot.value("conedeltaangle")] == pytest.approx([40, 15])


def sphere_to_square(d):
    """Inverse of the equal-area mapping, by its definition: r^2 = 1 - abs(z), the azimuth in the first quadrant."""
    x, y, z = np.abs(d).T
    r, turn = np.sqrt(1 - z), np.arctan2(y, x) * 2 / np.pi
    u, v = r * (1 - turn), r * turn
    u, v = np.where(d[:, 2] < 0, 1 - v, u), np.where(d[:, 2] < 0, 1 - u, v)
    return (np.copysign(u, d[:, 0]) + 1) / 2, (np.copysign(v, d[:, 1]) + 1) / 2


def test_the_square_covers_the_sphere_evenly():
    d = directions(200)
    x, y = sphere_to_square(d)
    np.testing.assert_allclose(square_to_sphere(x, y), d, atol=1e-12)
    grid = (np.arange(64) + 0.5) / 64
    z = square_to_sphere(*(a.ravel() for a in np.meshgrid(grid, grid)))[:, 2]
    assert abs(z.mean()) < 1e-12
    np.testing.assert_allclose(np.mean(z**2), 1 / 3, atol=1e-3)


def test_environment_has_the_same_radiance(tmp_path):
    """pbrt looks up the nearest texel; the square has several texels per texel of ours, so the errors are small."""
    scene = made(tmp_path, {"white": SHOWN}, lights=[SKY_LIGHT])
    pbrt = Pbrt(scene)
    small = equal_area_square(scene.lights.image, 32)
    path = tmp_path / "environment.exr"
    path.write_bytes(pbrt.exported.files[pbrt.of("LightSource", "infinite").value("filename")])
    assert load_image(path).rgb.shape == (512, 512, 3)
    d = directions(300)
    x, y = sphere_to_square(d)
    for square, most in ((small, 0.05), (load_image(path).rgb, 0.005)):
        side = len(square)
        found = square[(y * side).astype(int), (x * side).astype(int)]
        assert np.sqrt(np.mean((found - looked_up(d)) ** 2)) < most
    np.testing.assert_allclose(load_image(path).rgb.mean(axis=(0, 1)), small.mean(axis=(0, 1)), rtol=5e-3)


def test_materials(tmp_path):
    metal = {"type": "conductor", "eta": [0.2, 0.4, 1.5], "k": [3, 2, 1]}
    materials = {
        "white": SHOWN,
        "glass": {"type": "dielectric", "ior": 1.5},
        "metal": metal,
        "half": {"type": "conductor", "reflectance": [0.5, 1, 0]},
        "mirror": {"type": "mirror", "reflectance": [1, 1, 1]},
    }
    pbrt = Pbrt(made(tmp_path, materials))
    assert pbrt.material("white").values("reflectance") == [0.7, 0.6, 0.5]
    assert pbrt.material("glass").value("eta") == 1.5
    assert "roughness" not in pbrt.material("glass").parameters
    assert pbrt.material("metal").values("eta") == [0.2, 0.4, 1.5]
    assert pbrt.material("metal").values("k") == [3, 2, 1]
    assert max(pbrt.material("half").values("k")) == 1e4
    assert pbrt.material("mirror").parameters["reflectance"] == ("rgb", [1, 1, 1])
    kinds = [each.value("type") for each in pbrt.all if each.name == "MakeNamedMaterial"]
    assert kinds == ["diffuse", "dielectric", "conductor", "conductor", "conductor"]


def test_what_pbrt_has_otherwise_is_named(tmp_path):
    materials = {
        "brushed": {"type": "conductor", "metal": "gold", "alpha": 0.125},
        "frosted": {"type": "dielectric", "ior": 1.5, "alpha": 0.25},
        "glaze": {"type": "plastic", "albedo": [0.1, 0.3, 0.6], "ior": 1.4, "two_sided": True},
        "silver": {"type": "mirror", "reflectance": [0.9, 0.8, 0.7]},
        "course": {"type": "refractive", "ior": 1.5},
    }
    scene = made(tmp_path, materials)
    with pytest.raises(rt.SceneError) as caught:
        export_files(scene, "pbrt")
    found = sorted(line.split(": ")[1] for line in caught.value.problems)
    assert found == ["materials.brushed, materials.frosted", "materials.course", "materials.glaze", "materials.silver"]
    pbrt = Pbrt(scene, approximate=True)
    for name, alpha in (("brushed", 0.125), ("frosted", 0.25)):
        assert (pbrt.material(name).value("roughness"), pbrt.material(name).value("remaproughness")) == (alpha, False)
    assert pbrt.material("glaze").value("eta") == 1.4
    assert pbrt.material("silver").values("reflectance") == [0.9, 0.8, 0.7]
    assert len(pbrt.exported.warnings) == 4


def test_textures(tmp_path):
    materials = {"checks": SHOWN | {"albedo": CHECKS}, "wood": SHOWN | {"albedo": IMAGE}}
    pbrt = Pbrt(made(tmp_path, materials))
    checks, wood = pbrt.of("Texture", "checkerboard"), pbrt.of("Texture", "imagemap")
    assert (checks.values("tex1"), checks.values("tex2")) == ([0.9, 0.8, 0.7], [0.1, 0.2, 0.3])
    assert (checks.value("uscale"), checks.value("vscale")) == (4, 6)
    assert (wood.value("uscale"), wood.value("vscale")) == (2, 3)
    assert (wood.value("filter"), wood.value("wrap")) == ("bilinear", "repeat")
    assert pbrt.material("wood").parameters["reflectance"] == ("texture", [wood.words[0]])
    path = tmp_path / "copy.png"
    path.write_bytes(pbrt.exported.files[wood.value("filename")])
    np.testing.assert_allclose(load_image(path).rgb, srgb_decode(PIXELS / 255), atol=1e-6)  # t = 0 is the last row


def test_lamps(tmp_path):
    shining = SHOWN | {"emission": {"image": "wood.png"}}
    tiled = SHOWN | {"emission": IMAGE}
    scene = made(tmp_path, {"white": SHOWN, "lamp": LAMP, "shining": shining, "tiled": tiled})
    with pytest.raises(rt.SceneError, match=r"materials\.shining\.emission.*\n.*materials\.tiled\.emission"):
        export_files(scene, "pbrt")
    pbrt = Pbrt(scene, approximate=True)
    found = {}
    for each, after in zip(pbrt.all, pbrt.all[1:], strict=False):
        if each.name == "NamedMaterial":
            found[each.words[0]] = after.parameters if after.name == "AreaLightSource" else None
    assert found["white"] is None
    assert found["lamp"] == {"L": ("rgb", [3, 2, 1])}
    assert found["shining"].keys() == {"filename"}
    np.testing.assert_allclose(found["tiled"]["L"][1], srgb_decode(PIXELS / 255).mean(axis=(0, 1)), rtol=1e-6)


def test_vertex_colours_become_their_mean(tmp_path):
    tmp_path.joinpath("colours.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property float red\nproperty float green\nproperty float blue\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0 0 0 0\n1 0 0 0.5 0 0\n0 1 0 1 1 0\n3 0 1 2\n"
    )
    baked = {"baked": SHOWN | {"albedo": {"attribute": "color"}}}
    scene = made(tmp_path, baked, objects=[{"mesh": "colours.ply", "material": "baked"}])
    with pytest.raises(rt.SceneError, match=r"materials\.baked: pbrt has no vertex colours"):
        export_files(scene, "pbrt")
    values = Pbrt(scene, approximate=True).material("baked").values("reflectance")
    np.testing.assert_allclose(values, [0.5, 1 / 3, 0], rtol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        'WorldBegin Shape "plymesh" "string filename" [ "a" ',
        'WorldBegin LightSource "point" "rgb I" [ 1 1 ]',
        'WorldBegin LightSource "point" "rgb I" [ 1 1 nan ]',
        'WorldBegin LightSource "point" "rgb L" [ 1 1 1 ]',
        'WorldBegin Camera "perspective"',
        'Shape "plymesh" WorldBegin',
        'WorldBegin NamedMaterial "none"',
        "WorldBegin AttributeBegin",
        'Film "rgb" "bool savefp16" [ 0 ] WorldBegin',
        "Scale 1 2 WorldBegin",
        "Nonsense WorldBegin",
    ],
)
def test_the_parser_rejects_what_pbrt_rejects(text):
    with pytest.raises((AssertionError, IndexError)):
        parse(text)
