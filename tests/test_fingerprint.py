"""The hash of a scene that was changed in memory: another, so that nothing that is kept by hashes mixes two images."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import raytrace as rt
from raytrace.errors import FileError
from raytrace.scene.fingerprint import fingerprint
from same_pictures import assert_same
from small_scenes import studio

CHANGES = {
    "camera": lambda scene: scene.camera._replace(fov=scene.camera.fov + 1),
    "background": lambda scene: scene.background + 0.25,
    "lights": lambda scene: scene.lights._replace(flux=2 * scene.lights.flux),
    "materials": lambda scene: scene.materials._replace(albedo=scene.materials.albedo / 2),
    "mesh": lambda scene: scene.mesh._replace(vertices=scene.mesh.vertices + 0.01),
    "settings": lambda scene: scene.settings._replace(max_depth=3),
}
KEEPS = {
    "about": lambda _: "Another sentence.",
    "objects": lambda scene: tuple(f"{name}, again" for name in scene.objects),
    "warnings": lambda _: ("One more.",),
    "settings": lambda scene: scene.settings._replace(spp=99, seed=7),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_scene_has_another_hash(name):
    scene = studio()
    before = scene.sha256
    changed = replace(scene, **{name: CHANGES[name](scene)})
    assert changed.sha256 != before
    assert changed.sha256 == fingerprint(changed)
    assert scene.sha256 == before
    assert replace(changed, **{name: getattr(scene, name)}).sha256 == before


def test_lens_and_filter_are_part_of_the_hash():
    scene = studio()
    kinds = [("aperture", 0.1), ("focus", 7.0), ("height", 2.0), ("height", 3.0)]
    cameras = [scene.camera, *(scene.camera._replace(aperture=0.2, **{key: value}) for key, value in kinds[1:])]
    cameras += [scene.camera._replace(**{key: value}) for key, value in (kinds[0], *kinds[2:])]
    hashes = [replace(scene, camera=camera).sha256 for camera in cameras]
    hashes += [replace(scene, settings=scene.settings._replace(filter=name)).sha256 for name in ("tent", "gaussian")]
    assert len(set(hashes)) == len(hashes)
    assert replace(scene, camera=scene.camera._replace(focus=7.0)).sha256 == scene.sha256  # a pinhole


@pytest.mark.parametrize("name", KEEPS)
def test_what_the_light_does_not_feel_changes_no_hash(name):
    scene = studio()
    assert replace(scene, **{name: KEEPS[name](scene)}).sha256 == scene.sha256


def test_copies_have_the_same_hash():
    scene = studio()
    for fresh in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene)), studio()):
        assert fresh.sha256 == scene.sha256


@pytest.mark.parametrize("name", CHANGES)
def test_a_checkpoint_of_a_scene_is_refused_for_the_changed_one(tmp_path, name):
    def stop(event):
        if event.stage == "rendering":
            raise KeyboardInterrupt

    scene, ask = studio(), {"size": (40, 33), "spp": 16, "checkpoint": tmp_path / "a.checkpoint"}
    rt.render(scene, progress=stop, **ask)
    changed = replace(scene, **{name: CHANGES[name](scene)})
    with pytest.raises(FileError, match="belongs to another image"):
        rt.render(changed, **ask)
    assert_same(rt.render(scene, **ask), rt.render(scene, size=(40, 33), spp=16))
    kept = rt.render(changed, size=(8, 8), spp=1).provenance["scene_sha256"]
    assert kept == changed.sha256 != scene.sha256


def test_a_render_of_a_changed_scene_shows_the_change():
    scene = studio()
    before = rt.render(scene, size=(16, 16), spp=1)
    changed = replace(scene, camera=CHANGES["camera"](scene))
    assert not np.array_equal(rt.render(changed, size=(16, 16), spp=1).rgb, before.rgb)
