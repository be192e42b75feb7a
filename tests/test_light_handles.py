"""Lights that the viewer moves: the image of a scene file with those positions, and handles that follow the hand."""

import numpy as np

import raytrace as rt
from raytrace.show.light_handles import light_handles
from raytrace.show.prepared_scene import prepare_scene
from raytrace.show.scene_edits import SceneEdits, edited

FILE = "scenes/cornell-box-glass.json"
SIZE = 24, 18


def test_a_moved_light_gives_the_image_of_a_scene_with_that_position():
    scene = rt.load(FILE)
    place = [0.5, 1.0, -0.0625]
    for surface in (place, scene.mesh.vertices[scene.mesh.faces[0]].mean(axis=0).tolist()):  # on a wall: other trees
        own = rt.render(edited(prepare_scene(scene, SIZE), SceneEdits(spp=2, light_positions=[surface])))
        expected = rt.render(scene.replace({"lights[0].position": surface}), spp=2, size=SIZE)
        np.testing.assert_array_equal(own.rgb, expected.rgb)


def test_a_handle_follows_the_hand_in_a_plane_parallel_to_the_image():
    prepared = prepare_scene(FILE, SIZE)
    scene = edited(prepared, SceneEdits(20, 10))
    (handle,) = light_handles(scene)
    step = np.array([0.125, -0.25])
    moved = scene.lights.position[0] + step @ np.array([handle["right"], handle["down"]])
    (after,) = light_handles(edited(prepared, SceneEdits(20, 10, light_positions=[moved.tolist()])))
    np.testing.assert_allclose(np.subtract(after["at"], handle["at"]), step, atol=1e-12)
    forward = scene.camera.look_at - scene.camera.position
    assert abs((moved - scene.lights.position[0]) @ forward) < 1e-12


def test_a_light_behind_the_camera_has_no_handle():
    prepared = prepare_scene(FILE, SIZE)
    assert light_handles(edited(prepared, SceneEdits(light_positions=[[0, 1, 99]])))[0]["at"] is None
