"""``rt.camera_rays``: rays through pixel centres, of scenes and of intrinsic matrices."""

import numpy as np
import pytest

import raytrace as rt

K = np.array([[900.0, 3.0, 7.25], [0, 700.0, 4.5], [0, 0, 2.0]])
SIZE = (9, 6)
BOX = {
    "camera": {"position": [3, 2, 4], "look_at": [0.2, 0, 0], "up": [0.1, 1, 0], "fov": 50},
    "film": {"size": SIZE},
    "render": {"precision": "float64"},
    "materials": {"white": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
    "objects": [{"box": {}, "material": "white"}],
}
CAMERAS = {
    "pinhole": {},
    "lens": {"aperture": 0.3, "focus": 2.0},
    "orthographic": {"type": "orthographic", "height": 5, "fov": None},
}


def scene(name):
    camera = BOX["camera"] | CAMERAS[name]
    return BOX | {"camera": {key: value for key, value in camera.items() if value is not None}}


def turn(axis, angle):
    """Rotation by Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pose(rotation, shift=(0, 0, 0)):
    return np.block([[rotation, np.reshape(shift, (3, 1))], [np.zeros((1, 3)), 1]])


@pytest.mark.engine
@pytest.mark.filterwarnings("ignore::raytrace.errors.SceneWarning")
@pytest.mark.parametrize("name", CAMERAS)
def test_rays_hit_what_the_layers_show(name):
    loaded = rt.load(scene(name))
    origins, directions = rt.camera_rays(loaded)
    assert origins.shape == directions.shape == (6, 9, 3)
    assert origins.dtype == directions.dtype == np.float64
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=4e-16)
    bvh = rt.BVH(loaded.mesh.vertices, loaded.mesh.faces, "float64")
    hits = bvh.closest_hit(origins.reshape(-1, 3), directions.reshape(-1, 3))
    layers = rt.render(loaded, spp=1).aov
    t = hits.t.reshape(6, 9)
    assert 5 < np.isfinite(t).sum() < 54
    np.testing.assert_allclose(t, layers["depth"], rtol=1e-6)  # layers are float32
    points = origins + np.where(np.isfinite(t), t, 0)[..., None] * directions
    seen = np.isfinite(t)
    np.testing.assert_allclose(points[seen], layers["position"][seen], atol=1e-6)
    assert np.array_equal(hits.prim_id.reshape(6, 9) >= 0, layers["prim_id"] >= 0)


def test_the_middle_of_the_film_looks_at_the_target():
    origins, directions = rt.camera_rays(BOX, size=(5, 3))
    assert origins.shape == (3, 5, 3)
    assert (origins == BOX["camera"]["position"]).all()
    to = np.subtract(BOX["camera"]["look_at"], BOX["camera"]["position"])
    np.testing.assert_allclose(directions[1, 2], to / np.linalg.norm(to), atol=2e-16)
    assert directions[0, 2, 1] > directions[2, 2, 1]  # row 0 is the top


def test_a_matrix_gives_the_rays_of_its_definition():
    t = pose(turn((1, -2, 0.5), 0.8), (5, -6, 7))
    origins, directions = rt.camera_rays(K=K, pose=t, size=SIZE)
    assert origins.shape == directions.shape == (6, 9, 3)
    assert (origins == t[:3, 3]).all()
    for r, c in [(0, 0), (5, 8), (2, 7)]:
        expected = t[:3, :3] @ np.linalg.inv(K) @ (c + 0.5, r + 0.5, 1)
        np.testing.assert_allclose(directions[r, c], expected / np.linalg.norm(expected), atol=1e-15)


def test_a_scenes_camera_as_a_matrix_gives_the_same_rays():
    loaded = rt.load(BOX)
    origins, directions = rt.camera_rays(loaded)
    forward = directions.mean(axis=(0, 1))
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, loaded.camera.up)
    right /= np.linalg.norm(right)
    t = pose(np.stack([right, np.cross(forward, right), forward], axis=1), loaded.camera.position)
    focal = SIZE[1] / 2 / np.tan(np.radians(loaded.camera.fov / 2))
    k = [[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]]
    again = rt.camera_rays(K=k, pose=t, size=SIZE)
    np.testing.assert_allclose(again[0], origins, atol=1e-15)
    np.testing.assert_allclose(again[1], directions, atol=1e-14)


def test_rays_are_those_of_open3d():
    o3d = pytest.importorskip("open3d", reason="open3d is not installed")
    t = pose(turn((1, -2, 0.5), 0.8), (5, -6, 7))
    k = K / K[2, 2]
    rays = o3d.t.geometry.RaycastingScene.create_rays_pinhole(
        o3d.core.Tensor(k), o3d.core.Tensor(np.linalg.inv(t)), *SIZE
    ).numpy()
    origins, directions = rt.camera_rays(K=k, pose=t, size=SIZE)
    theirs = rays[..., 3:] / np.linalg.norm(rays[..., 3:], axis=-1, keepdims=True)
    np.testing.assert_allclose(rays[..., :3], origins, rtol=1e-6)
    np.testing.assert_allclose(theirs, directions, atol=1e-6)  # they are float32


MIRROR = np.diag([1.0, 1, -1, 1])
WRONG = {
    "neither": ({}, "expected a scene, or K and size"),
    "both": ({"scene": BOX, "K": K, "size": SIZE}, "not both"),
    "pose without K": ({"scene": BOX, "pose": np.eye(4)}, "pose: only beside K"),
    "no size": ({"K": K}, "size: expected"),
    "bad size": ({"K": K, "size": (0, 5)}, "size: expected"),
    "shape": ({"K": np.eye(4), "size": SIZE}, "K: expected a 3 x 3 matrix, got shape"),
    "words": ({"K": [["a"] * 3] * 3, "size": SIZE}, "K: expected a 3 x 3 matrix of numbers"),
    "nan": ({"K": K * np.nan, "size": SIZE}, "K: a number is not finite"),
    "transposed K": ({"K": K.T, "size": SIZE}, "below the diagonal; is it transposed"),
    "flat": ({"K": np.diag([1.0, 0, 1]), "size": SIZE}, "K: not invertible"),
    "tiny": ({"K": np.diag([1e-310, 1, 1]), "size": SIZE}, "K: its inverse is beyond"),
    "scaled": ({"K": K, "pose": pose(1.00001 * np.eye(3)), "size": SIZE}, "not a rotation"),
    "sheared": ({"K": K, "pose": pose(np.eye(3) + np.eye(3, k=1)), "size": SIZE}, "not a rotation"),
    "mirrored": ({"K": K, "pose": MIRROR, "size": SIZE}, "it mirrors"),
    "transposed pose": ({"K": K, "pose": pose(np.eye(3), (1, 2, 3)).T, "size": SIZE}, "last row .*transposed"),
    "3 x 4": ({"K": K, "pose": np.eye(4)[:3], "size": SIZE}, "pose: expected a 4 x 4 matrix, got shape"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_arguments_get_one_line(name):
    arguments, text = WRONG[name]
    with pytest.raises(ValueError, match=text) as caught:
        rt.camera_rays(**arguments)
    assert "\n" not in str(caught.value)


def test_a_rotation_may_have_rounding_errors():
    t = pose(turn((0, 1, 0), 0.3).astype(np.float32) * (1 + 2e-7))
    _, directions = rt.camera_rays(K=K, pose=t, size=SIZE)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=4e-16)
