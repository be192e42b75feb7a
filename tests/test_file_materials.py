"""Materials of glTF files: objects with ``"material": {"from": "file"}``."""

import io
import json
import math

import numpy as np
import pytest
import trimesh
from PIL import Image

import raytrace as rt
from gltf_files import CORNERS, SQUARE, File
from raytrace.image.texels import srgb_table
from raytrace.records import DIFFUSE
from raytrace.rendering.albedo_layer import albedo_at
from raytrace.texture_records import ATTRIBUTE, BILINEAR, NEAREST
from scene_files import scene, write

pytestmark = pytest.mark.nojit

PIXELS = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3) * 14
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")  # v downwards, as in the file: the image stands upright
FROM_FILE = {"from": "file"}


def png(pixels=PIXELS):
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def file_with(*materials, **attributes):
    """The unit square, once for each material."""
    file = File()
    file.json["materials"] = list(materials)
    for name, array in attributes.items():
        file.attributes[name] = file.add(array)
    file.mesh["primitives"] = [{**file.primitive, "material": k} for k in range(len(materials))] or [file.primitive]
    return file


def add_image(file, data=None, **texture):
    """Add an image as texture 0 of the file."""
    file.json |= {"textures": [{"source": 0, **texture}]}
    file.json["images"] = [{"bufferView": file.view(np.frombuffer(data or png(), np.uint8)), "mimeType": "image/png"}]
    return file


def load(folder, file, *more, **changes):
    (folder / "a.glb").write_bytes(file if isinstance(file, bytes) else file.glb())
    objects = [{"mesh": "a.glb", "material": FROM_FILE, **changes}, *more]
    return rt.load(write(folder, scene(objects=objects, materials={"white": {"type": "diffuse", "albedo": [1, 1, 1]}})))


def problem(folder, file, *more, **changes):
    with pytest.raises((rt.SceneError, rt.FileError)) as caught:
        load(folder, file, *more, **changes)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def pbr(**keys):
    return {"pbrMetallicRoughness": keys}


# Factors --------------------------------------------------------------------------------------------------------------


def test_factors_become_diffuse_materials_and_conductors(tmp_path):
    red = {"name": "Red", **pbr(baseColorFactor=[1, 0.25, 0, 1], metallicFactor=0)}
    half = {**pbr(baseColorFactor=[0.5, 0.5, 0.5, 1], metallicFactor=0.49, roughnessFactor=0), "doubleSided": True}
    gold = {"name": "Gold", **pbr(baseColorFactor=[1, 0.8, 0.4, 1], metallicFactor=0.5, roughnessFactor=0.5)}
    made = load(tmp_path, file_with(red, half, gold, pbr()), {"mesh": "triangle.obj", "material": "white"})
    materials = made.materials
    assert materials.name == ("white", "a.glb: Red", "a.glb: materials[1]", "a.glb: Gold", "a.glb: materials[3]")
    assert (materials.kind != DIFFUSE).tolist() == [False, False, False, True, True]  # conductors, smooth or rough
    assert materials.two_sided.tolist() == [False, False, True, False, False]
    colours = [[1, 1, 1], [1, 0.25, 0], [0.5, 0.5, 0.5], [1, 0.8, 0.4], [1, 1, 1]]
    np.testing.assert_allclose(materials.albedo, colours, rtol=1e-12)
    assert made.mesh.material_id.tolist() == [1, 1, 2, 2, 3, 3, 4, 4, 0]
    assert made.mesh.uv is made.mesh.colors is made.textures is None
    by_hand = {"type": "conductor", "reflectance": [1, 0.8, 0.4]}
    same = rt.load(
        write(tmp_path, scene(materials={"gold": by_hand}, objects=[{"mesh": "cube.obj", "material": "gold"}]))
    )
    np.testing.assert_array_equal(materials.k[3], same.materials.k[0])
    assert materials.alpha.tolist()[3:] == [0.25, 1.0]


def test_a_part_without_a_material_is_light_grey_on_both_sides(tmp_path):
    made = load(tmp_path, file_with())
    assert made.materials.albedo[1].tolist() == [0.7, 0.7, 0.7]
    assert made.materials.two_sided[1]
    assert made.mesh.material_id.tolist() == [1, 1]


def test_nodes_that_place_a_mesh_twice_share_its_material_and_objects_share_those_of_a_file(tmp_path):
    file = file_with(pbr(metallicFactor=0))
    file.json["nodes"].append({"mesh": 0, "translation": [0, 0, 1]})
    file.json["scenes"][0]["nodes"] = [0, 1]
    again = {"mesh": "a.glb", "material": FROM_FILE, "translate": [0, 0, 2]}
    made = load(tmp_path, file, again, {"mesh": "a.glb", "material": "white"})
    assert made.mesh.material_id.tolist() == [1] * 8 + [0] * 4
    assert len(made.materials.name) == 2


def test_vertex_colours_times_the_factor(tmp_path):
    colours = np.array([[1, 0.5, 0.25], [0, 1, 0], [0.5, 0.5, 0.5], [1, 1, 1]], "<f4")
    metal, matt = pbr(baseColorFactor=[0.5, 1, 0.5, 1]), pbr(baseColorFactor=[1, 0.5, 0, 1], metallicFactor=0)
    made = load(tmp_path, file_with(metal, matt, COLOR_0=colours), scale=[-1, 1, 1])
    expected = colours[CORNERS.reshape(-1, 3)[:, [0, 2, 1]]]
    np.testing.assert_array_equal(made.mesh.colors, np.concatenate([expected * [0.5, 1, 0.5], expected * [1, 0.5, 0]]))
    assert made.textures.reflectance.tolist() == [-1, 0, 1]
    assert [texture.kind for texture in made.textures.table] == [ATTRIBUTE, ATTRIBUTE]
    assert (made.materials.kind != DIFFUSE).tolist() == [False, True, False]
    grey = load(tmp_path, file_with(COLOR_0=colours))
    np.testing.assert_array_equal(grey.mesh.colors, colours[CORNERS.reshape(-1, 3)])
    text = problem(tmp_path, file_with(matt, COLOR_0=colours * 3))
    assert "objects[0].material: vertex colours: 6 of 6 corners of triangles are outside 0 to 1" in text


def test_vertex_colours_that_are_all_equal_are_a_factor(tmp_path):
    colours = np.full((4, 4), 0.5, "<f4") * np.array([1, 0.5, 2, 1], "<f4")
    material = pbr(baseColorFactor=[0.5, 1, 0.5, 1], metallicFactor=0)
    made = load(tmp_path, file_with(material, COLOR_0=colours))
    assert made.mesh.colors is made.textures is None
    assert made.materials.albedo[1].tolist() == [0.25, 0.25, 0.5]
    assert load(tmp_path, file_with(COLOR_0=colours)).materials.albedo[1].tolist() == [0.5, 0.25, 1]
    assert load(tmp_path, file_with(COLOR_0=np.ones((4, 3), "<f4"))).materials.albedo[1].tolist() == [1, 1, 1]
    image = pbr(baseColorTexture={"index": 0}, metallicFactor=0)
    made = load(tmp_path, add_image(file_with(image, TEXCOORD_0=UV, COLOR_0=colours)))
    np.testing.assert_allclose(made.textures.table[0].codes[::-1], srgb_table(8)[PIXELS] * [0.5, 0.25, 1], rtol=1e-6)
    assert made.warnings == load(tmp_path, add_image(file_with(image, TEXCOORD_0=UV))).warnings


# Textures -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [[1, 1, 1, 1], [0.5, 1, 0.25, 1]])
@pytest.mark.parametrize("metallic", [0, 1])
def test_an_image_in_the_file_is_the_texture_and_stands_upright(tmp_path, factor, metallic):
    material = pbr(baseColorTexture={"index": 0}, baseColorFactor=factor, metallicFactor=metallic)
    made = load(tmp_path, add_image(file_with(material, TEXCOORD_0=UV)))
    (texture,) = made.textures.table
    assert texture.kind == BILINEAR
    linear = texture.codes if texture.table is None else texture.table[texture.codes]
    np.testing.assert_allclose(linear[::-1], srgb_table(8)[PIXELS] * factor[:3], rtol=1e-6)
    assert (made.materials.kind != DIFFUSE).tolist() == [False, metallic == 1]
    np.testing.assert_array_equal(made.mesh.uv, SQUARE[:, :2][CORNERS.reshape(-1, 3)])  # v = y: 0 at the bottom


def test_a_file_of_trimesh_shows_its_image_as_trimesh_has_it(tmp_path):
    """trimesh has v = 0 at the bottom, and turns it when it writes a file."""
    square = trimesh.Trimesh(SQUARE.astype(float), CORNERS.reshape(-1, 3), process=False)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(PIXELS), metallicFactor=0.0)
    square.visual = trimesh.visual.TextureVisuals(uv=SQUARE[:, :2], material=material)
    made = load(tmp_path, square.export(file_type="glb"))
    np.testing.assert_allclose(made.mesh.uv, made.mesh.vertices[made.mesh.faces][:, :, :2], atol=1e-7)
    x, y = np.meshgrid((np.arange(3) + 0.5) / 3, (np.arange(2) + 0.5) / 2)  # centres of texels, from the lower left on
    x, y = x.ravel(), y.ravel()
    lower = y <= x  # triangle 0 has the corners (0, 0), (1, 0), (1, 1); triangle 1 (0, 0), (1, 1), (0, 1)
    u, v = np.where(lower, x - y, x), np.where(lower, y, y - x)
    albedo = albedo_at(made, np.where(lower, 0, 1), u, v)
    np.testing.assert_allclose(albedo.reshape(2, 3, 3)[::-1], srgb_table(8)[PIXELS], atol=1e-6)


def test_the_second_set_of_uv_with_a_transform(tmp_path):
    angle, (su, sv), (ou, ov) = 0.3, (2, 0.5), (0.25, 0.125)
    transform = {"offset": [ou, ov], "rotation": angle, "scale": [su, sv], "texCoord": 1}
    info = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": transform}}
    file = add_image(file_with(pbr(baseColorTexture=info), TEXCOORD_0=UV * 0, TEXCOORD_1=UV))
    made = load(tmp_path, file)
    u, v = (UV * [su, sv]).T  # [KHR_texture_transform]: counter-clockwise, v downwards
    turned = math.cos(angle) * u + math.sin(angle) * v + ou, math.cos(angle) * v - math.sin(angle) * u + ov
    expected = np.stack([turned[0], 1 - turned[1]], axis=1)[CORNERS.reshape(-1, 3)]
    np.testing.assert_allclose(made.mesh.uv, expected, rtol=1e-14)


def test_samplers_without_interpolation(tmp_path):
    file = add_image(file_with(pbr(baseColorTexture={"index": 0}), TEXCOORD_0=UV), sampler=0)
    file.json["samplers"] = [{"magFilter": 9728}]
    assert load(tmp_path, file).textures.table[0].kind == NEAREST


def test_the_mean_of_a_texture_decides_whether_it_is_metal(tmp_path):
    pixels = np.zeros((4, 4, 3), np.uint8)
    pixels[:, :, 1], pixels[:2, :, 2] = 51, 255  # roughness 0.2; half of it metal
    for factor, metal in ((1.0, True), (0.9, False), (0.1, False)):
        material = pbr(metallicRoughnessTexture={"index": 0}, metallicFactor=factor, roughnessFactor=0.5)
        made = load(tmp_path, add_image(file_with(material, TEXCOORD_0=UV), png(pixels)))
        assert (made.materials.kind[1] != DIFFUSE) == metal
        assert any("the texture of metallic and roughness (its mean is used)" in text for text in made.warnings) == (
            factor >= 0.5
        )
        if metal:
            assert made.materials.alpha[1] == pytest.approx(0.1**2)


def test_an_image_beside_a_text_file_is_read_where_the_scene_may_read_it(tmp_path):
    file = file_with(pbr(baseColorTexture={"index": 0}), TEXCOORD_0=UV)
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "a.bin").write_bytes(file.data)
    (folder / "b.png").write_bytes(png())
    (tmp_path / "b.png").write_bytes(png())
    header = {**file.json, "asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": len(file.data)}]}
    for uri, told in (("b.png", ""), ("../b.png", "outside the scene's folder"), ("c.png", "c.png: can't be read")):
        (folder / "a.gltf").write_text(json.dumps({**header, "textures": [{"source": 0}], "images": [{"uri": uri}]}))
        path = write(folder, scene(objects=[{"mesh": "a.gltf", "material": FROM_FILE}]))
        if told:
            with pytest.raises((rt.SceneError, rt.FileError), match=told):
                rt.load(path)
        else:
            assert rt.load(path).textures.table[0].codes.shape == (2, 3, 3)


# What is left out, and what is wrong ----------------------------------------------------------------------------------


def test_one_warning_names_what_is_left_out(tmp_path):
    material = {
        **pbr(baseColorTexture={"index": 0}, metallicFactor=0),
        "emissiveFactor": [1, 0, 0],
        "normalTexture": {"index": 0},
        "alphaMode": "BLEND",
        "extensions": {"KHR_materials_transmission": {}, "KHR_materials_emissive_strength": {}},
    }
    file = add_image(file_with(material, TEXCOORD_0=UV * 2, COLOR_0=np.eye(4, 3, dtype="<f4")), sampler=0)
    file.json["samplers"] = [{"wrapS": 33071}]
    made = load(tmp_path, file)
    assert made.mesh.colors is None
    (text,) = (text for text in made.warnings if "left out" in text)
    assert text.endswith(
        "a.glb: of the materials of the file, these are left out: emission, normal map, transparency, "
        "KHR_materials_transmission, vertex colours beside a texture, clamped or mirrored textures (they repeat)"
    )


def test_textures_that_can_not_be_read_leave_the_factor(tmp_path):
    material = pbr(baseColorTexture={"index": 0}, baseColorFactor=[0.5, 0.25, 1, 1], metallicFactor=0)
    without_uv = add_image(file_with(material))
    webp = add_image(file_with(material, TEXCOORD_0=UV), b"RIFF....WEBP")
    basis = add_image(file_with(material, TEXCOORD_0=UV))
    del basis.json["textures"][0]["source"]
    for file in (without_uv, webp, basis):
        made = load(tmp_path, file)
        assert made.textures is None
        assert made.materials.albedo[1].tolist() == [0.5, 0.25, 1]
        assert any("left out: the texture of the base colour" in text for text in made.warnings)


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        (
            {"mesh": "triangle.obj", "material": FROM_FILE},
            "objects[1].material: only GLB and glTF files have materials",
        ),
        ({"box": {}, "material": FROM_FILE}, "objects[1].material: only GLB and glTF files have materials"),
        ({"box": {}, "material": {"from": "disk"}}, 'objects[1].material.from: unknown from "disk" (known: file)'),
        ({"box": {}, "material": {}}, 'objects[1].material: missing key "from"'),
        ({"box": {}, "material": 5}, "objects[1].material: expected a string or an object, got 5"),
        ({"box": {}, "material": "\0file"}, 'objects[1].material: unknown material "'),
    ],
)
def test_other_objects_have_no_materials_of_their_own(tmp_path, entry, told):
    assert told in problem(tmp_path, file_with(), entry)


def test_broken_materials_are_told_with_the_object(tmp_path):
    broken = add_image(file_with(pbr(baseColorTexture={"index": 0}), TEXCOORD_0=UV), png()[:60])
    text = problem(tmp_path, broken)
    assert "objects[0].material: " in text
    assert "a.glb: images[0]: not a valid PNG image" in text
    metal = add_image(file_with(pbr(metallicRoughnessTexture={"index": 0}), TEXCOORD_0=UV), png()[:60])
    assert "objects[0].mesh: a.glb: images[0]: not a valid PNG image" in problem(tmp_path, metal)
    for change, told in (
        ({"material": 7}, "materials[7] does not exist"),
        ({"material": "x"}, "materials[x] does not exist"),
    ):
        file = file_with(pbr())
        file.mesh["primitives"][0] |= change
        assert told in problem(tmp_path, file)
    for material, told in (
        (pbr(baseColorFactor=[1, 1]), "baseColorFactor: expected 4 numbers"),
        (pbr(metallicFactor="no"), "metallicFactor: expected a number, got no"),
        ({"pbrMetallicRoughness": 3}, "pbrMetallicRoughness: expected an object"),
        (pbr(baseColorTexture={"index": 3}), "textures[3] does not exist"),
    ):
        assert told in problem(tmp_path, file_with(material, TEXCOORD_0=UV))
    many = add_image(file_with(*[pbr(baseColorTexture={"index": k}) for k in range(9)], TEXCOORD_0=UV))
    many.json |= {"textures": [{"source": k} for k in range(9)], "images": many.json["images"] * 9}
    assert "its images overlap" in problem(tmp_path, many)
    outside = add_image(file_with(pbr(baseColorTexture={"index": 0}), TEXCOORD_0=UV))
    outside.json["images"] = [{"uri": "b.png"}]
    assert "an image in another file, b.png; export one file" in problem(tmp_path, outside)
