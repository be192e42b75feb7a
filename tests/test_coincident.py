"""Refractive surfaces that coincide with other surfaces: a warning where they do, and none where they do not."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli.main import main
from raytrace.errors import SceneWarning
from raytrace.scene.checks import warnings_of
from raytrace.scene.coincident import coincidences
from scene_files import scene as scene_dict
from scene_files import write
from shipped_scenes import each_scene, load
from small_scenes import Part, ball, box, glass, look, make_scene, quad

ROOT = Path(__file__).parents[1]
CUBE = box((-0.5, 0, -0.5), (0.5, 1, 0.5))
FLOOR = quad((-5, 0, 5), (5, 0, 5), (5, 0, -5), (-5, 0, -5))
SHEET = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))
ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]


def tiles(count, low=-2.0, high=3.0):
    """The plane y = 0 in count x count x 2 triangles."""
    x = np.linspace(low, high, count + 1)
    p = np.stack([m.ravel() for m in np.meshgrid(x, [0.0], x, indexing="ij")], axis=-1).reshape(count + 1, count + 1, 3)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


def dome(count):
    """A curved surface, one side of a lens."""
    bent = tiles(count, -1, 1)
    bent[..., 1] = 0.2 * (bent[..., 0] ** 2 + bent[..., 2] ** 2)
    return bent


PAIRS = {  # two parts that coincide, the first of glass
    "a box on a floor": (CUBE, FLOOR, False),
    "a box on a floor of many tiles": (CUBE, tiles(7), False),
    "a box of many triangles on a floor": (np.concatenate([tiles(9, -0.5, 0.5)[:, ::-1], CUBE]), FLOOR, False),
    "a box against a wall": (CUBE, quad((0.5, -1, 3), (0.5, 4, 3), (0.5, 4, -3), (0.5, -1, -3)), False),
    "a box in the corner of a tile": (CUBE + (0.5, 0, 0.5), tiles(5), False),
    "a box that hangs over an edge": (CUBE + (5.2, 0, 0), FLOOR, False),
    "glass in glass": (box((-1, 0, -1), (1, 3, 1)), CUBE, True),
    "glass beside glass": (CUBE, CUBE + (1, 0.25, 0), True),
    "a lens cemented to a lens": (dome(6), dome(6)[:, ::-1], True),
    "a sheet of glass on a wall": (SHEET, FLOOR, False),
}
TURNED = np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]).T / np.sqrt(2)
FRAME = [tiles(1, 0, 1) + (k, 0, n) for k in (-1, 0, 1) for n in (-1, 0, 1) if k or n]
APART = {  # the first of glass, and nothing coincides
    "one edge": (CUBE, CUBE + (1, 1, 0)),
    "side by side on one plane": (SHEET, SHEET + (2, 0, 0)),
    "one corner": (CUBE, CUBE + 1),
    "a box on its edge": (CUBE @ TURNED + (0, np.sqrt(0.125), 0), FLOOR),
    "a ball on a floor": (ball(12)[0] + (0, 1, 0), FLOOR),
    "a box through a floor": (CUBE - (0, 0.5, 0), FLOOR),
    "a pane in a hole": (tiles(1, 0, 1), np.concatenate(FRAME)),
    "a gap that is seen": (CUBE + (0, 1e-4, 0), FLOOR),
}


def pair(a, b, both=False, **more):
    return make_scene([glass(a, 1.5), glass(b, 1.3) if both else Part(b)], **more)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("turn", [np.eye(3), ROTATION], ids=["level", "tilted"])
@pytest.mark.parametrize("name", PAIRS)
def test_two_surfaces_that_coincide_are_found_and_the_lift_parts_them(name, turn, precision):
    a, b, both = PAIRS[name]
    (found,) = coincidences(pair(a @ turn.T, b @ turn.T, both), precision)
    assert (found.first, found.second) == (0, 1)
    assert 0 < found.lift < (2e-4 if precision == "float32" else 4e-13)
    if found.direction is not None:
        lifted = a @ turn.T + np.multiply(found.lift, found.direction)
        assert not coincidences(pair(lifted, b @ turn.T, both), precision)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("turn", [np.eye(3), ROTATION], ids=["level", "tilted"])
@pytest.mark.parametrize("name", APART)
def test_surfaces_that_only_touch_or_lie_apart_are_not(name, turn, precision):
    a, b = APART[name]
    assert not coincidences(pair(a @ turn.T, b @ turn.T), precision)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("where", [(0, 0, 0), (30, 20, 10)])
def test_the_lift_scales_with_the_scene(scale, where):
    a, b = ((part @ ROTATION.T + where) * scale for part in (CUBE, FLOOR))
    (found,) = coincidences(pair(a, b), "float32")
    assert np.isclose(found.lift / scale, coincidences(pair(a / scale, b / scale), "float32")[0].lift, rtol=0.02)
    np.testing.assert_allclose(found.direction, ROTATION[:, 1], atol=1e-6)
    lifted = a + np.multiply(found.lift, found.direction)
    assert not coincidences(pair(lifted, b), "float32")
    assert not coincidences(pair(a, b + 1e-3 * scale * ROTATION[:, 1] * -1), "float32")


def test_what_is_not_refractive_may_coincide():
    assert not coincidences(make_scene([Part(CUBE), Part(FLOOR)]), "float32")
    ground = glass(FLOOR - (0, 3, 0), 1.5)
    assert not coincidences(make_scene([Part(CUBE), Part(FLOOR), ground]), "float32")


def test_the_other_object_may_come_first():
    (found,) = coincidences(make_scene([Part(FLOOR), glass(CUBE, 1.5)]), "float32")
    assert (found.first, found.second, found.direction) == (1, 0, (0, 1, 0))


def test_each_object_is_named_that_coincides():
    parts = [Part(FLOOR), glass(CUBE, 1.5), glass(CUBE + (1, 0, 0), 1.5), glass(CUBE + (0, 3, 0), 1.5)]
    found = coincidences(make_scene(parts), "float32")
    assert [(pair.first, pair.second) for pair in found] == [(1, 0), (1, 2), (2, 0)]


def test_a_box_in_a_corner_has_no_single_direction():
    corner = np.concatenate([FLOOR, quad((0.5, -1, 3), (0.5, 4, 3), (0.5, 4, -3), (0.5, -1, -3))])
    (found,) = coincidences(pair(CUBE, corner), "float32")
    assert found.direction is None
    assert "wherever they touch" in found.text(("a", "b"))


def test_a_sheet_that_is_there_twice_is_found():
    sheet = dome(8)
    rng = np.random.default_rng(0)
    again = np.roll(sheet[rng.permutation(len(sheet)), ::-1], 1, axis=1)
    (found,) = coincidences(make_scene([glass(np.concatenate([sheet, again]), 1.5)]), "float32")
    assert (found.first, found.second) == (0, 0)
    assert "itself" in found.text(("lens.obj",))
    assert not coincidences(make_scene([glass(sheet, 1.5)]), "float32")
    assert not coincidences(make_scene([glass(np.concatenate([sheet, again[:1]]), 1.5)]), "float32")


def test_over_one_triangle_is_not_enough():
    one = [[[0, 0, 0], [0, 0, 1], [1, 0, 0]]]
    assert not coincidences(pair(np.array(one, float), FLOOR * 9), "float32")


@each_scene
def test_no_shipped_scene_has_such_surfaces(path):
    for precision in ("float32", "float64"):
        assert not coincidences(load(path), precision)


def test_a_scene_without_glass_is_not_searched(monkeypatch):
    monkeypatch.setattr("raytrace.scene.coincident._search", None)
    assert not coincidences(make_scene([Part(CUBE), Part(FLOOR)]), "float32")


def test_the_document_shows_what_is_said():
    path, text = ROOT / "docs" / "scenes" / "glass-on-floor.json", (ROOT / "docs" / "conventions.md").read_text("utf-8")
    (line,) = rt.load(path, root=ROOT).warnings
    assert "warning: docs/" + line.split("docs/", 1)[1].replace("\\", "/") in text.splitlines()
    assert rt.load(path.with_name("glass-lifted.json"), root=ROOT).warnings == ()


# What is said -------------------------------------------------------------------------------------------------------


def on_floor(tmp_path, lift=0.0, **render):
    (tmp_path / "floor.obj").write_text("v -5 0 5\nv 5 0 5\nv 5 0 -5\nv -5 0 -5\nf 1 2 3 4\n")
    objects = [
        {"mesh": "floor.obj", "material": "white"},
        {"mesh": "cube.obj", "material": "glass", "translate": [0, lift, 0]},
    ]
    materials = {"white": {"type": "diffuse", "albedo": [1, 1, 1]}, "glass": {"type": "refractive", "ior": 1.5}}
    film = {"size": [8, 8]}
    return write(tmp_path, scene_dict(objects=objects, materials=materials, film=film, render=render))


def test_every_way_to_look_at_the_scene_warns(tmp_path, capsys):
    path = on_floor(tmp_path)
    (line,) = rt.load(path).warnings
    words = "cube.obj is refractive and coincides with floor.obj (objects[0])"
    assert f"{path}:" in line
    assert f"objects[1]: {words}" in line
    assert "lift it by 1.7e-06 along (0, 1, 0)" in line
    assert f"warning: {line}" in str(rt.explain(path)).splitlines()
    for command in (["check", str(path)], ["explain", str(path)], [str(path), "-o", str(tmp_path / "a.png")]):
        with warnings.catch_warnings(record=True) as others:
            warnings.simplefilter("always")
            assert main(command) == 0
        said = "".join(capsys.readouterr())
        assert said.count(words) == 1, command
        assert not others
    with pytest.warns(SceneWarning, match="coincides") as caught:
        rt.render(path, spp=1)
    assert [warning.filename for warning in caught] == [__file__]


def test_a_lifted_box_is_drawn_without_a_warning(tmp_path, capsys):
    path = on_floor(tmp_path, lift=2e-6)
    assert rt.load(path).warnings == ()
    rt.render(path, spp=1)
    assert main(["check", str(path)]) == 0
    assert "coincides" not in capsys.readouterr().out


def test_the_precision_that_is_rendered_in_counts(tmp_path, capsys):
    path = on_floor(tmp_path, lift=1e-9, precision="float64")
    scene = rt.load(path)
    assert scene.warnings == ()
    assert warnings_of(scene, None) == warnings_of(scene, "float64") == []
    rt.render(scene, spp=1)
    shifted = on_floor(tmp_path, lift=1e-9 + 1, precision="float64")
    (tmp_path / "floor.obj").write_text("v -5 1 5\nv 5 1 5\nv 5 1 -5\nv -5 1 -5\nf 1 2 3 4\n")
    assert rt.load(shifted).warnings == ()
    with pytest.warns(SceneWarning, match="lift it by"):
        rt.render(shifted, spp=1, precision="float32")
    assert main([str(shifted), "--precision", "float32", "-o", str(tmp_path / "b.png")]) == 0
    assert capsys.readouterr().err.count("coincides") == 1


def test_the_lift_gives_the_floor_back(tmp_path):
    """Seen from above, nothing of the background below the floor is seen through the cube."""
    objects = [glass(CUBE, 1.5, transparent_shadow=True), Part(FLOOR)]
    view = {
        "camera": look((0.1, 6, 0.2), (0, 0, 0), fov=4.0),
        "background": (0, 0, 1),
        "lights": [((1, 6, 2), (2000, 2000, 2000))],
    }

    def blue(parts):
        image = rt.render(make_scene(parts, **view), spp=4, size=(32, 32), precision="float32")
        return float((image.rgb[..., 2] - image.rgb[..., 0]).clip(0).mean())

    with pytest.warns(SceneWarning):
        assert blue(objects) > 0.5
    (found,) = coincidences(make_scene(objects), "float32")
    lifted = [glass(CUBE + np.multiply(found.lift, found.direction), 1.5, transparent_shadow=True), Part(FLOOR)]
    assert blue(lifted) == 0
