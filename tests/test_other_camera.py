"""``rt.render(camera=)``: the image is that of the scene with this camera, and no tree is built again."""

import gc
import weakref

import numpy as np
import pytest

import raytrace as rt
from raytrace.rendering import compiled_scene
from raytrace.rendering.compiled_scene import plan_of
from raytrace.scene.other_camera import with_camera

pytestmark = [
    pytest.mark.engine,
    pytest.mark.filterwarnings("ignore::raytrace.errors.SceneWarning"),
]

PINHOLE = {"position": [3, 2, 4], "look_at": [0, 0, 0], "fov": 50}
LENS = PINHOLE | {"aperture": 0.3, "focus": 3.0}
FLAT = {"type": "orthographic", "position": [0, 4, 3], "look_at": [0, 0, 0], "height": 4}
SCENE = {
    "camera": {"position": [0, 0, 9], "look_at": [0, 0, 0], "fov": 30},
    "film": {"size": [24, 16]},
    "render": {"spp": 2},
    "lights": [{"type": "point", "position": [4, 5, 3], "flux": [400, 300, 200]}],
    "materials": {
        "white": {"type": "diffuse", "albedo": [0.7, 0.6, 0.5]},
        "pane": {"type": "refractive", "ior": 1.5, "shadows": "transparent"},
    },
    "objects": [
        {"box": {}, "material": "white"},
        {"rectangle": {}, "material": "pane", "translate": [0, 0, 1.5]},
    ],
}


def same(image, other):
    assert np.array_equal(image.rgb, other.rgb)
    ours, theirs = ({k: v for k, v in each.provenance.items() if k != "seconds"} for each in (image, other))
    assert ours == theirs


@pytest.mark.parametrize("first", [PINHOLE, LENS], ids=["pinhole", "lens"])
def test_the_image_is_that_of_the_scene_with_this_camera(first):
    scene = rt.load(SCENE | {"camera": first})
    for camera in (PINHOLE | {"fov": 20}, LENS | {"focus": 2.0}, FLAT):
        image = rt.render(scene, camera=camera)
        assert image.rgb.any()
        same(image, rt.render(SCENE | {"camera": camera}))
        same(
            rt.render(scene, camera=camera, integrator="path"), rt.render(SCENE | {"camera": camera}, integrator="path")
        )
    same(rt.render(scene), rt.render(SCENE | {"camera": first}))  # the scene is as it was


def test_trees_are_built_once(monkeypatch):
    built = []
    monkeypatch.setattr(compiled_scene, "BVH", lambda *args: built.append(args) or rt.BVH(*args))
    scene = rt.load(SCENE)
    hashes = {rt.render(scene, spp=1, camera=PINHOLE | {"fov": fov}).provenance["scene_sha256"] for fov in (20, 30, 40)}
    assert len(hashes) == 3
    assert len(built) == 2  # one of them without the pane, for shadow rays
    rt.render(scene, spp=1)
    assert len(built) == 2


def test_the_precision_is_chosen_for_this_camera():
    scene = rt.load(SCENE)
    far = PINHOLE | {"position": [3e6, 2e6, 4e6], "fov": 1e-4}
    for camera, precision in ((far, "float64"), (PINHOLE, "float32")):
        plan = plan_of(with_camera(scene, camera))
        assert plan.precision.name == precision
        assert plan == rt.explain(SCENE | {"camera": camera})
    with pytest.raises(rt.SceneError, match="even float64"):
        rt.render(scene, spp=1, camera=PINHOLE | {"position": [3e16, 2e16, 4e16]})


def test_layers_and_sizes_follow_the_camera():
    scene = rt.load(SCENE)
    image = rt.render(scene, spp=1, size=(10, 12), camera=FLAT, aov=["depth", "uv"])
    other = rt.render(SCENE | {"camera": FLAT}, spp=1, size=(10, 12))
    for name in ("depth", "uv", "position"):
        assert np.array_equal(image.aov[name], other.aov[name], equal_nan=True)


WRONG = {
    "not an object": ([1, 2], ["camera: expected an object, got a list of 2"]),
    "fov": (PINHOLE | {"fov": -3}, ["camera.fov: expected a number > 0, got -3"]),
    "several": (
        {"position": [1, 2], "look_at": [0, 0, 0], "fow": 3},
        ["camera.position: expected a list of 3 numbers", 'camera.fow: unknown key "fow"; did you mean "fov"?'],
    ),
    "nothing": ({}, ['camera: missing key "position"', 'missing key "look_at"', 'missing key "fov"']),
    "no direction": (
        PINHOLE | {"look_at": np.array([3, 2, 4])},
        ["camera.look_at: the camera looks at its own position"],
    ),
    "parallel": (PINHOLE | {"up": (-3.0, -2, -4)}, ["camera.up: up is parallel"]),
    "nan": (PINHOLE | {"fov": float("nan")}, ["camera.fov: expected a finite number, got NaN"]),
    "type": (PINHOLE | {"fov": {1, 2}}, ["camera: a set cannot be written as JSON"]),
}


@pytest.mark.parametrize("camera", [PINHOLE, LENS, FLAT], ids=["pinhole", "lens", "orthographic"])
def test_a_camera_may_be_that_of_a_scene(camera):
    scene, other = rt.load(SCENE), rt.load(SCENE | {"camera": camera})
    assert with_camera(scene, other.camera).sha256 == other.sha256
    with pytest.raises(rt.SceneError, match="camera looks at its own position"):
        rt.render(scene, camera=other.camera._replace(look_at=other.camera.position))


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_camera_gets_the_messages_of_a_scene(name):
    camera, texts = WRONG[name]
    with pytest.raises(rt.SceneError) as caught:
        rt.render(SCENE, spp=1, camera=camera)
    message = str(caught.value)
    assert all(text in message for text in texts), message
    assert len(message.splitlines()) == len(texts)


def test_a_render_does_not_resume_with_another_camera(tmp_path):
    scene, file = rt.load(SCENE), tmp_path / "a.checkpoint"
    rt.render(scene, camera=PINHOLE, checkpoint=file)
    assert file.exists()
    with pytest.raises(rt.FileError, match=r"a\.checkpoint"):
        rt.render(scene, camera=FLAT, checkpoint=file)
    same(rt.render(scene, camera=PINHOLE, checkpoint=file), rt.render(scene, camera=PINHOLE))


def test_a_camera_of_a_camera_shares_the_first_scene_and_leaves_nothing():
    scene = rt.load(SCENE)
    one = with_camera(scene, PINHOLE)
    two = with_camera(one, FLAT)
    assert two.camera.height == 4
    assert two.mesh is scene.mesh
    rt.render(two, spp=1)
    assert compiled_scene.is_compiled(scene, "float32")
    kept = weakref.ref(two)
    del one, two
    gc.collect()
    assert kept() is None
