"""Mesh files to triangles, and triangles to the world."""

import gzip
import io
import warnings

import numpy as np
import pytest

from raytrace.errors import FileError, SceneError
from raytrace.records import RawMesh
from raytrace.scene import files
from raytrace.scene.load import load
from raytrace.scene.meshes import reading
from raytrace.scene.meshes.obj import read_obj
from raytrace.scene.meshes.raw_mesh import concatenate, transform
from raytrace.scene.meshes.reading import read_mesh
from raytrace.scene.normals import averaged_normals, face_normals
from raytrace.scene.transforms import rotation
from scene_files import CUBE, TRIANGLE, scene, triangle_glb, write

PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
1 1 0
0 1 0
3 0 1 2
3 0 2 3
"""
QUAD = {"vertices": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "faces": [[0, 1, 2], [0, 2, 3]]}


def save(tmp_path, name: str, content: str | bytes):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def binary(export: str, **normals) -> bytes:
    import trimesh

    mesh = trimesh.Trimesh(**QUAD, process=False, **normals)
    return mesh.export(file_type=export)


def problem(path) -> str:
    with pytest.raises(SceneError) as caught:
        read_mesh(path)
    assert len(caught.value.problems) == 1
    assert "\n" not in caught.value.problems[0]
    assert caught.value.problems[0].startswith(str(path))
    return caught.value.problems[0].removeprefix(str(path))


def outcome(path) -> tuple[str, RawMesh | None]:
    try:
        return "", read_mesh(path)
    except (SceneError, FileError) as error:
        return str(error), None


def corners(mesh: RawMesh) -> np.ndarray:
    return mesh.vertices[mesh.faces]


def test_every_format_gives_the_same_triangles(tmp_path):
    expected = np.array(QUAD["vertices"], np.float64)[QUAD["faces"]]
    obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
    contents = {
        "a.obj": obj,
        "B.OBJ": obj,
        "a.obj.gz": gzip.compress(obj.encode()),
        "a.ply": PLY,
        "b.ply": binary("ply"),
        "b.ply.gz": gzip.compress(binary("ply")),
        "c.ply": PLY.replace("element face 2", "element face 1").replace("3 0 1 2\n3 0 2 3", "4 0 1 2 3"),
        "a.stl": binary("stl"),
        "b.stl": binary("stl_ascii"),
        "a.glb": binary("glb"),
    }
    for name, content in contents.items():
        mesh = read_mesh(save(tmp_path, name, content))
        np.testing.assert_array_equal(corners(mesh), expected, err_msg=name)
        assert mesh.vertices.dtype == np.float64
        assert mesh.faces.dtype == np.int64
        assert mesh.normals is None, name


def test_obj_reader_agrees_with_trimesh(tmp_path):
    from trimesh.exchange.obj import load_obj

    rng = np.random.default_rng(3)
    points, normals = rng.normal(size=(2, 50, 3))
    rows = rng.integers(1, 51, size=(80, 3))
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    text += "".join(f"vn {x!r} {y!r} {z!r}\n" for x, y, z in normals.tolist())
    text += "".join(f"f {a}//{c} {b}//{b} {c}//{a}\n" for a, b, c in rows.tolist())
    ours = read_obj(text.encode())
    with warnings.catch_warnings(action="ignore"):
        theirs = next(iter(load_obj(io.BytesIO(text.encode()))["geometry"].values()))
    np.testing.assert_array_equal(corners(ours), theirs["vertices"][theirs["faces"]])
    np.testing.assert_array_equal(ours.normals[ours.normal_faces], theirs["vertex_normals"][theirs["faces"]])


@pytest.mark.parametrize(
    "text",
    [
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 9 9 9\n",  # counted back from the vertices so far
        "f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n",
        "v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n",
        "v\t0 0 0 # first\n  v 1 0 0\nv 0 1 \\\n 0\nf 1 2 \\\n3 # all",
        "v 0 0 0 1 0 0\nv 1 0 0 1\nv 0 1 0\nf 1/1 2 3//\n",
        "mtllib none.mtl\no x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl y\ns off\nl 1 2\nf 1/1 2/1 3/1\n",
        "#v 7 7 7\nv 0 0 0\nv 1 0 0\nv 0 1 0\n#\ng a\nf 1 2 3",
    ],
    ids=["relative", "forward", "crlf", "irregular", "weights", "materials", "comments"],
)
def test_obj_spellings_give_the_same_triangle(text):
    assert corners(read_obj(text.encode())).tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


def test_obj_polygons_become_fans_of_their_own_size():
    points = "".join(f"v {i} {i * i} 0\n" for i in range(6))
    mesh = read_obj((points + "f 1 2 3 4 5\nf 4 5 6\nf 1 2 3 6\n").encode())
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [3, 4, 5], [0, 1, 2], [0, 2, 5]]


def test_obj_normals_follow_their_own_indices_and_may_lack():
    text = TRIANGLE.replace("f 1 2 3\n", "vn 0 0 1\nvn 1 0 0\nf 1//2 2//-2 3//1\nf 1 2//2 3/\n")
    mesh = read_obj(text.encode())
    assert mesh.normals.tolist() == [[0, 0, 1], [1, 0, 0]]
    assert mesh.normal_faces.tolist() == [[1, 0, 0], [-1, 1, -1]]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (TRIANGLE + "f 1 2 9\n", ":5: vertex 9 does not exist; the file has 3, counted from 1"),
        (TRIANGLE + "\nf 0 1 2\n", ":6: vertex 0 does not exist; the file has 3, counted from 1"),
        (TRIANGLE + "f -4 1 2\n", ":5: vertex -4 does not exist; the file has 3, counted from 1"),
        (TRIANGLE + "f 1 2\n", ":5: expected a face of at least 3 corners, got 2"),
        (TRIANGLE + "f 1 2 x\n", ":5: expected the index of a vertex, got 'x'"),
        (TRIANGLE + "f 1 2 3.5\n", ":5: expected the index of a vertex, got '3.5'"),
        (TRIANGLE + "f 1 2 99999999999999999999\n", ":5: expected the index of a vertex, got '99999999999999999999'"),
        (TRIANGLE + "f 1/2/3/4 1 2\n", ":5: expected a corner v, v/vt, v//vn or v/vt/vn, got '1/2/3/4'"),
        ("v 0 0\n" + TRIANGLE, ":1: expected 3 numbers, got 2"),
        ("v 0 0 zero\n" + TRIANGLE, ":1: expected a number, got 'zero'"),
        (TRIANGLE + "v 0 nan 0\nf 1 2 4\n", ":5: vertex 4 is not finite: [0.0, nan, 0.0]"),
        ("# x\nv 1e999 0 0\n" + TRIANGLE, ":2: vertex 1 is not finite: [inf, 0.0, 0.0]"),
        ("v 0 0 0\n", ": no triangles in it"),
        ("", ": no triangles in it"),
        (b"\x00\xff" * 50, ": no triangles in it"),
    ],
    ids=range(15),
)
def test_broken_obj_names_the_line(tmp_path, text, told):
    assert problem(save(tmp_path, "a.obj", text)).startswith(told)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.ply", PLY.replace("3 0 2 3", "3 0 2 7"), ": face row 1 uses vertices [0, 2, 7], but there are 4"),
        ("a.ply", PLY.replace("3 0 2 3", "3 0 2 -1"), ": face row 1 uses vertices [0, 2, -1], but there are 4"),
        ("a.ply", PLY.replace("1 1 0", "1 nan 0"), ": vertex row 2 is not finite: [1.0, nan, 0.0]"),
        ("a.ply", PLY[:-16], ": no complete PLY file: the file ends before row 0 of element face does"),
        ("a.ply", PLY[:60], ": no complete PLY file: the header has no end"),
        ("a.ply", "", ": no complete PLY file: the header has no end"),
        ("a.ply", PLY[: PLY.index("3 0 1 2")].replace("face 2", "face 0"), ": no triangles in it"),
        (
            "a.ply",
            PLY.replace("1 1 0", "1 x 0"),
            ": no complete PLY file: row 2 of element vertex: expected a number as y, got 'x'",
        ),
        (
            "a.ply",
            "format ascii\nelement vertex 1\nend_header\n1\n",
            ': no complete PLY file: the first line is not "ply"',
        ),
        ("a.stl", "solid x\nendsolid x\n", ": no "),
        ("a.stl", "", ": no "),
        ("a.glb", b"", ": no complete GLB file: the header announces 0 bytes, the file has 0"),
        ("a.glb", b"x" * 100, ": no complete GLB file: "),
        ("a.obj.gz", b"no gzip", ": broken or truncated gzip file: Not a gzipped file"),
        ("a.obj.gz", gzip.compress(TRIANGLE.encode())[:-9], ": broken or truncated gzip file: "),
        ("a.fbx", "", ": no mesh format that can be read (known: .obj, .ply, .stl, .glb, .gltf, .off, .3mf, "),
        ("a", "", ": no mesh format that can be read"),
        (".gz", "", ": no mesh format that can be read"),
    ],
    ids=range(18),
)
def test_broken_file_is_one_clear_line(tmp_path, name, content, told):
    assert problem(save(tmp_path, name, content)).startswith(told)


@pytest.mark.parametrize("kind", ["ply", "stl", "glb"])
def test_truncated_binary_file_is_one_clear_line_at_any_length(tmp_path, kind):
    whole = binary(kind)
    for length in np.random.default_rng(5).choice(len(whole), 40, replace=False):
        told = problem(save(tmp_path, f"a.{kind}", whole[:length]))
        assert told.startswith((f": no complete {kind.upper()} file: ", ": no triangles in it")), length


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
def test_damaged_file_never_gives_anything_but_a_mesh_or_a_clear_line(tmp_path, kind):
    whole = CUBE.encode() if kind == "obj" else binary(kind)
    rng = np.random.default_rng(6)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(len(whole), size=3):
            damaged[place] = rng.integers(256)
        path = save(tmp_path, f"a.{kind}", bytes(damaged))
        told, mesh = outcome(path)
        assert told.startswith(str(path) if mesh is None else "")
        assert "\n" not in told
        if mesh is not None:
            assert np.isfinite(mesh.vertices).all()
            assert mesh.faces.min() >= 0
            assert mesh.faces.max() < len(mesh.vertices)


def test_missing_file_directory_and_vast_file_are_file_errors(tmp_path, monkeypatch):
    save(tmp_path, "sphere.obj", TRIANGLE)
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(FileError, match=r'shpere\.obj: no such file; did you mean "sphere\.obj"\?'):
        read_mesh(tmp_path / "shpere.obj")
    with pytest.raises(FileError, match="a directory"):
        read_mesh(tmp_path / "folder.obj")
    with pytest.raises(FileError, match="can't be read"):
        read_mesh(tmp_path / ("a" * 5000))
    for module in (files, reading):
        monkeypatch.setattr(module, "MAX_MESH", 1000)
    with pytest.raises(FileError, match="more than 1000 bytes"):
        read_mesh(save(tmp_path, "vast.obj", "#" * 1001))
    with pytest.raises(FileError, match="unfolds to more than 1000 bytes"):
        read_mesh(save(tmp_path, "vast.obj.gz", gzip.compress(b"#" * 1001)))
    read_mesh(save(tmp_path, "large.obj", TRIANGLE + "#" * (1000 - len(TRIANGLE))))


def test_several_parts_of_a_file_become_one_mesh(tmp_path):
    text = CUBE + "o other\nv 5 5 5\nv 6 5 5\nv 5 6 5\nf -3 -2 -1\n"
    assert read_mesh(save(tmp_path, "a.obj", text)).faces.shape == (13, 3)
    solids = binary("stl_ascii") * 2
    assert read_mesh(save(tmp_path, "a.stl", solids)).faces.shape == (4, 3)


def test_glb_nodes_are_placed_by_their_whole_chain_of_transforms(tmp_path):
    half = float(np.sqrt(0.5))
    nodes = [
        {"children": [1, 3], "translation": [10, 0, 0]},
        {"children": [2], "rotation": [0, 0, half, half]},  # a quarter turn about z
        {"mesh": 0, "translation": [1, 0, 0], "scale": [2, 2, 2]},
        {"mesh": 0},
    ]
    mesh = read_mesh(save(tmp_path, "a.glb", triangle_glb(nodes)))
    found = {tuple(np.round(triangle, 12).ravel() + 0.0) for triangle in corners(mesh)}
    assert found == {(10, 1, 0, 10, 3, 0, 8, 1, 0), (10, 0, 0, 11, 0, 0, 10, 1, 0)}


def test_glb_node_that_mirrors_keeps_the_front_outside(tmp_path):
    mesh = read_mesh(save(tmp_path, "a.glb", triangle_glb([{"mesh": 0, "scale": [-1, 1, 1]}], normals=True)))
    assert face_normals(mesh).tolist() == [[0, 0, 1]]
    assert mesh.normals[mesh.normal_faces].tolist() == [[[0, 0, 1]] * 3]


def test_glb_that_needs_an_unknown_extension_names_it(tmp_path):
    data = triangle_glb([{"mesh": 0}], extensionsRequired=["KHR_draco_mesh_compression", "KHR_materials_ior"])
    assert "not supported: KHR_draco_mesh_compression; export it without" in problem(save(tmp_path, "a.glb", data))


def test_vertex_normals_of_ply_and_glb_are_kept(tmp_path):
    tilted = np.array([[0, 0, 1], [0, 1, 1], [1, 0, 1], [1, 1, 1]]) / np.sqrt([[1], [2], [2], [3]])
    for kind in ("ply", "glb"):
        mesh = read_mesh(save(tmp_path, f"a.{kind}", binary(kind, vertex_normals=tilted)))
        np.testing.assert_allclose(mesh.normals[mesh.normal_faces], tilted[QUAD["faces"]], atol=1e-7)  # float32 files


def test_concatenation_keeps_corners_without_normals_apart():
    plain = RawMesh(np.eye(3), np.array([[0, 1, 2]]), None, None)
    shaded = RawMesh(np.eye(3), np.array([[0, 1, 2]]), np.eye(3), np.array([[2, -1, 0]]))
    joined = concatenate([shaded, plain, shaded])
    assert joined.normal_faces.tolist() == [[2, -1, 0], [-1, -1, -1], [5, -1, 3]]
    assert joined.faces.tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]


def cube(tmp_path, normals: str = "flat", **entry) -> RawMesh:
    objects = [{"mesh": "cube.obj", "material": "white", "normals": normals, **entry}]
    return load(write(tmp_path, scene(objects=objects))).mesh


def volume(mesh) -> float:
    v0, v1, v2 = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float((v0 * np.cross(v1, v2)).sum() / 6)


def test_objects_are_scaled_then_rotated_then_translated(tmp_path):
    turn = {"axis": [0, 0, 2], "angle": 90}
    mesh = cube(tmp_path, scale=[2, 1, 1], rotate=turn, translate=[5, 0, 0])
    assert mesh.vertices.min(axis=0).tolist() == [4, 0, 0]
    assert mesh.vertices.max(axis=0).tolist() == [5, 2, 1]


@pytest.mark.parametrize("scale", [2, [1, 2, 3], -1, [-1, 1, 1], [-1, -2, 1], [1, 1, -0.5]])
def test_mirrored_objects_keep_their_front_outside(tmp_path, scale):
    expected = abs(np.prod(np.broadcast_to(scale, 3)))
    mesh = cube(tmp_path, "smooth", scale=scale, rotate={"axis": [1, 2, 3], "angle": 40})
    assert volume(mesh) == pytest.approx(expected, rel=1e-14)
    ng = face_normals(RawMesh(mesh.vertices, mesh.faces, None, None))
    assert ((mesh.normals * ng[:, None]).sum(axis=2) > 0.2).all()


def test_quarter_turns_about_the_axes_are_exact():
    for axis in np.eye(3):
        for angle in range(-720, 721, 90):
            matrix = rotation(axis, angle)
            assert set(np.unique(matrix)) <= {-1.0, 0.0, 1.0}
            small = rotation(axis, np.nextafter(angle, np.inf))
            np.testing.assert_allclose(matrix, small, atol=1e-12)  # a step of 1e-13 degrees, and libm's rounding


def test_rotation_keeps_the_axis_and_turns_by_the_angle():
    axis = np.array([1.0, -2.0, 0.5])
    matrix = rotation(axis * 1e200, 33)
    np.testing.assert_allclose(matrix @ axis, axis, rtol=1e-14)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
    assert np.trace(matrix) == pytest.approx(1 + 2 * np.cos(np.radians(33)), rel=1e-14)


def test_normals_of_a_stretched_mesh_stay_perpendicular():
    rng = np.random.default_rng(8)
    for _ in range(20):
        linear = rng.normal(size=(3, 3))
        raw = RawMesh(rng.normal(size=(3, 3)), np.array([[0, 1, 2]]), None, None)
        raw = raw._replace(normals=face_normals(raw), normal_faces=np.zeros((1, 3), np.int64))
        mapped = transform(raw, linear, np.zeros(3))
        n = mapped.normals[0] / np.linalg.norm(mapped.normals[0])
        np.testing.assert_allclose(n, face_normals(mapped)[0], atol=1e-9)  # random maps are conditioned up to 1e4


def test_smooth_normals_average_the_faces_by_their_angles(tmp_path):
    mesh = cube(tmp_path, "smooth")
    centred = mesh.vertices[mesh.faces] - 0.5
    # three right angles meet in each corner of a cube, whatever the diagonals of its sides
    np.testing.assert_allclose(mesh.normals, centred / np.sqrt(0.75), atol=1e-15)


def test_smooth_normals_join_vertices_at_the_same_position():
    apart = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = RawMesh(apart, np.array([[0, 1, 2], [3, 4, 5]]), None, None)
    ns = averaged_normals(mesh, face_normals(mesh))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(ns[0], [[half, 0, half], [0, 0, 1], [half, 0, half]], atol=1e-15)


def test_smooth_uses_the_files_normals_and_mends_those_without_length(tmp_path):
    (tmp_path / "n.obj").write_text(TRIANGLE.replace("f 1 2 3", "vn 0 3 4\nvn 0 0 0\nvn nan 0 0\nf 1//1 2//2 3//3"))
    objects = [{"mesh": "n.obj", "material": "white", "normals": "smooth"}]
    mesh = load(write(tmp_path, scene(objects=objects))).mesh
    np.testing.assert_allclose(mesh.normals[0], [[0, 0.6, 0.8], [0, 0, 1], [0, 0, 1]], atol=1e-16)


def test_corners_without_a_normal_are_averaged_where_others_have_one(tmp_path):
    (tmp_path / "n.obj").write_text(CUBE.replace("f 1 2 4 3\n", "vn -1 0 0\nf 1//1 2//1 4//1 3//1\n"))
    objects = [{"mesh": "n.obj", "material": "white", "normals": "smooth"}]
    mesh = load(write(tmp_path, scene(objects=objects))).mesh
    np.testing.assert_allclose(mesh.normals[:2].reshape(-1, 3), [[-1, 0, 0]] * 6)
    expected = (mesh.vertices[mesh.faces[2:]] - 0.5) / np.sqrt(0.75)
    np.testing.assert_allclose(mesh.normals[2:], expected, atol=1e-15)


def test_flat_objects_of_a_mixed_scene_have_their_face_normals(tmp_path):
    objects = [{"mesh": "cube.obj", "material": "white", "normals": kind} for kind in ("flat", "smooth")]
    mesh = load(write(tmp_path, scene(objects=objects))).mesh
    assert mesh.normals.shape == (24, 3, 3)
    assert mesh.normals.flags.c_contiguous
    ng = face_normals(RawMesh(mesh.vertices, mesh.faces, None, None))
    np.testing.assert_array_equal(mesh.normals[:12], np.repeat(ng[:12, None], 3, axis=1))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=2), 1, rtol=1e-15)


def test_triangles_without_area_have_a_unit_normal_all_the_same(tmp_path):
    (tmp_path / "n.obj").write_text("v 0 0 0\nv 1 1 1\nv 2 2 2\nv 0 1 0\nf 1 2 3\nf 1 2 4\n")
    for kind in ("flat", "smooth"):
        objects = [{"mesh": "n.obj", "material": "white", "normals": kind}, {"mesh": "cube.obj", "material": "white"}]
        objects[1]["normals"] = "smooth"
        mesh = load(write(tmp_path, scene(objects=objects))).mesh
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=2), 1, rtol=1e-15)


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1, 1e30, 1e70])
def test_face_normals_and_their_mean_do_not_depend_on_the_scale(tmp_path, scale):
    mesh = cube(tmp_path, "smooth", scale=scale)
    np.testing.assert_allclose(mesh.normals, cube(tmp_path, "smooth").normals, atol=1e-15)


def test_normals_that_point_to_the_back_are_a_warning(tmp_path):
    (tmp_path / "n.obj").write_text(TRIANGLE.replace("f 1 2 3", "vn 0 0 -1\nf 1//1 2//1 3//1"))
    objects = [{"mesh": "n.obj", "material": "white", "normals": "smooth"}]
    warnings = load(write(tmp_path, scene(objects=objects))).warnings
    assert len(warnings) == 1
    assert "n.obj: the normals of 1 of 1 triangles point to their back" in warnings[0]
