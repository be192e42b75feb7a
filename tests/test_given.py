"""Meshes that a program gives: to ``BVH``, and in scenes that are dicts."""

import pickle
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import raytrace as rt
from raytrace.scene.meshes.given import is_mesh
from scene_files import scene, write

ROOT = Path(__file__).parents[1]
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64), np.array([[0, 1, 2], [0, 2, 3]])
MESH = SimpleNamespace(vertices=SQUARE[0], faces=SQUARE[1])


def as_dict(mesh, *more, **changes):
    return scene(objects=[{"mesh": each, "material": "white", **changes} for each in (mesh, *more)])


def refused(mesh):
    with pytest.raises(rt.SceneError) as caught:
        rt.load(as_dict(mesh))
    (line,) = caught.value.problems
    assert line.startswith("scene: objects[0].mesh: ")
    return line.removeprefix("scene: objects[0].mesh: ")


@pytest.mark.parametrize(
    "mesh",
    [
        SQUARE,
        list(SQUARE),
        (SQUARE[0].tolist(), SQUARE[1].tolist()),
        (SQUARE[0].astype(np.float32), SQUARE[1].astype(np.uint16)),
        (SQUARE[0].astype(int), SQUARE[1].astype(np.int32)),
        SimpleNamespace(vertices=SQUARE[0], faces=SQUARE[1]),
    ],
    ids=["arrays", "list", "lists", "small types", "integers", "object"],
)
def test_a_dict_may_hold_meshes(mesh):
    given = rt.load(as_dict(mesh, scale=2, translate=(0, 0, 1)))
    assert given.mesh.vertices.tolist() == (2 * SQUARE[0] + [0, 0, 1]).tolist()
    assert given.mesh.faces.tolist() == SQUARE[1].tolist()
    assert given.objects == ("mesh",)
    assert given.warnings == ()


def test_a_trimesh_is_the_file_that_it_came_from(tmp_path, monkeypatch):
    import trimesh

    write(tmp_path, scene())
    monkeypatch.chdir(tmp_path)
    file = rt.load(as_dict("cube.obj")).mesh
    mesh = trimesh.Trimesh(file.vertices, file.faces, process=False)
    for normals in ("flat", "smooth"):
        given, read = rt.load(as_dict(mesh, normals=normals)), rt.load(as_dict("cube.obj", normals=normals))
        corners = [loaded.mesh.vertices[loaded.mesh.faces] for loaded in (given, read)]
        np.testing.assert_array_equal(*corners)
    picture = rt.render(as_dict(mesh), spp=1, size=(16, 16), progress=False)
    np.testing.assert_array_equal(picture.rgb, rt.render(as_dict("cube.obj"), spp=1, size=(16, 16), progress=False).rgb)


def test_meshes_count_in_the_hash_and_stay_as_they_were():
    vertices, faces = SQUARE[0].copy(), SQUARE[1].copy()
    first = rt.load(as_dict((vertices, faces)))
    assert first.sha256 == rt.load(as_dict((vertices.tolist(), faces.tolist()))).sha256
    vertices[0, 0] = faces[0, 0] = 3
    assert first.mesh.vertices.tolist() == SQUARE[0].tolist()
    assert first.mesh.faces.tolist() == SQUARE[1].tolist()
    assert rt.load(as_dict((vertices, SQUARE[1]))).sha256 != first.sha256
    again = pickle.loads(pickle.dumps(first))
    assert again.sha256 == first.sha256
    np.testing.assert_array_equal(again.mesh.vertices, first.mesh.vertices)


def test_meshes_stand_beside_files_and_have_numbers(tmp_path, monkeypatch):
    write(tmp_path, scene())
    monkeypatch.chdir(tmp_path)
    content = as_dict(SQUARE, "cube.obj", SQUARE, (2 * SQUARE[0], SQUARE[1]), Path("triangle.obj"))
    loaded = rt.load(content)
    assert loaded.objects == ("mesh", "cube.obj", "mesh (2)", "mesh (3)", "triangle.obj")
    assert content["objects"][0]["mesh"] is SQUARE  # the dict is the caller's
    assert len(loaded.mesh.faces) == 2 + 12 + 2 + 2 + 1
    assert loaded.mesh.vertices[-4].tolist() == [0, 2, 0]


def test_precision_plan_and_pictures_are_as_for_files():
    large = as_dict((SQUARE[0] + 1e6, SQUARE[1]))
    assert rt.explain(large).precision.name == "float64"
    assert rt.explain(as_dict(SQUARE)).precision.name == "float32"
    assert "2 triangles in 1 object" in str(rt.explain(as_dict(SQUARE)))


@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        ((SQUARE[0][:, :2], SQUARE[1]), "vertices: expected an (n, 3) array, got shape (4, 2)"),
        (
            (SQUARE[0], [[0, 1, 2, 3]]),
            "faces: expected an (n, 3) array, got shape (1, 4); split the quads into triangles",
        ),
        ((SQUARE[0], SQUARE[1].astype(float)), "faces: expected integers, got dtype float64"),
        ((SQUARE[0], SQUARE[1] + 2), "faces: row 0 is [2, 3, 4], but there are 4 vertices, numbered from 0"),
        ((SQUARE[0], SQUARE[1] - 1), "faces: row 0 is [-1, 0, 1], but there are 4 vertices, numbered from 0"),
        ((SQUARE[0], np.empty((0, 3), int)), "no triangles in it"),
        ((SQUARE[0] * np.nan, SQUARE[1]), "vertices: row 0 is not finite: [nan, nan, nan]"),
        ((SQUARE[0].astype(str), SQUARE[1]), "vertices: expected numbers, got dtype "),
        (([[0, 0], [1]], SQUARE[1]), "vertices: expected rows of 3 numbers: "),
        ((np.ma.masked_less(SQUARE[0], 1), SQUARE[1]), "vertices: some elements are masked; fill them"),
        (
            (SQUARE[0],),
            "expected a path, a mesh with vertices and faces, or (vertices, faces); got a tuple of 1",
        ),
        (SQUARE[0], "expected a path, a mesh with vertices and faces, or (vertices, faces); got a ndarray"),
        (b"box.obj", "expected a path, a mesh with vertices and faces, or (vertices, faces); got a bytes"),
    ],
)
def test_a_broken_mesh_is_one_clear_line(mesh, told):
    assert refused(mesh).startswith(told)


def test_a_scene_of_trimesh_is_no_mesh():
    import trimesh

    assert refused(trimesh.Scene()).endswith("got a Scene; use scene.to_mesh()")
    assert "got a PointCloud" in refused(trimesh.PointCloud(SQUARE[0]))


def test_what_no_triangle_uses_does_not_count():
    vertices = np.vstack([[[np.nan, 0, 0], [np.inf, 0, 0]], SQUARE[0]])
    loaded = rt.load(as_dict((vertices, SQUARE[1] + 2)))
    assert loaded.mesh.vertices[loaded.mesh.faces].tolist() == SQUARE[0][SQUARE[1]].tolist()


def test_all_problems_come_at_once_and_a_name_is_no_way_to_a_mesh(tmp_path):
    broken = as_dict(SQUARE, "nowhere.obj", (SQUARE[0], []))
    with pytest.raises(rt.SceneError) as caught:
        rt.load(broken)
    assert [line.split(": ")[1] for line in caught.value.problems] == ["objects[1].mesh", "objects[2].mesh"]
    broken["camera"]["fov"] = -1
    with pytest.raises(rt.SceneError) as caught:
        rt.load(broken)
    assert [line.split(": ")[1] for line in caught.value.problems] == ["camera.fov", "objects[1].mesh"]
    with pytest.raises(rt.FileError, match="no such file"):
        rt.load(write(tmp_path, as_dict("\0mesh 0")))


def test_what_is_meant_as_a_mesh():
    assert [is_mesh(value) for value in ("a.obj", Path("a.obj"), 7, 1.5, None, True, {})] == [False] * 7
    assert refused_type(7) == "scene: objects[0].mesh: expected a string, got 7"


def refused_type(mesh):
    with pytest.raises(rt.SceneError) as caught:
        rt.load(as_dict(mesh))
    return str(caught.value)


# ---- BVH -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_tree_of_a_mesh_is_that_of_its_arrays(precision):
    import trimesh

    mesh = trimesh.creation.icosphere(2)
    rng = np.random.default_rng(1)
    rays = rng.normal(size=(100, 3)), rng.normal(size=(100, 3))
    one, two = rt.BVH(mesh, precision=precision), rt.BVH(mesh.vertices, mesh.faces, precision)
    for found, expected in zip(one.closest_hit(*rays), two.closest_hit(*rays), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert type(one.vertices) is type(one.faces) is np.ndarray
    assert rt.BVH(SimpleNamespace(vertices=SQUARE[0], faces=SQUARE[1])).closest_hit([0.5, 0.2, 1], [0, 0, -1]).t == 1


def test_a_tree_needs_both_arrays():
    mesh = SimpleNamespace(vertices=SQUARE[0], faces=SQUARE[1])
    with pytest.raises(
        ValueError, match="faces: missing; pass vertices and faces, or one mesh that has both, got a nd"
    ):
        rt.BVH(SQUARE[0])
    with pytest.raises(ValueError, match="faces: the first argument is a mesh, which has its own faces; omit them"):
        rt.BVH(mesh, SQUARE[1])
    with pytest.raises(ValueError, match="faces: row 0 is"):
        rt.BVH(SimpleNamespace(vertices=SQUARE[0], faces=SQUARE[1] + 9))


def test_arrays_need_no_trimesh():
    program = """
import sys, raytrace as rt
square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
scene = {
    "camera": {"position": [0, 0, 3], "look_at": [0, 0, 0], "fov": 40},
    "materials": {"white": {"type": "diffuse", "albedo": [0.7, 0.7, 0.7]}},
    "objects": [{"mesh": square, "material": "white"}],
}
rt.load(scene)
rt.BVH(*square)
assert not {"trimesh"} & sys.modules.keys()
"""
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT, timeout=120)


@pytest.mark.parametrize(
    ("objects", "text"),
    [
        (
            [MESH],
            'a SimpleNamespace cannot be written as JSON; a mesh in memory is the "mesh" of an object: {"mesh": ..., ',
        ),
        ([{"box": MESH, "material": "m"}], "a SimpleNamespace cannot be written as JSON; a mesh in memory is the"),
        ([{"mesh": {"vertices": [], "faces": []}}], "objects[0].mesh: a dict; write (vertices, faces), two arrays"),
    ],
)
def test_meshes_in_the_wrong_place_say_where_they_belong(objects, text):
    with pytest.raises(rt.SceneError, match=re.escape(f"scene: {text}")):
        rt.load({"objects": objects})
