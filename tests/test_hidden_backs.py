"""Walls seen from behind are hidden from camera rays, and from no others."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.passes.camera import make_view, parallel_origins, pinhole_directions
from raytrace.rendering.compiled_scene import compiled_of, plan_of
from raytrace.scene.seen_backs import black_behind
from raytrace.show.prepared_scene import pixel_centres, prepare_scene
from raytrace.show.scene_edits import SceneEdits, edited

pytestmark = pytest.mark.filterwarnings("ignore::raytrace.errors.SceneWarning")  # of walls seen from behind
SIZE = 24, 18
FILE = "scenes/cornell-box-glass.json"
PARALLEL = {"type": "orthographic", "position": [0, 1, 6.8], "look_at": [0, 1, 0], "height": 2}


def compiled(prepared, **edits):
    scene = edited(prepared, SceneEdits(**edits))
    return scene, compiled_of(scene, plan_of(scene), prepared.compiled.bvh.precision)


@pytest.mark.parametrize("camera", [None, PARALLEL], ids=["pinhole", "orthographic"])
def test_camera_rays_pass_black_backs_and_stop_at_the_first_other_surface(camera):
    scene = rt.load(FILE)
    prepared = prepare_scene(scene if camera is None else scene.replace(camera=camera), SIZE)
    scene, made = compiled(prepared, azimuth=150, elevation=20, hide_backs=True)
    view, (x, y) = make_view(scene.camera, SIZE, np.dtype(made.bvh.precision)), pixel_centres(SIZE)
    if camera is None:
        o, d = np.broadcast_to(view.origin, (len(x), 3)), pinhole_directions(view, x, y)
    else:
        o = parallel_origins(view, x, y).astype(view.origin.dtype)
        d = np.broadcast_to(view.forward, o.shape)
    black, tmin, passed = black_behind(scene)[scene.mesh.material_id], np.zeros(len(x), view.origin.dtype), 0
    while True:  # step from back to back
        hits = made.bvh.closest_hit(o, d, tmin=tmin)
        back = (hits.prim_id >= 0) & black[hits.prim_id]
        back &= (made.bvh.triangles[hits.prim_id, 9:] * d).sum(axis=1) > 0
        if not back.any():
            break
        tmin, passed = np.where(back, hits.t, tmin), passed + back.sum()
    assert passed > len(x) / 4
    for own, expected in zip(made.camera_bvh.closest_hit(o, d), hits, strict=True):
        np.testing.assert_array_equal(own, expected)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_the_room_appears_and_other_rays_meet_what_they_met(integrator):
    prepared = prepare_scene(FILE, SIZE, integrator)
    scene, made = compiled(prepared, azimuth=150, spp=2, hide_backs=True)
    assert made.bvh is prepared.compiled.bvh
    assert made.shadow_bvhs == prepared.compiled.shadow_bvhs
    shown = rt.render(scene).rgb
    assert shown.mean() > 2 * rt.render(edited(prepared, SceneEdits(azimuth=150, spp=2))).rgb.mean()


def test_where_no_back_is_seen_the_image_keeps_its_bits():
    prepared = prepare_scene(FILE, SIZE)
    scene, made = compiled(prepared, spp=2, hide_backs=True)
    assert made.camera_bvh is not made.bvh  # backs of blocks, behind their fronts
    np.testing.assert_array_equal(rt.render(scene).rgb, rt.render(edited(prepared, SceneEdits(spp=2))).rgb)
