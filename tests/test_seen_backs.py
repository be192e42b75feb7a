"""Objects that show their black back: found by a coarse grid of rays, and reported where it matters."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main
from raytrace.errors import SceneWarning
from raytrace.rendering.result import centre_rays, make_view
from raytrace.scene import seen_backs as backs

SCENES = Path(__file__).parent.parent / "scenes"
FLOOR = {"rectangle": {}, "material": "grey", "scale": 4, "rotate": {"axis": [1, 0, 0], "angle": 90}}  # faces down
ABOVE = {"position": [0, 3, 6], "look_at": [0, 0, 0], "fov": 40}


def scene_of(*objects, camera=ABOVE, **grey):
    return rt.load(
        {
            "camera": camera,
            "film": {"size": [32, 24]},
            "lights": [{"type": "point", "position": [0, 3, 2], "flux": [99, 99, 99]}],
            "materials": {
                "grey": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]} | grey,
                "glass": {"type": "dielectric", "ior": 1.5},
            },
            "objects": list(objects),
        }
    )


CAMERAS = {
    "outside": {"position": [0.3, 0.2, 4], "look_at": [0, 0, 0], "fov": 40},
    "inside": {"position": [0.2, 0.1, 0.3], "look_at": [1, 0.3, 0], "fov": 100},  # triangles reach behind the camera
    "close": {"position": [0.9, 0.1, 0.8], "look_at": [-1, -1, 0], "fov": 140},
    "parallel": {"type": "orthographic", "position": [1, 2, 3], "look_at": [0, 0, 0], "height": 2.5},
}


@pytest.mark.parametrize("name", CAMERAS)
def test_the_grid_meets_what_the_tree_meets(name, monkeypatch):
    rng = np.random.default_rng(8)
    corners = rng.normal(size=(300, 1, 3)) + 0.3 * rng.normal(size=(300, 3, 3))
    mesh = corners.reshape(-1, 3), np.arange(900).reshape(300, 3)
    scene = scene_of({"mesh": mesh, "material": "grey"}, camera=CAMERAS[name])
    rays, prim_id, back = backs.seen(scene.mesh, scene.camera, (64, 40))
    x, y = np.meshgrid((np.arange(48) + 0.5) * 64 / 48, np.arange(40) + 0.5)
    o, d = centre_rays(scene, make_view(scene.camera, (64, 40), np.dtype(np.float64)), x.ravel(), y.ravel())
    bvh = rt.BVH(scene.mesh.vertices, scene.mesh.faces, "float64")
    hits = bvh.closest_hit(o, d)
    hit = hits.prim_id >= 0
    assert rays == len(x.ravel())
    assert hit.any()
    assert prim_id.tolist() == hits.prim_id[hit].tolist()
    assert back.tolist() == ((bvh.surface(hits).ng * d).sum(axis=1) > 0)[hit].tolist()
    monkeypatch.setattr(backs, "MOST", 50)  # in parts
    assert backs.seen(scene.mesh, scene.camera, (64, 40))[1].tolist() == prim_id.tolist()


def test_a_floor_seen_from_behind_is_named_with_the_cure():
    (line,) = backs.back_warnings(
        scene_of(FLOOR, {"sphere": {"center": [0, 0.5, 0], "radius": 0.4}, "material": "grey"})
    )
    assert line == (
        "scene: objects[0]: rectangle: 100 % of its pixels show its back, which is black; "
        'use "flip": true, or "two_sided": true in its material "grey"'
    )


QUIET = {
    "flipped": scene_of(FLOOR | {"flip": True}),
    "two-sided": scene_of(FLOOR, two_sided=True),
    "glass": scene_of(FLOOR | {"material": "glass"}),
    "small": scene_of(FLOOR | {"scale": 0.2}),
    "a ball": scene_of({"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}),
}


@pytest.mark.parametrize("name", QUIET)
def test_what_is_not_black_or_small_is_not_named(name):
    assert backs.back_warnings(QUIET[name]) == []


LARGE = "sky", "bumpy", "still-life"  # tests/bench/seen_backs.py has all
SHIPPED = [path for path in sorted(SCENES.glob("*.json")) if path.stem not in LARGE]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_no_shipped_scene_has_a_warning(path):
    assert backs.back_warnings(rt.load(path)) == []


def test_python_warns_once_and_only_of_black_images(monkeypatch):
    scene = scene_of(FLOOR)
    with pytest.warns(SceneWarning, match="rectangle: 100 % of its pixels show its back") as caught:
        image = rt.render(scene, spp=1)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rt.render(scene, spp=1, camera=ABOVE | {"fov": 41})
        monkeypatch.setattr(backs, "seen", None)  # not called
        rt.render(QUIET["two-sided"], spp=1)
    assert (image.rgb == 0).all()


def test_the_command_line_warns(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f.obj").write_text("v -4 0 -4\nv 4 0 -4\nv 4 0 4\nv -4 0 4\nf 1 2 3 4\n")
    assert main.main(["check", "f.obj"]) == 0  # two-sided
    scene = rt.load(
        {
            "camera": ABOVE,
            "materials": {"m": {"type": "diffuse", "albedo": [1, 1, 1]}},
            "objects": [{"mesh": "f.obj", "material": "m"}],
        }
    )
    rt.save(scene, "s.json")
    assert main.main(["check", "s.json"]) == 0
    line = 's.json: objects[0]: f.obj: 100 % of its pixels show its back, which is black; use "flip": true'
    assert f"warning: {line}" in capsys.readouterr().out
    assert main.main(["s.json", "--size", "16x16", "--spp", "1"]) == 0
    said = capsys.readouterr().err
    assert f"warning: {line}" in said
    assert 'hint: the image is black: see "My image is black"' in said
