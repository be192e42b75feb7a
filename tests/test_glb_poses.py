"""Meshes of glTF files in the pose that the file has: morph targets, instances, quantised numbers."""

import base64
import json
import math

import numpy as np
import pytest

from gltf_files import CORNERS, FIRST, SQUARE, File, area, read, skinned
from raytrace.scene.meshes.errors import TooLargeError, TooManyTrianglesError, UnsupportedError
from raytrace.scene.meshes.glb import read_glb, read_gltf
from raytrace.scene.meshes.raw_mesh import concatenate
from scene_files import glb

# ---- morph targets -------------------------------------------------------------------------------------------------


def morphed(weights=None, of_node=None, **targets):
    file = File()
    file.attributes["NORMAL"] = file.add(np.array([[0, 0, 1]] * 4, "<f4"))
    file.primitive["targets"] = [
        {"POSITION": file.add(np.array([[0, 0, 5]] * 4, "<f4")), "NORMAL": file.add(np.array([[1, 0, 0]] * 4, "<f4"))},
        {"POSITION": file.add(np.array([[0, 1, 0]] * 4, "<f4"))},
    ]
    file.mesh |= {} if weights is None else {"weights": weights}
    file.node |= {} if of_node is None else {"weights": of_node}
    return file


@pytest.mark.parametrize(
    ("of_mesh", "of_node", "moved", "normal"),
    [
        (None, None, [0, 0, 0], [0, 0, 1]),
        ([1.0, 0], None, [0, 0, 5], [1, 0, 1]),
        ([1.0, 0], [0, 2], [0, 2, 0], [0, 0, 1]),
        (None, [0.5, 1], [0, 1, 2.5], [0.5, 0, 1]),
        ([-1], None, [0, 0, -5], [-1, 0, 1]),
    ],
)
def test_morph_targets_are_added_by_the_weights_of_the_node_or_the_mesh(of_mesh, of_node, moved, normal):
    mesh = read(morphed(of_mesh, of_node))
    assert mesh.vertices.tolist() == (SQUARE + moved).tolist()
    assert mesh.normals.tolist() == [normal] * 4


def test_a_morphed_mesh_is_skinned_after_that():
    file = skinned(*FIRST, {"translation": [10, 0, 0], "scale": [2, 2, 2]})
    file.primitive["targets"] = [{"POSITION": file.add(np.array([[0, 0, 5]] * 4, "<f4"))}]
    file.mesh["weights"] = [1]
    assert read(file).vertices[0].tolist() == [10, 0, 10]


def test_a_broken_morph_target_is_one_line():
    file = morphed([1])
    file.primitive["targets"][0]["POSITION"] = 1
    with pytest.raises(ValueError, match="4 vertices have 6 offsets of a morph target"):
        read(file)
    with pytest.raises(ValueError, match="weights: expected numbers, got x"):
        read(morphed(["x"]))
    file = morphed([1])
    file.primitive["targets"] = [3]
    with pytest.raises(ValueError, match="targets: expected objects"):
        read(file)


# ---- instances -----------------------------------------------------------------------------------------------------


def instanced(**attributes):
    file = File()
    file.node["extensions"] = {
        "EXT_mesh_gpu_instancing": {"attributes": {name: file.add(array) for name, array in attributes.items()}}
    }
    file.json["extensionsUsed"] = file.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    return file


def corners(file):
    return [part.vertices[2].round(12).tolist() for part in read_glb(file.glb())]


def test_instances_stand_relative_to_their_node():
    file = instanced(TRANSLATION=np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0]], "<f4"))
    file.node["scale"] = [1, 1, 10]
    file.node["translation"] = [0, 0, 1]
    assert corners(file) == [[1, 1, 1], [3, 1, 1], [5, 1, 1]]
    assert area(file) == 3


@pytest.mark.parametrize(("kind", "one"), [("<f4", math.sqrt(0.5)), ("<i2", round(32767 * math.sqrt(0.5))), ("i1", 90)])
def test_instances_may_have_any_of_the_attributes(kind, one):
    assert corners(instanced(SCALE=np.array([[2, 3, 1]], "<f4"))) == [[2, 3, 0]]
    file = instanced(ROTATION=np.array([[0, 0, one, one], [0, 0, 0, one]]).astype(kind))
    for accessor in file.json["accessors"][2:]:
        accessor |= {"normalized": True} if kind != "<f4" else {}
    assert corners(file) == [[-1, 1, 0], [1, 1, 0]]
    assert corners(instanced()) == [[1, 1, 0]]
    both = instanced(SCALE=np.array([[2, 2, 2]] * 2, "<f4"), TRANSLATION=np.array([[0, 0, 0], [0, 0, 9]], "<f4"))
    assert corners(both) == [[2, 2, 0], [2, 2, 9]]
    assert corners(instanced(_ID=np.array([1, 2, 3], "<u2"), SCALE=np.array([[2, 2, 2]] * 3, "<f4"))) == [[2, 2, 0]] * 3


def test_broken_instances_are_one_line():
    file = instanced(SCALE=np.array([[2, 2, 2]] * 2, "<f4"), TRANSLATION=np.array([[0, 0, 0]], "<f4"))
    with pytest.raises(ValueError, match="the attributes have 1 and 2 rows"):
        read(file)
    file = instanced()
    file.node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
        "TRANSLATION": file.accessor({"componentType": 5126, "count": 10**12, "type": "VEC3"})
    }
    with pytest.raises(TooLargeError, match="1,000,000,000,000 instances; at most 65,536"):
        read(file)


def test_a_skin_has_no_instances():
    file = skinned(*FIRST, {"translation": [10, 0, 0]})
    shifts = file.add(np.array([[0, 0, 0], [2, 0, 0]], "<f4"))
    file.node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": shifts}}}
    assert area(file) == 1
    assert "of a mesh that has a skin is not supported" in read(file).warnings[0]


# ---- numbers -------------------------------------------------------------------------------------------------------


def test_quantised_positions_and_normals():
    file = File(np.array([[0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]], "<i2"))
    file.attributes["NORMAL"] = file.add(
        np.array([[0, 0, 127], [0, 0, -128], [127, 0, 0], [0, 0, 127]], "i1"), normalized=True
    )
    file.json["extensionsRequired"] = file.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    file.node["scale"] = [0.01, 0.01, 0.01]
    mesh = read(file)
    np.testing.assert_allclose(mesh.vertices, SQUARE, atol=1e-15)
    assert mesh.normals[:, 2].tolist() == [1, -1, 0, 1]
    assert mesh.warnings == ()
    file = File(np.array([[0, 0, 0], [255, 0, 0], [255, 255, 0], [0, 255, 0]], "u1"))
    file.json["accessors"][0]["normalized"] = True
    assert read(file).vertices.tolist() == SQUARE.tolist()


def test_sparse_accessors_replace_rows():
    file = File()
    places, values = file.view(np.array([1, 3], "<u2")), file.view(np.array([[7, 0, 0], [0, 7, 0]], "<f4"))
    sparse = {
        "count": 2,
        "indices": {"bufferView": places, "componentType": 5123},
        "values": {"bufferView": values},
    }
    file.json["accessors"][0]["sparse"] = sparse
    assert read(file).vertices.tolist() == [[0, 0, 0], [7, 0, 0], [1, 1, 0], [0, 7, 0]]
    del file.json["accessors"][0]["bufferView"]  # the others are 0 then
    assert read(file).vertices.tolist() == [[0, 0, 0], [7, 0, 0], [0, 0, 0], [0, 7, 0]]
    sparse["indices"]["bufferView"] = file.view(np.array([3, 1], "<u2"))
    with pytest.raises(ValueError, match=r"accessors\[0\]: sparse: the indices do not increase, or reach 4"):
        read(file)
    sparse["indices"]["bufferView"] = file.view(np.array([1, 4], "<u2"))
    with pytest.raises(ValueError, match="do not increase, or reach 4"):
        read(file)


def test_a_sparse_morph_target_of_a_part_of_many_vertices():
    points = np.zeros((1000, 3), "<f4")
    points[500:504] = SQUARE
    file = File(points, CORNERS + 500)
    places, values = file.view(np.array([7, 501, 999], "<u2")), file.view(np.array([[0, 0, 2]] * 3, "<f4"))
    target = file.accessor(
        {
            "componentType": 5126, "count": 1000, "type": "VEC3",
            "sparse": {
                "count": 3, "indices": {"bufferView": places, "componentType": 5123}, "values": {"bufferView": values},
            },
        }
    )  # fmt: skip
    file.primitive["targets"] = [{"POSITION": target}]
    file.mesh["weights"] = [1]
    mesh = read(file)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 2], [1, 1, 0], [0, 1, 0]]  # and no others
    assert mesh.faces.tolist() == CORNERS.reshape(-1, 3).tolist()


# ---- what is skipped, warned of, and refused -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["EXT_bend"], "the extension EXT_bend is not supported; if it changes the shape, the shape is wrong"),
        (["ACME_a", "ACME_b"], "the extensions ACME_a, ACME_b are not supported; if they change the shape, "),
        (["KHR_materials_ior", "KHR_texture_transform", "KHR_lights_punctual", "EXT_texture_webp"], None),
        (["KHR_mesh_quantization", "KHR_xmp_json_ld", "MSFT_texture_dds", "KHR_materials_variants"], None),
        (["KHR_draco_mesh_compression", "EXT_meshopt_compression"], None),  # the plain numbers are there too
    ],
)
def test_extensions_that_may_change_the_shape_are_named(names, told):
    file = File()
    file.json["extensionsUsed"] = names
    warnings = read(file).warnings
    assert len(warnings) == (told is not None)
    if told:
        assert warnings[0].startswith(told)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_views_that_are_compressed_are_refused_by_the_name_of_the_compression(name):
    file = File()
    file.json["extensionsRequired"] = [name]
    with pytest.raises(UnsupportedError, match=f"needs extensions that are not supported: {name}"):
        read(file)
    del file.json["extensionsRequired"]
    header = file.header()
    header["bufferViews"][0] |= {"buffer": 1, "extensions": {name: {"buffer": 0}}}
    header["buffers"].append({"byteLength": 999, "extensions": {name: {"fallback": True}}})
    with pytest.raises(UnsupportedError, match=f"a view is compressed by {name}, which is not supported"):
        read_glb(glb(header, file.data))
    uri = "data:application/octet-stream;base64," + base64.b64encode(file.data).decode()
    header["buffers"][1] |= {"byteLength": len(file.data), "uri": uri}
    assert concatenate(read_glb(glb(header, file.data))).vertices.tolist() == SQUARE.tolist()


def test_draco_is_named_where_the_plain_numbers_are_missing():
    file = File()
    file.primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    assert area(file) == 1
    del file.json["accessors"][1]["bufferView"]
    with pytest.raises(UnsupportedError, match="compressed by KHR_draco_mesh_compression, which is not supported"):
        read(file)


def test_a_part_without_positions_is_skipped():
    file = File()
    file.mesh["primitives"] += [{"attributes": {}}, {}, {"attributes": {"NORMAL": 0}, "indices": 1}]
    assert area(file) == 1


def test_hidden_nodes_are_not_read():
    file = File()
    file.json["nodes"] += [{"mesh": 0, "translation": [5, 0, 0]}, {"children": [0]}]
    file.json["nodes"][2]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    file.json["scenes"][0]["nodes"] = [1, 2]
    file.json["extensionsUsed"] = ["KHR_node_visibility"]
    assert read(file).vertices[0].tolist() == [5, 0, 0]
    assert area(file) == 1


@pytest.mark.parametrize("padding", [b"\0", b" \0\0", b"\0" * 5])
def test_the_json_may_be_padded_with_zero_bytes(padding):
    file = File()
    text = json.dumps({"asset": {"version": "2.0"}, **file.header()}).encode() + padding
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text
    chunks += len(file.data).to_bytes(4, "little") + b"BIN\0" + file.data
    data = b"glTF\2\0\0\0" + (12 + len(chunks)).to_bytes(4, "little") + chunks
    assert concatenate(read_glb(data)).vertices.tolist() == SQUARE.tolist()


def test_triangles_are_counted_before_any_is_made(monkeypatch):
    file = File()
    file.json["nodes"] = [{"children": list(range(1, 300))}] + [{"mesh": 0}] * 299
    assert len(read(file).faces) == 598
    monkeypatch.setattr("raytrace.scene.meshes.glb._mesh", None)
    with pytest.raises(TooManyTrianglesError, match="it places 598 triangles"):
        read_glb(file.glb(), 500)


def test_numbers_that_are_only_announced_take_no_memory():
    file = File()
    for index in (0, 1):
        file.json["accessors"][index].pop("bufferView")
        file.json["accessors"][index]["count"] = 3 * 10**12
    with pytest.raises(TooManyTrianglesError):
        read(file)
    file.json["accessors"][1]["count"] = 3  # of 3 x 10^12 vertices
    assert len(read(file).vertices) == 1


def test_a_text_file_has_its_buffers_elsewhere():
    file = File()
    header = file.header()
    header["buffers"][0]["uri"] = "square.bin"
    asked = []
    meshes = read_gltf(json.dumps(header).encode(), 10, lambda uri: asked.append(uri) or file.data)
    assert concatenate(meshes).vertices.tolist() == SQUARE.tolist()
    assert asked == ["square.bin"]  # once, for two views
    with pytest.raises(UnsupportedError, match=r"a buffer in another file, square\.bin; nothing else is opened"):
        read_glb(glb(header, file.data))
