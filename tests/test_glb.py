"""The GLB reader against trimesh's, and on what that one believes."""

import base64
import io
import json

import numpy as np
import pytest

from raytrace.scene.meshes.glb import MAX_JSON, read_glb
from raytrace.scene.meshes.raw_mesh import concatenate
from scene_files import glb, triangle_glb

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 2, 1]], "<f4")


def document(attributes=None, indices=None, mode=4, nodes=({"mesh": 0},), view=(), **more):
    """A file of one primitive with the five points and these corners (uint16)."""
    corners = np.array([] if indices is None else indices, "<u2")
    primitive = {"attributes": attributes or {"POSITION": 0}, "mode": mode}
    primitive |= {} if indices is None else {"indices": 1}
    header = {
        "scenes": [{"nodes": [0]}],
        "nodes": [dict(node) for node in nodes],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": 60 + corners.nbytes}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 60, **dict(view)},
            {"buffer": 0, "byteOffset": 60, "byteLength": corners.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(corners), "type": "SCALAR"},
        ],
    }
    return header | more, POINTS.tobytes() + corners.tobytes()


def read(*parts):
    return concatenate(read_glb(glb(*parts)))


def theirs(data):
    """Triangles (m, 3, 3) as trimesh places them."""
    import trimesh

    return trimesh.load_scene(io.BytesIO(data), file_type="glb").to_mesh().triangles


@pytest.mark.parametrize("seed", range(6))
def test_it_agrees_with_trimesh_on_trees_of_nodes(seed):
    rng = np.random.default_rng(seed)
    nodes = []
    for k in range(7):
        node = {"mesh": 0} if k % 2 or k == 6 else {}
        if k % 3 == 0:
            node["matrix"] = [*rng.normal(size=3), 0, *rng.normal(size=3), 0, *rng.normal(size=3), 0, 1, 2, 3, 1]
        else:
            turn = rng.normal(size=4)
            node["rotation"] = (turn / np.linalg.norm(turn)).tolist()
            node |= {"translation": rng.normal(size=3).tolist(), "scale": rng.uniform(0.5, 2, 3).tolist()}
        nodes.append(node)
    for child in range(1, 7):
        nodes[int(rng.integers(child))].setdefault("children", []).append(child)
    data = glb(*document(indices=[0, 1, 2, 0, 2, 3, 2, 3, 4], nodes=nodes))
    ours = concatenate(read_glb(data))
    found, expected = ours.vertices[ours.faces], np.asarray(theirs(data))

    def rows(triangles):  # the order of nodes and of corners is anyone's
        middles = triangles.mean(axis=1)
        return middles[np.lexsort(np.round(middles, 6).T)]

    np.testing.assert_allclose(rows(found), rows(expected), atol=1e-12)


@pytest.mark.parametrize(
    ("mode", "corners", "expected"),
    [
        (4, [0, 1, 2, 2, 1, 3], [[0, 1, 2], [2, 1, 3]]),
        (5, [0, 1, 2, 3, 4], [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        (6, [0, 1, 2, 3, 4], [[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
        (4, None, None),
        (5, None, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
    ],
)
def test_lists_strips_and_fans(mode, corners, expected):
    if expected is None:
        with pytest.raises(ValueError, match="5 corners do not make triangles"):
            read(*document(indices=corners, mode=mode))
    else:
        assert read(*document(indices=corners, mode=mode)).faces.tolist() == expected


def test_lines_points_and_too_few_corners_are_no_triangles():
    for mode, corners in ((0, [0, 1]), (1, [0, 1]), (5, [0, 1]), (6, [0])):
        assert read_glb(glb(*document(indices=corners, mode=mode))) == []


def test_rows_may_stand_apart_and_buffers_in_the_text():
    header, data = document(indices=[0, 1, 2])
    wide = np.zeros((5, 5), "<f4")
    wide[:, :3] = POINTS
    header["bufferViews"][0] |= {"byteLength": 100, "byteStride": 20}
    header["bufferViews"][1]["byteOffset"] = 100
    assert read(header, wide.tobytes() + data[60:]).vertices.tolist() == POINTS.tolist()
    header, data = document(indices=[0, 1, 2])
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    header["buffers"][0]["uri"] = uri
    assert read(header, b"").vertices.tolist() == POINTS.tolist()
    header["buffers"][0]["uri"] = uri + "*"
    with pytest.raises(ValueError, match=r"buffers\[0\]: its data is not base64"):
        read(header, b"")


def test_a_mesh_of_half_a_turn_and_a_mirror():
    nodes = [{"mesh": 0, "rotation": [0, 0, 3, 0], "scale": [1, 1, -1]}]  # a quaternion need not be unit
    mesh = read(*document(indices=[0, 1, 2], nodes=nodes))
    assert mesh.vertices[mesh.faces].tolist() == [[[0, 0, 0], [-1, -1, 0], [-1, 0, 0]]]


def changed(path, value, **more):
    header, data = document(indices=[0, 1, 2], **more)
    place = header
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return header, data


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        (("accessors", 0, "count"), 2_000_000_000, r"accessors\[0\] states 2000000000 rows of 12 bytes"),
        (("accessors", 0, "count"), -1, "count: expected a whole number, got -1"),
        (("accessors", 0, "count"), 10**30, "count: expected a whole number, got 1000"),
        (("accessors", 0, "count"), True, "count: expected a whole number, got True"),
        (("accessors", 0, "count"), 5.0, "count: expected a whole number, got 5.0"),
        (("accessors", 0, "byteOffset"), 4, r"accessors\[0\] states 5 rows of 12 bytes, its view has 60 bytes"),
        (("accessors", 0, "byteOffset"), 2**52, r"accessors\[0\] states"),
        (("accessors", 0, "componentType"), 5125, r"accessors\[0\] does not have the type that its use needs"),
        (("accessors", 0, "componentType"), [], r"accessors\[0\] does not have the type that its use needs"),
        (("accessors", 0, "type"), "VEC4", r"accessors\[0\] does not have the type that its use needs"),
        (("accessors", 1, "componentType"), 5126, r"accessors\[1\] does not have the type that its use needs"),
        (("accessors", 0, "sparse"), {"count": 10**9}, r"accessors\[0\]: sparse: expected indices of at most 5 rows"),
        (("accessors", 0, "sparse"), [], "sparse: expected an object"),
        (("scenes",), [], "it has no scene"),
        (("accessors", 0, "bufferView"), 7, r"bufferViews\[7\] does not exist"),
        (("accessors", 0), 3, r"accessors\[0\]: expected an object"),
        (("accessors",), {}, "accessors: expected a list"),
        (("bufferViews", 0, "byteStride"), 0, r"accessors\[0\] has rows of 12 bytes every 0 bytes"),
        (("bufferViews", 0, "byteStride"), 2**40, r"accessors\[0\] states 5 rows"),
        (("bufferViews", 0, "byteOffset"), 2**52, "a view of 60 bytes from 4503599627370496 on leaves its buffer"),
        (("bufferViews", 0, "byteLength"), 2**63, "byteLength: expected a whole number"),
        (("bufferViews", 0, "byteLength"), 2**40, "a view of 1099511627776 bytes from 0 on leaves its buffer"),
        (("bufferViews", 0, "buffer"), 1, r"buffers\[1\] does not exist"),
        (("nodes", 0, "children"), [0], r"nodes\[0\] is in the scene twice; nodes must be a tree"),
        (("nodes", 0, "children"), [9], r"nodes\[9\] does not exist"),
        (("nodes", 0, "children"), ["a"], r"nodes\[a\] does not exist"),
        (("nodes", 0, "mesh"), -1, r"meshes\[-1\] does not exist"),
        (("nodes", 0, "scale"), [1, 1], "scale: expected 3 numbers"),
        (("nodes", 0, "scale"), [1, 1, "1"], "scale: expected 3 numbers"),
        (("nodes", 0, "rotation"), [0, 0, 0, 0], "rotation: expected a quaternion other than 0"),
        (("nodes", 0, "matrix"), [1] * 15, "matrix: expected 16 numbers"),
        (("scenes", 0), [], r"scenes\[0\]: expected an object"),
        (("scene",), 4, r"scenes\[4\] does not exist"),
        (("meshes", 0, "primitives", 0), 5, "primitives: expected objects"),
        (("meshes", 0, "primitives", 0, "attributes"), [], "attributes: expected an object"),
        (("nodes", 0, "extensions"), [], "extensions: expected an object"),
        (("nodes", 0, "weights"), 1, "weights: expected a list"),
        (("extensionsRequired",), ["KHR_draco_mesh_compression"], "not supported: KHR_draco_mesh_compression; export"),
    ],
)
def test_what_a_file_announces_is_compared_with_what_it_holds(path, value, told):
    with pytest.raises(ValueError, match=told):
        read(*changed(path, value))


def test_normals_belong_to_vertices():
    header, data = document({"POSITION": 0, "NORMAL": 2}, indices=[0, 1, 2])
    header["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"})
    with pytest.raises(ValueError, match="5 vertices have 4 normals"):
        read(header, data)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda data: data[:4] + b"\1\0\0\0" + data[8:], "the file does not begin with the header of glTF 2.0"),
        (lambda data: b"gltf" + data[4:], "the file does not begin with the header of glTF 2.0"),
        (lambda data: data[:8] + b"\xff\xff\xff\xff" + data[12:], "the header states 4294967295 bytes"),
        (lambda data: data[:12] + b"\xff\xff\xff\xff" + data[16:], "a chunk is longer than the file"),
        (lambda data: data[:16] + b"JSOM" + data[20:], "Expecting value"),
        (lambda data: data[:20] + b"[" + data[21:], "Expecting|delimiter"),
    ],
)
def test_a_broken_frame_is_told(change, told):
    with pytest.raises(ValueError, match=told):
        read_glb(change(triangle_glb([{"mesh": 0}])))


def test_json_that_is_deep_or_long_is_refused():
    deep = b"[" * 100_000 + b"]" * 100_000
    with pytest.raises((RecursionError, ValueError)):
        read_glb(frame(deep))
    with pytest.raises(ValueError, match=f"its JSON has more than {MAX_JSON} bytes"):
        read_glb(frame(b" " * (MAX_JSON + 1)))
    with pytest.raises(ValueError, match="digits"):
        read_glb(frame(b'{"scene": ' + b"1" * 1_000_000 + b"}"))


def frame(text):
    chunk = len(text).to_bytes(4, "little") + b"JSON" + text
    return b"glTF\2\0\0\0" + (12 + len(chunk)).to_bytes(4, "little") + chunk


def test_a_long_chain_of_nodes_takes_no_long_time():
    nodes = [{"children": [k + 1], "translation": [1, 0, 0], "mesh": 0} for k in range(3000)] + [{"mesh": 0}]
    mesh = read(*document(indices=[0, 1, 2], nodes=nodes))
    assert mesh.vertices[mesh.faces][:, 0, 0].tolist() == list(range(1, 3001)) + [3000]


def test_chunks_that_are_unknown_are_passed_over():
    data = triangle_glb([{"mesh": 0}])
    extra = (4).to_bytes(4, "little") + b"XTRA" + b"abcd"
    longer = data[:8] + (len(data) + len(extra)).to_bytes(4, "little") + data[12:] + extra
    assert concatenate(read_glb(longer)).vertices.tolist() == concatenate(read_glb(data)).vertices.tolist()
    assert json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
