"""Skins of glTF files: meshes where their joints put them."""

import math

import numpy as np
import pytest

from gltf_files import FIRST, SQUARE, File, read, skinned
from raytrace.scene.meshes.glb import read_glb


def shift(x, y, z):
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


@pytest.mark.parametrize("kind", ["u1", "<u2"])
def test_a_skin_puts_a_mesh_where_its_joint_is_and_not_where_its_node_is(kind):
    file = skinned(FIRST[0].astype(kind), FIRST[1], {"translation": [10, 0, 0]})
    file.node |= {"translation": [0, 50, 0], "scale": [7, 7, 7]}
    assert read(file).vertices.tolist() == (SQUARE + [10, 0, 0]).tolist()


def test_joints_stand_in_a_tree_and_are_bound_where_they_were():
    nodes = {"children": [2], "translation": [0, 5, 0]}, {"rotation": [0, 0, math.sqrt(0.5), math.sqrt(0.5)]}
    file = skinned(np.array([1, 0, 0, 0], "u1"), FIRST[1], *nodes, binds=[shift(0, 0, 0), shift(-1, 0, 0)])
    file.json["scenes"][0]["nodes"] = [0, 1]
    # a turn by 90 degrees about (1, 0), then up by 5
    expected = np.array([[0, 4, 0], [0, 5, 0], [-1, 5, 0], [-1, 4, 0]])
    np.testing.assert_allclose(read(file).vertices, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("weights", "more"),
    [
        (np.array([0.25, 0.75, 0, 0], "<f4"), {}),
        (np.array([64, 192, 0, 0], "u1"), {"normalized": True}),
        (np.array([16384, 49152, 0, 0], "<u2"), {"normalized": True}),
        (np.array([1, 3, 0, 0], "<f4"), {}),  # of another sum than 1
    ],
    ids=["float", "uint8", "uint16", "of any sum"],
)
def test_weights_mix_the_joints(weights, more):
    file = skinned(np.array([0, 1, 9, 9], "u1"), weights, {"translation": [4, 0, 0]}, {"translation": [0, 0, 8]})
    file.json["accessors"][file.attributes["WEIGHTS_0"]] |= more
    np.testing.assert_allclose(read(file).vertices, SQUARE + [1, 0, 6], rtol=1e-12, atol=1e-12)


def test_more_than_four_joints_come_in_sets():
    nodes = [{"translation": [x, 0, 0]} for x in (0, 0, 0, 0, 12)]
    file = skinned(np.array([0, 1, 2, 3], "u1"), np.array([0.125, 0.125, 0.25, 0], "<f4"), *nodes)
    file.attributes["JOINTS_1"] = file.add(np.array([[4, 0, 0, 0]] * 4, "u1"))
    file.attributes["WEIGHTS_1"] = file.add(np.array([[0.5, 0, 0, 0]] * 4, "<f4"))
    assert read(file).vertices.tolist() == (SQUARE + [6, 0, 0]).tolist()


def test_several_skins_pose_one_mesh_several_times():
    file = skinned(*FIRST, {"translation": [10, 0, 0]}, {"translation": [0, 20, 0]})
    file.json["nodes"].append({"mesh": 0, "skin": 1})
    file.json["scenes"][0]["nodes"].append(3)
    file.json["skins"] = [{"joints": [1]}, {"joints": [2]}]
    found = sorted(part.vertices[0].tolist() for part in read_glb(file.glb()))
    assert found == [[0, 20, 0], [10, 0, 0]]


def test_normals_follow_their_joints_and_mirrors_turn_triangles_round():
    file = skinned(*FIRST, {"scale": [1, 2, -1], "rotation": [math.sqrt(0.5), 0, 0, math.sqrt(0.5)]})
    file.attributes["NORMAL"] = file.add(np.array([[0, 0.6, 0.8]] * 4, "<f4"))
    mesh = read(file)
    a, b, c = mesh.vertices[mesh.faces[0]]
    front = np.cross(b - a, c - a)
    normal = mesh.normals[mesh.normal_faces[0, 0]]
    assert front @ normal > 0  # as in the file
    # scaled by the inverse, turned by 90 degrees about x: (0, 0.3, -0.8) -> (0, 0.8, 0.3)
    np.testing.assert_allclose(
        normal / np.linalg.norm(normal), np.array([0, 0.8, 0.3]) / math.hypot(0.8, 0.3), atol=1e-7
    )


def test_a_scene_of_skins_agrees_with_the_sum_written_out():
    rng = np.random.default_rng(5)
    count, joints = 300, 9
    nodes = [
        {"translation": rng.normal(size=3).tolist(), "rotation": rng.normal(size=4).tolist(), "scale": [1, 2, 0.5]}
        for _ in range(joints)
    ]
    for child in range(1, joints):
        nodes[int(rng.integers(child))].setdefault("children", []).append(1 + child)
    file = File(rng.normal(size=(count, 3)).astype("<f4"), rng.integers(0, count, 900).astype("<u2"))
    file.json["nodes"] += nodes
    file.json["scenes"][0]["nodes"] = [0, 1]
    file.node["skin"] = 0
    which, share = rng.integers(0, joints, (count, 4)), rng.uniform(size=(count, 4)).astype("<f4")
    binds = rng.normal(size=(joints, 4, 4)).astype("<f4")
    binds[:, 3] = 0, 0, 0, 1
    file.attributes |= {"JOINTS_0": file.add(which.astype("u1")), "WEIGHTS_0": file.add(share)}
    place = file.add(binds.swapaxes(1, 2).reshape(-1, 16))
    file.json["skins"] = [{"joints": list(range(1, 1 + joints)), "inverseBindMatrices": place}]

    import trimesh

    world = {}

    def visit(index, above):
        node = file.json["nodes"][index]
        x, y, z, w = node["rotation"]
        local = trimesh.transformations.quaternion_matrix([w, x, y, z]) @ np.diag([*node["scale"], 1])
        local[:3, 3] = node["translation"]
        world[index] = above @ local
        for child in node.get("children", []):
            visit(child, world[index])

    visit(1, np.eye(4))
    share = share / share.sum(axis=1, keepdims=True, dtype=np.float64)
    mixed = sum(share[:, k, None, None] * np.array([world[1 + j] @ binds[j] for j in which[:, k]]) for k in range(4))
    points = np.array(file.data and np.frombuffer(file.data[: count * 12], "<f4").reshape(-1, 3), np.float64)
    expected = np.einsum("nij,nj->ni", mixed[:, :3, :3], points) + mixed[:, :3, 3]
    np.testing.assert_allclose(read(file).vertices, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda file: file.json["skins"][0].update(joints=[]), r"skins\[0\] has 0 joints, a vertex has joint 0"),
        (lambda file: file.json["skins"][0].update(joints=[77]), r"nodes\[77\] does not exist"),
        (lambda file: file.json["skins"][0].update(inverseBindMatrices=1), "accessors.1. does not have the type"),
        (lambda file: file.json.pop("skins"), r"skins\[0\] does not exist"),
        (lambda file: file.json["nodes"][1].update(children=[1]), "nodes must be a tree"),
        (lambda file: file.json["nodes"].append({"children": [1]}), None),
        (lambda file: file.attributes.update(WEIGHTS_0=1), "another number of joints or weights"),
    ],
    ids=["no joints", "no node", "no matrices", "no skin", "circle", "above", "weights"],
)
def test_a_broken_skin_is_one_line(change, told):
    file = skinned(*FIRST, {"translation": [10, 0, 0]})
    change(file)
    if told is None:  # the joint is below a node that stands in no scene, which counts
        assert read(file).vertices[0].tolist() == [10, 0, 0]
    else:
        with pytest.raises(ValueError, match=told):
            read(file)


def test_too_few_inverse_bind_matrices():
    file = skinned(np.array([1, 0, 0, 0], "u1"), FIRST[1], {}, {}, binds=[shift(0, 0, 0)])
    with pytest.raises(ValueError, match=r"skins\[0\] has 2 joints and 1 inverse bind matrices"):
        read(file)


def test_what_a_skin_lacks_is_a_warning():
    file = skinned(FIRST[0], np.zeros(4, "<f4"), {"translation": [10, 0, 0]})
    assert read(file).vertices[0].tolist() == [10, 0, 0]
    assert "no weights; they follow the first of their joints" in read(file).warnings[0]
    del file.attributes["JOINTS_0"]
    file.node["translation"] = [0, 3, 0]
    assert read(file).vertices[0].tolist() == [0, 3, 0]
    assert read(file).warnings == ("a mesh with a skin has no joints and weights; the transform of its node is used",)
