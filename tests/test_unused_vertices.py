"""Vertices that no face uses: no say in whether a mesh renders, where it lies, or in which precision."""

import numpy as np
import pytest

from raytrace.errors import SceneError
from raytrace.records import RawMesh
from raytrace.scene.load import load
from raytrace.scene.meshes.raw_mesh import quiet_unused
from raytrace.scene.precision import choose_precision
from scene_files import glb, scene

pytestmark = pytest.mark.nojit
FAR = [(np.nan,) * 3, (0, np.inf, 0), (3e38, 0, 0), (1e9, 0, 0), (0, -1e9, 0)]


def with_vertex(vertex, used=False):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], vertex], "<f4")
    corners = np.array([0, 1, 3 if used else 2], "<u4")
    vec3 = {"componentType": 5126, "count": 4, "type": "VEC3"}
    content = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 60}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "accessors": [
            {"bufferView": 0, **vec3},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
    }
    return glb(content, points.tobytes() + corners.tobytes())


def loaded(folder, data, **entry):
    (folder / "a.glb").write_bytes(data)
    return load(scene(objects=[{"mesh": folder / "a.glb", "material": "white", **entry}]))


@pytest.mark.parametrize("vertex", FAR)
@pytest.mark.parametrize("normals", ["flat", "smooth"])
def test_they_decide_nothing_in_a_glb(tmp_path, vertex, normals):
    found = loaded(tmp_path, with_vertex(vertex), normals=normals)
    plain = loaded(tmp_path, with_vertex((0, 0, 0)), normals=normals)
    assert choose_precision(found) == choose_precision(plain)
    np.testing.assert_array_equal(found.mesh.vertices, plain.mesh.vertices)
    assert found.sha256 == plain.sha256


@pytest.mark.parametrize("vertex", FAR[:2])
def test_one_that_is_used_must_be_finite(tmp_path, vertex):
    with pytest.raises(SceneError, match="vertex row 3 is not finite"):
        loaded(tmp_path, with_vertex(vertex, used=True))


@pytest.mark.parametrize(
    "entry", [{"scale": 1e40}, {"rotate": {"axis": [1, 2, 3], "angle": 33}}, {"translate": [5, 5, 5]}]
)
def test_they_decide_nothing_wherever_an_object_is_placed(tmp_path, entry):
    for vertex in FAR:
        mesh = loaded(tmp_path, with_vertex(vertex), **entry).mesh
        low, high = (bound(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0) for bound in (np.min, np.max))
        assert ((mesh.vertices >= low) & (mesh.vertices <= high)).all()


def test_a_mesh_without_unused_vertices_is_the_same_object():
    mesh = RawMesh(np.eye(3), np.array([[0, 1, 2]]), None, None)
    assert quiet_unused(mesh) is mesh
    inside = RawMesh(np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [1, 1, 0.0]]), np.array([[0, 1, 2]]), None, None)
    assert quiet_unused(inside) is inside
