"""The export to Mitsuba: its XML is parsed, and compared with the scene value by value."""

from xml.etree import ElementTree as ET

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
    bilinear,
    directions,
    looked_up,
    made,
)
from raytrace.exporting.export import export_files
from raytrace.image.files import load as load_image
from raytrace.image.files import srgb_decode


class Xml:
    """A scene of Mitsuba, parsed."""

    def __init__(self, scene, approximate=False):
        self.exported = export_files(scene, "mitsuba", approximate)
        self.root = ET.fromstring(self.exported.files[self.exported.scene])
        names = [each.get("value") for each in self.root.iter("string") if each.get("name") == "filename"]
        assert sorted({*names, self.exported.scene}) == sorted(self.exported.files)
        ids = {each.get("id") for each in self.root.findall("bsdf")}
        assert {each.get("id") for each in self.root.iter("ref")} == ids

    def of(self, tag, kind=None):
        (found,) = (each for each in self.root.iter(tag) if kind in (None, each.get("type")))
        return found

    def bsdf(self, name):
        (found,) = (each for each in self.root.findall("bsdf") if each.get("id") == f"material-{name}")
        return found


def value(element, name):
    """The parameter of a plugin: a text, a boolean, a number or a tuple."""
    (found,) = (each for each in element if each.get("name") == name)
    text = found.get("value")
    if found.tag in ("string", "boolean"):
        return text
    numbers = tuple(float(word) for word in text.split(","))
    return numbers if found.tag in ("rgb", "vector") else numbers[0]


def step(element, name="to_world"):
    """The steps of a transform, as tags with numbers."""
    (found,) = (each for each in element.findall("transform") if each.get("name") == name)
    return [(each.tag, {k: [float(x) for x in v.split(",")] for k, v in each.attrib.items()}) for each in found]


def test_render_settings(tmp_path):
    xml = Xml(made(tmp_path, {"white": WHITE}))
    assert value(xml.of("integrator", "path"), "max_depth") == 7 + 1
    assert value(xml.of("integrator"), "rr_depth") > 1000
    assert value(xml.of("sampler", "independent"), "sample_count") == 9
    film = xml.of("film", "hdrfilm")
    assert (value(film, "width"), value(film, "height")) == (12, 8)
    assert value(film, "component_format") == "float32"
    assert xml.of("rfilter").get("type") == "box"


def test_direct_light_is_a_path_of_one_surface(tmp_path):
    xml = Xml(made(tmp_path, {"white": WHITE}, render={"integrator": "direct", "max_depth": 7}))
    assert value(xml.of("integrator"), "max_depth") == 2


def test_pinhole(tmp_path):
    sensor = Xml(made(tmp_path, {"white": WHITE})).of("sensor", "perspective")
    assert value(sensor, "fov") == 35
    assert value(sensor, "fov_axis") == "y"
    assert step(sensor) == [("lookat", {"origin": [1, 2, 6], "target": [0.25, 0.5, -1], "up": [0.1, 1, 0]})]
    assert value(sensor, "near_clip") < 1e-3
    assert value(sensor, "far_clip") > 1e3


def test_thin_lens(tmp_path):
    sensor = Xml(made(tmp_path, {"white": WHITE}, camera=LENS)).of("sensor", "thinlens")
    assert (value(sensor, "aperture_radius"), value(sensor, "focus_distance")) == (0.05, 4.5)


def test_orthographic_camera(tmp_path):
    """The view is 2 units wide before it is scaled: half the height, times the aspect ratio."""
    sensor = Xml(made(tmp_path, {"white": WHITE}, camera=PARALLEL)).of("sensor", "orthographic")
    assert [tag for tag, _ in step(sensor)] == ["scale", "lookat"]
    assert step(sensor)[0][1] == {"x": [2.25], "y": [2.25], "z": [1]}


@pytest.mark.parametrize(("name", "width"), [("tent", ("radius", 1)), ("gaussian", ("stddev", 0.5))])
def test_filters(tmp_path, name, width):
    xml = Xml(made(tmp_path, {"white": WHITE}, film={"size": [12, 8], "filter": name}))
    assert value(xml.of("rfilter", name), width[0]) == width[1]
    assert value(xml.of("film"), "sample_border") == "true"


def test_lights(tmp_path):
    xml = Xml(made(tmp_path, {"white": WHITE}, lights=[POINT, SPOT, SUN, EVEN]))
    point, spot = xml.of("emitter", "point"), xml.of("emitter", "spot")
    np.testing.assert_allclose(value(point, "intensity"), np.array([40, 30, 20]) / (4 * np.pi), rtol=1e-15)
    assert xml.of("point").attrib == {"name": "position", "x": "1.0", "y": "4.0", "z": "2.0"}
    assert value(spot, "intensity") == (9, 8, 7)
    np.testing.assert_allclose([value(spot, "cutoff_angle"), value(spot, "beam_width")], [40, 25], rtol=1e-14)
    (look,) = (numbers for tag, numbers in step(spot) if tag == "lookat")
    axis = np.subtract(look["target"], look["origin"])
    np.testing.assert_allclose(axis, np.array([1, -3, -1]) / np.sqrt(11), atol=1e-15)
    sun = xml.of("emitter", "directional")
    np.testing.assert_allclose(value(sun, "direction"), np.array([1, -3, 2]) / np.sqrt(14), rtol=1e-15)
    assert value(sun, "irradiance") == (1.5, 1.25, 1)
    assert value(xml.of("emitter", "constant"), "radiance") == (0.5, 0.75, 1)


def test_environment_has_the_same_radiance_everywhere(tmp_path):
    """Mitsuba has row j at v = j / (h - 1), columns as we do, and turns directions back by ``to_world``."""
    xml = Xml(made(tmp_path, {"white": WHITE}, lights=[SKY_LIGHT]))
    light = xml.of("emitter", "envmap")
    path = tmp_path / "environment.exr"
    path.write_bytes(xml.exported.files[value(light, "filename")])
    texels = load_image(path).rgb
    ((_, numbers),) = step(light)
    d = directions(300)
    local = d @ np.reshape(numbers["value"], (4, 4))[:3, :3]
    x = (np.arctan2(local[:, 0], -local[:, 2]) / (2 * np.pi) % 1) * texels.shape[1] - 0.5
    y = np.arccos(local[:, 1]) / np.pi * (len(texels) - 1)
    np.testing.assert_allclose(bilinear(texels, x, y), looked_up(d), rtol=1e-5)


def test_diffuse_and_plastic(tmp_path):
    plastic = {"type": "plastic", "albedo": [0.1, 0.3, 0.6], "ior": 1.4}
    xml = Xml(made(tmp_path, {"white": WHITE, "both": WHITE | {"two_sided": True}, "glaze": plastic}))
    assert xml.bsdf("white").get("type") == "diffuse"
    assert value(xml.bsdf("white"), "reflectance") == (0.7, 0.6, 0.5)
    assert xml.bsdf("both").get("type") == "twosided"
    assert value(xml.bsdf("both").find("bsdf"), "reflectance") == (0.7, 0.6, 0.5)
    glaze = xml.bsdf("glaze")
    assert (glaze.get("type"), value(glaze, "nonlinear"), value(glaze, "int_ior")) == ("plastic", "true", 1.4)
    assert value(glaze, "ext_ior") == 1
    assert value(glaze, "diffuse_reflectance") == (0.1, 0.3, 0.6)


def test_smooth_and_rough_specular_surfaces(tmp_path):
    glass, metal = {"type": "dielectric", "ior": 1.5}, {"type": "conductor", "eta": [0.2, 0.4, 1.5], "k": [3, 2, 1]}
    materials = {
        "glass": glass,
        "frosted": glass | {"alpha": 0.25},
        "metal": metal,
        "brushed": metal | {"alpha": 0.125},
        "mirror": {"type": "mirror", "reflectance": [0.9, 0.8, 0.7]},
        "half": {"type": "conductor", "reflectance": [0.5, 1, 0]},
    }
    xml = Xml(made(tmp_path, materials))
    assert (xml.bsdf("glass").get("type"), value(xml.bsdf("glass"), "int_ior")) == ("dielectric", 1.5)
    frosted = xml.bsdf("frosted")
    assert frosted.get("type") == "roughdielectric"
    assert (value(frosted, "alpha"), value(frosted, "distribution")) == (0.25, "ggx")
    for name, kind in (("metal", "conductor"), ("brushed", "roughconductor"), ("mirror", "conductor")):
        assert xml.bsdf(name).get("type") == "twosided"
        assert xml.bsdf(name).find("bsdf").get("type") == kind
    metal = xml.bsdf("brushed").find("bsdf")
    assert (value(metal, "eta"), value(metal, "k"), value(metal, "alpha")) == ((0.2, 0.4, 1.5), (3, 2, 1), 0.125)
    mirror = xml.bsdf("mirror").find("bsdf")
    assert (value(mirror, "material"), value(mirror, "specular_reflectance")) == ("none", (0.9, 0.8, 0.7))
    half = xml.bsdf("half").find("bsdf")
    k = np.array(value(half, "k"))  # eta = 1: r = k^2 / (4 + k^2)
    np.testing.assert_allclose(k**2 / (4 + k**2), [0.5, 1, 0], atol=1e-7)
    assert value(half, "eta") == (1, 1, 1)


def test_lamps_emit_from_their_objects(tmp_path):
    xml = Xml(made(tmp_path, {"white": WHITE, "lamp": LAMP}))
    (lamp,) = (shape for shape in xml.root.findall("shape") if shape.find("emitter") is not None)
    assert lamp.find("ref").get("id") == "material-lamp"
    assert value(lamp.find("emitter"), "radiance") == (3, 2, 1)


def test_textures(tmp_path):
    materials = {"checks": WHITE | {"albedo": CHECKS}, "wood": WHITE | {"albedo": IMAGE}}
    xml = Xml(made(tmp_path, materials))
    checks, wood = xml.of("texture", "checkerboard"), xml.of("texture", "bitmap")
    assert (value(checks, "color0"), value(checks, "color1")) == ((0.9, 0.8, 0.7), (0.1, 0.2, 0.3))
    assert step(checks, "to_uv") == [("scale", {"x": [2], "y": [3]})]  # squares of side 1/2
    assert step(wood, "to_uv") == [("scale", {"x": [2], "y": [-3]})]  # v = 0 is the first row there
    assert (value(wood, "filter_type"), value(wood, "raw")) == ("bilinear", "false")
    path = tmp_path / "copy.png"
    path.write_bytes(xml.exported.files[value(wood, "filename")])
    np.testing.assert_allclose(load_image(path).rgb, srgb_decode(PIXELS / 255), atol=1e-6)  # upright


def test_linear_and_nearest_images(tmp_path):
    albedo = {"image": "wood.png", "encoding": "linear", "filter": "nearest"}
    xml = Xml(made(tmp_path, {"wood": WHITE | {"albedo": albedo}}))
    wood = xml.of("texture", "bitmap")
    assert (value(wood, "filter_type"), value(wood, "raw")) == ("nearest", "true")
    path = tmp_path / "copy.exr"
    path.write_bytes(xml.exported.files[value(wood, "filename")])
    np.testing.assert_allclose(load_image(path).rgb, PIXELS / 255, atol=1e-7)


def test_smooth_meshes_keep_their_normals(tmp_path):
    ball = {"sphere": {"center": [0, 0, 0], "radius": 1, "tolerance": 0.02}, "material": "white"}
    xml = Xml(made(tmp_path, {"white": WHITE}, objects=[ball, ball | {"normals": "smooth"}]))
    assert [value(shape, "face_normals") for shape in xml.root.findall("shape")] == ["true", "false"]


def checks_of(xml, folder, name):
    """The two colours of a checkerboard that is an image: bottom left and bottom right texel."""
    bitmap = xml.of("texture", "bitmap")
    assert (bitmap.get("name"), value(bitmap, "filter_type"), value(bitmap, "raw")) == (name, "nearest", "true")
    assert step(bitmap, "to_uv") == [("scale", {"x": [2], "y": [-3]})]
    (folder / "checks.exr").write_bytes(xml.exported.files[value(bitmap, "filename")])
    texels = load_image(folder / "checks.exr").rgb
    np.testing.assert_array_equal(texels[0], texels[1][::-1])
    return texels[1]


def test_lamp_with_a_checkerboard(tmp_path):
    """The colours of Mitsuba's checkerboards are at most 1."""
    bright = CHECKS | {"checkerboard": [[9, 8, 7], [1, 2, 3]]}
    xml = Xml(made(tmp_path, {"lamp": LAMP | {"emission": bright}}))
    np.testing.assert_array_equal(checks_of(xml, tmp_path, "radiance"), bright["checkerboard"])


def test_metal_with_a_textured_reflectance(tmp_path):
    exact = {"type": "conductor", "reflectance": CHECKS}
    xml = Xml(made(tmp_path, {"metal": exact}))
    k = checks_of(xml, tmp_path, "k")
    np.testing.assert_allclose(k**2 / (4 + k**2), CHECKS["checkerboard"], rtol=1e-6)
    scene = made(tmp_path, {"metal": {"type": "conductor", "reflectance": IMAGE}})
    with pytest.raises(rt.SceneError, match=r"materials\.metal\.reflectance: Mitsuba has no conductor .* image"):
        export_files(scene, "mitsuba")
    assert Xml(scene, approximate=True).of("texture", "bitmap").get("name") == "k"


def test_what_mitsuba_cannot_express_is_named(tmp_path):
    glass = {"type": "refractive", "ior": 1.5, "shadows": "transparent"}
    scene = made(tmp_path, {"glass": glass, "white": WHITE}, background=[0.1, 0, 0], render={"integrator": "direct"})
    with pytest.raises(rt.SceneError) as caught:
        export_files(scene, "mitsuba")
    found = [line.split(": ")[1] for line in caught.value.problems]
    assert found == ["render.integrator", "background", "materials.glass", "materials.glass"]
    assert all(line.startswith(str(tmp_path)) and "--approximate" in line for line in caught.value.problems)
    xml = Xml(scene, approximate=True)
    assert len(xml.exported.warnings) == 4
    assert xml.bsdf("glass").get("type") == "dielectric"
    assert value(xml.of("integrator"), "max_depth") == scene.settings.max_depth + 1
