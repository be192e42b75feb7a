"""uv and vertex colours of mesh files, of meshes that programs give, and of the joined mesh of a scene."""

import re
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import raytrace as rt
from gltf_files import CORNERS, SQUARE, File, skinned
from raytrace.records import RawMesh
from raytrace.scene import assemble
from raytrace.scene.attributes import needed
from raytrace.scene.fingerprint import fingerprint
from raytrace.scene.meshes.given import read_given
from raytrace.scene.meshes.glb import read_glb
from raytrace.scene.meshes.obj import ObjError, read_obj
from raytrace.scene.meshes.ply import read_ply
from raytrace.scene.meshes.raw_mesh import concatenate, transform, turned_round
from raytrace.scene.meshes.reading import read_mesh
from scene_files import scene, write

pytestmark = pytest.mark.nojit

BOTH = frozenset({"uv", "color"})
UV, COLOR = frozenset({"uv"}), frozenset({"color"})
PLANE = np.array([[0.25, -0.5, 2.0], [1.5, 0.75, -0.125]])  # uv = PLANE p: exact in float32 for small numbers
TINT = np.array([[0.5, 0.25, 0.125], [0.125, 0.5, 0.25], [0.25, 0.125, 0.5]])  # colour = TINT p


def uv_at(points):
    return points @ PLANE.T


def color_at(points):
    return points @ TINT.T


def aligned(mesh, points=None):
    """Whether each corner has the uv and the colour of its point."""
    points = mesh.vertices[mesh.faces] if points is None else points
    np.testing.assert_array_equal(mesh.uv, uv_at(points))
    np.testing.assert_array_equal(mesh.colors, color_at(points))
    return True


# Which are needed -----------------------------------------------------------------------------------------------------


def test_what_each_material_needs():
    image, board, color = {"image": "a.png"}, {"checkerboard": [[1, 1, 1], [0, 0, 0]]}, {"attribute": "color"}
    materials = {
        "plain": {"type": "diffuse", "albedo": [1, 1, 1]},
        "image": {"type": "diffuse", "albedo": image},
        "lamp": {"type": "diffuse", "albedo": color, "emission": board},
        "mirror": {"type": "mirror", "reflectance": color},
        "wrong": 5,
    }
    assert needed({"materials": materials}) == {"image": {"uv"}, "lamp": {"uv", "color"}, "mirror": {"color"}}
    assert needed({"materials": []}) == needed({}) == {}


# OBJ ------------------------------------------------------------------------------------------------------------------


def test_each_corner_of_an_obj_keeps_its_own_uv_across_seams_and_in_polygons_of_any_form():
    rng = np.random.default_rng(1)
    outline = np.array([[0, 0], [2, 1], [4, 0], [3, 2], [4, 4], [2, 3], [0, 4], [1, 2]])  # a star: concave
    lines, uv, corner_of = [], [], {}
    for polygon, size in enumerate([3, 4, 8, 4, 5, 8, 3]):
        points = np.c_[outline if size == 8 else outline[:size], np.full(size, polygon)]
        places = rng.random((size, 2)).round(6)
        for point, place in zip(points.tolist(), places.tolist(), strict=True):
            lines += ["v {} {} {}".format(*point), "vt {} {}".format(*place)]
            corner_of[tuple(place)] = polygon, point
        back = -np.arange(size, 0, -1)
        first = len(uv) + 1
        refer = [f"{b}/{b}" for b in back] if polygon % 2 else [f"{first + k}/{first + k}/" for k in range(size)]
        lines.append("f " + " ".join(refer))
        uv += places.tolist()
    mesh = read_obj("\n".join(lines).encode(), UV)
    assert mesh.colors is None
    assert len(mesh.uv) == len(mesh.faces) == 21
    for corners, places in zip(mesh.vertices[mesh.faces].tolist(), mesh.uv.tolist(), strict=True):
        found = [corner_of[tuple(place)] for place in places]
        assert len({polygon for polygon, _ in found}) == 1
        assert [point for _, point in found] == corners


def test_obj_colours_and_odd_lines():
    text = "v 0 0 0 1 0 0.5\nv 1 0 0 0 1 0\nv 0 1 0 0.25 0.25 1\nvt 0.5\nvt 0 1 0\nvt 1 0 9\n"
    mesh = read_obj((text + "f 1/1 2/2 3/3\nf 3 2 1\nf 1//1 2/3/1 3/-1/1").encode(), BOTH)
    assert mesh.colors.tolist()[:2] == [
        [[1, 0, 0.5], [0, 1, 0], [0.25, 0.25, 1]],
        [[0.25, 0.25, 1], [0, 1, 0], [1, 0, 0.5]],
    ]
    np.testing.assert_array_equal(mesh.uv[0], [[0.5, 0], [0, 1], [1, 0]])
    assert np.isnan(mesh.uv[1]).all()
    np.testing.assert_array_equal(mesh.uv[2], [[np.nan, np.nan], [1, 0], [1, 0]])


def test_a_weight_of_an_obj_vertex_is_no_colour():
    mesh = read_obj(b"v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3", BOTH)
    assert mesh.colors is None
    assert mesh.uv is None
    mixed = read_obj(b"v 0 0 0 1\nv 1 0 0 1 1 1\nv 0 1 0\nf 1 2 3", BOTH)
    np.testing.assert_array_equal(mixed.colors[0], [[np.nan] * 3, [1, 1, 1], [np.nan] * 3])


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("vt 0 x\nf 1/1 2/1 3/1", 4, "expected a number, got 'x'"),
        ("vt\nf 1/1 2/1 3/1", 4, "expected 1 number, got 0"),
        ("vt 0 0\nf 1/1 2/2 3/1", 5, "texture coordinate 2 does not exist; the file has 1, counted from 1"),
        ("vt 0 0\nf 1/1 2/y 3/1", 5, "expected the index of a texture coordinate, got 'y'"),
        ("v 0 0 0 1 z 1\nf 1 2 3", 4, "expected a number, got 'z'"),
    ],
)
def test_faults_of_obj_attributes_are_told_only_where_they_are_wanted(text, line, told):
    text = ("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + text).encode()
    assert read_obj(text).uv is None
    with pytest.raises(ObjError, match=told.replace("(", r"\(")) as caught:
        read_obj(text, BOTH)
    assert caught.value.line == line


# PLY ------------------------------------------------------------------------------------------------------------------

PYRAMID = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]])
POLYGONS = [[0, 1, 2, 3], [0, 1, 4], [2, 3, 4]]


def ply(order, names, kinds, table, wedges=None):
    """A pyramid with further properties of its vertices; wedges: uv of the corners of each face."""
    types = {"f4": "float", "f8": "double", "u1": "uchar", "u2": "ushort", "i4": "int"}
    head = ["ply", f"format {order} 1.0", "element vertex 5", *(f"property float {axis}" for axis in "xyz")]
    head += [f"property {types[kind]} {name}" for name, kind in zip(names, kinds, strict=True)]
    head += ["element face 3", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"] * (wedges is not None)
    text, end = "\n".join([*head, "end_header", ""]).encode(), "<" if "little" in order else ">"
    dtype = np.dtype(
        [(name, end + kind) for name, kind in zip("xyz", ["f4"] * 3, strict=True)]
        + [(name, end + kind) for name, kind in zip(names, kinds, strict=True)]
    )
    rows = [tuple(row) for row in np.hstack([PYRAMID, table]).tolist()]
    rows = np.array([tuple(int(x) if dtype[k].kind in "iu" else x for k, x in enumerate(row)) for row in rows], dtype)
    wedges = wedges or [[]] * 3
    if order == "ascii":
        lines = [" ".join(map(str, row)) for row in rows.tolist()]
        for face, uv in zip(POLYGONS, wedges, strict=True):
            lines.append(" ".join(map(str, [len(face), *face, *([len(uv), *uv] if "texcoord" in head[-1] else [])])))
        return text + "\n".join([*lines, ""]).encode()
    body = rows.tobytes()
    for face, uv in zip(POLYGONS, wedges, strict=True):
        body += struct.pack(f"{end}B{len(face)}i", len(face), *face)
        body += struct.pack(f"{end}B{len(uv)}f", len(uv), *uv) if "texcoord" in head[-1] else b""
    return text + body


ORDERS = pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])


@ORDERS
@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
@pytest.mark.parametrize("colour", [("red", "green", "blue"), ("red", "green", "blue", "alpha")])
def test_ply_uv_and_float_colours(order, names, colour):
    extra = np.c_[uv_at(PYRAMID), color_at(PYRAMID), np.zeros((5, len(colour) - 3))]
    data = ply(order, [*names, *colour], ["f4", "f8"] + ["f4"] * len(colour), extra)
    mesh = read_ply(data, BOTH)
    assert len(mesh.faces) == 4
    assert aligned(mesh)
    only = read_ply(data, COLOR)
    assert only.uv is None
    assert only.colors is not None
    none = read_ply(data)
    assert none.uv is none.colors is None


@ORDERS
@pytest.mark.parametrize(("kind", "largest"), [("u1", 255), ("u2", 65535)])
def test_ply_integers_are_fractions_of_their_largest_and_linear(order, kind, largest):
    table = np.array([[0, 1, 128], [255, 7, 9], [3, 4, 5], [250, 251, 252], [largest, 0, largest]])
    mesh = read_ply(ply(order, ["red", "green", "blue"], [kind] * 3, table), BOTH)
    np.testing.assert_allclose(mesh.colors, (table / largest)[mesh.faces], rtol=1e-15)
    assert mesh.colors.max() == 1.0


@ORDERS
def test_uv_of_the_faces_of_a_ply(order):
    """As MeshLab writes them, with a seam at every edge."""
    wedges = [
        [x for corner in face for x in (corner + k, -corner - k)] for k, face in zip((0, 10, 20), POLYGONS, strict=True)
    ]
    mesh = read_ply(ply(order, [], [], np.empty((5, 0)), wedges), UV)
    offset = np.array([0, 0, 10, 20])[:, None]
    np.testing.assert_array_equal(mesh.uv, np.stack([mesh.faces + offset, -mesh.faces - offset], axis=2))
    wedges[1] = []
    mesh = read_ply(ply(order, [], [], np.empty((5, 0)), wedges), UV)
    assert np.isnan(mesh.uv[2]).all()
    assert np.isfinite(mesh.uv[[0, 1, 3]]).all()
    wedges[2] = wedges[2][:4]
    with pytest.raises(ValueError, match="face row 2 has 3 corners and 4 numbers of texcoord"):
        read_ply(ply(order, [], [], np.empty((5, 0)), wedges), UV)


def test_uv_of_faces_beside_edges_that_are_left_out():
    head = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += b"element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    mesh = read_ply(head + b"0 0 0\n1 0 0\n0 1 0\n2 0 1 4 9 9 9 9\n3 0 1 2 6 1 2 3 4 5 6\n", UV)
    assert mesh.uv.tolist() == [[[1, 2], [3, 4], [5, 6]]]


def test_strips_of_a_ply_have_uv():
    head = b"ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    head += (
        b"property float s\nproperty float t\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    rows = "\n".join(" ".join(map(str, row)) for row in np.hstack([PYRAMID, uv_at(PYRAMID)]).tolist())
    mesh = read_ply(head + rows.encode() + b"\n5 0 1 2 3 4\n", UV)
    assert len(mesh.faces) == 3
    np.testing.assert_array_equal(mesh.uv, uv_at(mesh.vertices[mesh.faces]))


def test_faults_of_ply_attributes_are_told_only_where_they_are_wanted():
    data = ply("ascii", ["s", "t"], ["f4", "f4"], uv_at(PYRAMID)).replace(b"0.375 1.5", b"0.375 one")
    wrong = ply("binary_little_endian", ["red", "green", "blue"], ["i4"] * 3, np.ones((5, 3)))
    data = data.replace(b"0.0 0.0 0.0 0.0 0.0", b"0.0 0.0 0.0 0.0 one")
    for content, told in (
        (data, "row 0 of element vertex: expected a number as t"),
        (wrong, "property red of element"),
    ):
        assert read_ply(content).uv is None
        with pytest.raises(ValueError, match=told):
            read_ply(content, BOTH)


# GLB ------------------------------------------------------------------------------------------------------------------


def flipped(uv):
    return np.asarray(uv) * [1, -1] + [0, 1]


def square_with(**attributes):
    """The unit square of the tests, with more attributes."""
    file = File()
    for name, (array, more) in attributes.items():
        file.attributes[name] = file.add(array, **more)
    return file


def test_glb_v_is_turned_so_that_0_is_the_bottom_row():
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0.25]], "<f4")
    mesh = concatenate(read_glb(square_with(TEXCOORD_0=(uv, {})).glb(), wanted=BOTH))
    np.testing.assert_array_equal(mesh.uv, flipped(uv)[mesh.faces])
    assert mesh.colors is None


@pytest.mark.parametrize(("kind", "largest"), [("u1", 255), ("u2", 65535)])
@pytest.mark.parametrize("width", [3, 4])
def test_glb_integers_are_fractions(kind, largest, width):
    rng = np.random.default_rng(2)
    uv, colour = rng.integers(0, largest, (4, 2), endpoint=True), rng.integers(0, largest, (4, width), endpoint=True)
    file = square_with(
        TEXCOORD_0=(np.array(uv, f"<{kind}"), {"normalized": True}),
        COLOR_0=(np.array(colour, f"<{kind}"), {"normalized": True}),
    )
    mesh = concatenate(read_glb(file.glb(), wanted=BOTH))
    np.testing.assert_allclose(mesh.uv, flipped(uv / largest)[mesh.faces], rtol=1e-15)
    np.testing.assert_allclose(mesh.colors, (colour[:, :3] / largest)[mesh.faces], rtol=1e-15)


@pytest.mark.parametrize("mode", [4, 5, 6])
@pytest.mark.parametrize("scale", [[1, 1, 1], [-2, 1, 1]])
def test_glb_strips_fans_and_mirrored_nodes_keep_their_uv(mode, scale):
    points = np.array([[k % 2, k // 2, 0] for k in range(6)], "<f4")
    file = File(points, np.array([0, 1, 2, 3, 4, 5], "<u2"))
    uv = flipped(uv_at(points)).astype("<f4")
    file.attributes |= {"TEXCOORD_0": file.add(uv), "COLOR_0": file.add(color_at(points).astype("<f4"))}
    file.primitive["mode"], file.node["scale"] = mode, scale
    mesh = concatenate(read_glb(file.glb(), wanted=BOTH))
    assert aligned(mesh, mesh.vertices[mesh.faces] / scale)


def test_glb_unused_vertices_are_dropped_with_their_uv():
    points = np.zeros((5000, 3), "<f4")
    points[4000:4004] = SQUARE
    file = File(points, CORNERS + 4000)
    file.attributes |= {"TEXCOORD_0": file.add(flipped(uv_at(points)).astype("<f4"))}
    file.attributes |= {"COLOR_0": file.add(color_at(points).astype("<f4"))}
    mesh = concatenate(read_glb(file.glb(), wanted=BOTH))
    assert len(mesh.vertices) == 4
    assert aligned(mesh)


def test_triangles_that_a_skin_turns_round_keep_their_uv():
    file = skinned(np.zeros(4, "u1"), np.array([1, 0, 0, 0], "<f4"), {"scale": [-1, 1, 1]})
    file.attributes |= {"TEXCOORD_0": file.add(flipped(uv_at(SQUARE)).astype("<f4"))}
    file.attributes |= {"COLOR_0": file.add(color_at(SQUARE).astype("<f4"))}
    mesh = concatenate(read_glb(file.glb(), wanted=BOTH))
    assert mesh.faces[0].tolist() == [0, 2, 1]
    assert aligned(mesh, mesh.vertices[mesh.faces] * [-1, 1, 1])


def test_glb_attributes_of_another_length_or_type_are_refused():
    short = square_with(TEXCOORD_0=(np.zeros((3, 2), "<f4"), {})).glb()
    with pytest.raises(ValueError, match="4 vertices have 3 rows of TEXCOORD_0"):
        read_glb(short, wanted=BOTH)
    assert len(read_glb(short, wanted=COLOR)) == 1
    wide = square_with(TEXCOORD_0=(np.zeros((4, 3), "<f4"), {})).glb()
    with pytest.raises(ValueError, match="does not have the type that its use needs"):
        read_glb(wide, wanted=UV)


# Meshes of programs, and other formats --------------------------------------------------------------------------------


def test_a_trimesh_with_uv_or_colours():
    box = trimesh.creation.box()
    assert read_given(box, BOTH)[5:8] == ((), None, None)
    box.visual = trimesh.visual.TextureVisuals(uv=uv_at(box.vertices))
    np.testing.assert_array_equal(read_given(box, BOTH).uv, uv_at(box.vertices[box.faces]))
    assert read_given(box).uv is None
    colours = np.arange(32, dtype=np.uint8).reshape(8, 4) * 8
    box = trimesh.creation.box()
    box.visual.vertex_colors = colours
    np.testing.assert_allclose(read_given(box, BOTH).colors, (colours[:, :3] / 255)[box.faces], rtol=1e-15)
    box = trimesh.creation.box()
    box.visual.face_colors = np.arange(48, dtype=np.uint8).reshape(12, 4)
    np.testing.assert_allclose(
        read_given(box, BOTH).colors[:, 1] * 255, np.arange(48).reshape(12, 4)[:, :3], rtol=1e-15
    )


def test_vertices_that_are_dropped_from_a_given_mesh_take_their_uv_along():
    points = np.array([[np.nan, 0, 0], [0, 0, 0], [1, 0, 0], [np.inf, 0, 0], [0, 1, 0]])
    mesh = SimpleNamespace(vertices=points, faces=[[1, 2, 4]], visual=SimpleNamespace(uv=np.arange(10.0).reshape(5, 2)))
    raw = read_given(mesh, UV)
    assert raw.faces.tolist() == [[0, 1, 2]]
    assert raw.uv.tolist() == [[[2, 3], [4, 5], [8, 9]]]
    mesh.visual.uv = np.zeros((4, 2))
    with pytest.raises(rt.SceneError, match=r"visual.uv: expected an array of 5 x 2 numbers, got shape \(4, 2\)"):
        read_given(mesh, UV)
    assert read_given((points, [[1, 2, 4]]), BOTH).uv is None


def test_uv_of_a_format_that_trimesh_reads(tmp_path):
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(uv=uv_at(box.vertices))
    (tmp_path / "a.dae").write_bytes(box.export(file_type="dae"))
    mesh = read_mesh(tmp_path / "a.dae", wanted=BOTH)
    np.testing.assert_allclose(mesh.uv, uv_at(mesh.vertices[mesh.faces]), atol=1e-6)
    assert read_mesh(tmp_path / "a.dae").uv is None


# Turned, joined -------------------------------------------------------------------------------------------------------


def triangle(uv=True, colors=True):
    raw = RawMesh(
        np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]]), np.array([[0, 1, 2], [3, 1, 0]]), None, None
    )
    points = raw.vertices[raw.faces]
    return raw._replace(uv=uv_at(points) if uv else None, colors=color_at(points) if colors else None)


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (-1, -1, -1)])
def test_triangles_that_are_turned_round_keep_the_uv_of_their_corners(scale):
    raw = transform(triangle(), np.diag(np.array(scale, float)), np.array([1.0, 2, 3]))
    assert aligned(raw, (raw.vertices[raw.faces] - [1, 2, 3]) / scale)
    back = turned_round(raw)
    assert back.faces.tolist() != raw.faces.tolist()
    assert aligned(back, (back.vertices[back.faces] - [1, 2, 3]) / scale)


def test_meshes_without_attributes_have_nan_where_others_have_some():
    joined = concatenate([triangle(colors=False), triangle(uv=False, colors=False), triangle(colors=False)])
    assert joined.colors is None
    np.testing.assert_array_equal(joined.uv[:2], joined.uv[4:])
    assert np.isnan(joined.uv[2:4]).all()
    assert np.isfinite(joined.uv[:2]).all()
    assert concatenate([triangle(False, False)] * 2).uv is None


# In a scene -----------------------------------------------------------------------------------------------------------

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 2 0\nvt 2 3\nvt 0 3\nf 1/1 2/2 3/3 4/4\n"


def two_materials(*objects):
    materials = {name: {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]} for name in ("white", "floor", "baked")}
    return scene(materials=materials, objects=list(objects))


@pytest.fixture
def needs(monkeypatch):
    monkeypatch.setattr(assemble, "needed", lambda _: {"floor": {"uv"}, "baked": {"color"}})


def loaded(folder, *objects):
    (folder / "quad.obj").write_text(QUAD)
    return rt.load(write(folder, two_materials(*objects)))


def test_a_scene_whose_materials_need_none_has_none_and_the_same_hash(tmp_path, needs):
    made = loaded(tmp_path, {"mesh": "quad.obj", "material": "white"})
    assert made.mesh.uv is made.mesh.colors is None
    (tmp_path / "quad.obj").write_text(QUAD.replace("vt 2 3", "vt 2 wrong"))  # is not even read
    again = rt.load(tmp_path / "scene.json")
    assert fingerprint(again) == fingerprint(made)


def test_a_scene_that_needs_none_imports_nothing_for_them(tmp_path):
    write(tmp_path, scene(objects=[{"mesh": name, "material": "white"} for name in ("triangle.obj", "a.ply", "a.glb")]))
    (tmp_path / "a.ply").write_bytes(ply("ascii", ["s", "t"], ["f4", "f4"], uv_at(PYRAMID)))
    (tmp_path / "a.glb").write_bytes(square_with(TEXCOORD_0=(np.zeros((4, 2), "<f4"), {})).glb())
    lazy = ["ply_corners", "glb_corners", "glb_materials", "visual", "file_materials", "shape_uv", "textures", "texels"]
    program = "import sys, raytrace as rt; rt.load(sys.argv[1]); print(*(n.rpartition('.')[2] for n in sys.modules))"
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path / "scene.json")], capture_output=True, text=True)
    assert "assemble" in done.stdout.split(), done.stderr
    assert not {*lazy} & {*done.stdout.split()}


def test_the_joined_mesh_has_rows_for_all_objects(tmp_path, needs):
    made = loaded(
        tmp_path,
        {"mesh": "triangle.obj", "material": "white"},
        {"mesh": "quad.obj", "material": "floor", "scale": [-2, 1, 1], "rotate": {"axis": [0, 0, 1], "angle": 90}},
        {"rectangle": {}, "material": "white"},
        {"rectangle": {}, "material": "floor", "flip": True},
    )
    mesh = made.mesh
    assert mesh.uv.shape == (7, 3, 2)
    assert mesh.colors is None
    assert np.isnan(mesh.uv[:1]).all()
    assert np.isnan(mesh.uv[3:5]).all()
    x, y, _ = mesh.vertices[mesh.faces[1:3]].transpose(2, 0, 1)  # (x, y) of the file went to (-y, -2 x)
    np.testing.assert_array_equal(mesh.uv[1:3], np.stack([-y, -3 * x], axis=2))
    np.testing.assert_array_equal(mesh.uv[5:], (mesh.vertices[mesh.faces[5:]][:, :, :2] + 1) / 2)


def test_a_mesh_that_two_materials_share_is_read_once_with_what_both_need(tmp_path, needs, monkeypatch):
    read = []
    monkeypatch.setattr(assemble, "read_mesh", lambda *args: read.append(args) or read_mesh(*args))
    colours = re.sub(r"(?m)^(v .*)$", r"\1 0.5 0.25 1", QUAD)
    monkeypatch.setattr(sys.modules[__name__], "QUAD", colours)
    made = loaded(
        tmp_path,
        {"mesh": "quad.obj", "material": "white"},
        {"mesh": "quad.obj", "material": "baked"},
        {"mesh": "quad.obj", "material": "floor"},
    )
    assert len(read) == 1
    assert np.isfinite(made.mesh.uv[4:]).all()
    assert np.isfinite(made.mesh.colors[2:4]).all()


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        (
            {"mesh": "triangle.obj", "material": "floor"},
            'objects[0].mesh: triangle.obj: no texture coordinates (uv), which the material "floor" needs; export',
        ),
        (
            {"mesh": "quad.obj", "material": "baked"},
            'objects[0].mesh: quad.obj: no vertex colours, which the material "baked" needs; use a mesh that has them',
        ),
        (
            {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "baked"},
            "objects[0].sphere: sphere: no vertex col",
        ),
        (
            {"mesh": "part.obj", "material": "floor"},
            'objects[0].mesh: part.obj: no texture coordinates (uv) for 1 of 3 triangles, which the material "floor"',
        ),
    ],
)
def test_a_mesh_without_what_its_material_needs_is_named(tmp_path, needs, entry, told):
    (tmp_path / "part.obj").write_text(QUAD + "f 1 2 3\n")
    with pytest.raises(rt.SceneError) as caught:
        loaded(tmp_path, entry)
    (line,) = caught.value.problems
    assert told in line


def test_meshes_of_programs_in_a_scene(needs):
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(uv=uv_at(box.vertices))
    made = rt.load(two_materials({"mesh": box, "material": "floor"}))
    np.testing.assert_array_equal(made.mesh.uv, uv_at(made.mesh.vertices[made.mesh.faces]))
    plain = box.vertices, box.faces
    with pytest.raises(rt.SceneError, match="mesh 0: no texture coordinates"):
        rt.load(two_materials({"mesh": plain, "material": "floor"}))
