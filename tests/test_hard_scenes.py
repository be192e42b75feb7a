"""Whole pictures where constants fail: scenes small, large and far, thin walls, lights on surfaces, terminators."""

import copy
import dataclasses
import json

import numpy as np
import pytest

import epsilons
import raytrace as rt
from shipped_scenes import SCENES
from small_scenes import Part, ball, box, glass, look, make_scene, quad

PRECISIONS = ("float32", "float64")
each_precision = pytest.mark.parametrize("precision", PRECISIONS)
SMALL = [path for path in SCENES if path.stem != "bumpy"]  # whose 330,000 triangles only take longer
ASK = {"spp": 2, "size": (40, 40)}


def turn():
    """A rotation after which no plane is special."""
    (c0, c1), (s0, s1) = np.cos([0.3, 0.7]), np.sin([0.3, 0.7])
    return np.array([[c0, -s0, 0], [s0, c0, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c1, -s1], [0, s1, c1]])


def placed(scene, precision, scale=1.0, shift=0.0, turned=True):
    """The whole scene turned, scaled, and shifted by so many times its scale; flux scaled with its square."""
    matrix = scale * (turn() if turned else np.eye(3))
    offset = scale * shift * np.array([1.0, -0.7, 0.4])

    def move(points):
        return points @ matrix.T + offset

    camera = scene.camera._replace(
        position=move(scene.camera.position), look_at=move(scene.camera.look_at), up=matrix @ scene.camera.up
    )
    lights = scene.lights._replace(position=move(scene.lights.position), flux=scale**2 * scene.lights.flux)
    normals = scene.mesh.normals
    if normals is not None:
        normals = normals @ matrix.T / scale
    return dataclasses.replace(
        scene,
        camera=camera,
        lights=lights,
        mesh=scene.mesh._replace(vertices=move(scene.mesh.vertices), normals=normals),
        settings=scene.settings._replace(precision=precision),
    )


# --- sizes ------------------------------------------------------------------------------------------------------------


def scaled(content, factor):
    """A scene file's content with all lengths times a factor, and flux times its square."""
    content = copy.deepcopy(content)
    for key in ("position", "look_at"):
        content["camera"][key] = [x * factor for x in content["camera"][key]]
    for light in content["lights"]:
        light["position"] = [x * factor for x in light["position"]]
        light["flux"] = [x * factor**2 for x in light["flux"]]
    for item in content["objects"]:
        item["scale"] = (np.array(item.get("scale", 1.0)) * factor).tolist()
        item["translate"] = [x * factor for x in item.get("translate", [0, 0, 0])]
    return content


@pytest.fixture
def content(request, monkeypatch):
    monkeypatch.chdir(request.param.parent)  # mesh paths of a dict are relative to the current folder
    return json.loads(request.param.read_text("utf-8"))


each_content = pytest.mark.parametrize("content", SMALL, ids=lambda path: path.stem, indirect=True)


@each_precision
@each_content
def test_powers_of_two_leave_every_bit_of_the_picture(content, precision):
    picture = rt.render(content, precision=precision, **ASK).rgb
    assert picture.any()
    for power in (-40, -21, -1, 13, 40):
        assert np.array_equal(rt.render(scaled(content, 2.0**power), precision=precision, **ASK).rgb, picture), power


@each_precision
@each_content
def test_other_factors_change_it_by_rounding_alone(content, precision):
    picture = rt.render(content, precision=precision, **ASK).rgb
    for factor in (3.0, 1e-10, 7e5):
        other = rt.render(scaled(content, factor), precision=precision, **ASK).rgb
        near = np.isclose(other, picture, rtol=1e-4 if precision == "float32" else 1e-6, atol=1e-6).all(axis=-1)
        assert near.mean() > 0.998, factor  # but for samples at edges


# --- surfaces that shadow themselves ---------------------------------------------------------------------------------

SHADOWLESS = {
    "floor": make_scene(
        [Part(quad((-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)))],
        [((0.3, 1.5, 0.2), (9, 9, 9))],
        look((0, 1, 3), (0, 0, 0.5), 30),
    ),
    "ball": make_scene(
        [Part(ball(12)[0], normals=ball(12)[1])], [((1, 2, 4), (90, 90, 90))], look((0, 0, 4), (0, 0, 0), 40)
    ),
    # 200 wide, and its plane passes the origin at 1/1000
    "large": make_scene(
        [Part([[(-120, 1e-3, 80), (90, 1e-3, 70), (10, 1e-3, -130)]])],
        [((0.3, 1.5, 0.2), (9, 9, 9))],
        look((0, 1, 3), (0, 0, 0.5), 30),
    ),
}
# scale, and shift in units of it: all that float32 holds to about 1 %, and what only float64 does
PLACES = [(1.0, 0.0), (1e-10, 0.0), (1e-6, 30.0), (1e-3, 0.0), (1.0, 300.0), (1e4, 0.0), (1e9, 30.0)]
FAR = [(1.0, 1e6), (1e-6, 1e8), (1e6, 1e9)]


@pytest.mark.parametrize(
    ("precision", "scale", "shift"),
    [(precision, *place) for precision in PRECISIONS for place in PLACES + FAR * (precision == "float64")],
)
@pytest.mark.parametrize("name", SHADOWLESS)
def test_a_convex_surface_has_no_shadow_on_it(name, precision, scale, shift):
    ask = {"spp": 4, "size": (48, 48)}
    truth = rt.render(placed(SHADOWLESS[name], "float64"), **ask).rgb[..., 0]
    picture = rt.render(placed(SHADOWLESS[name], precision, scale, shift), **ask).rgb[..., 0]
    clear = truth > 0.05 * truth.max()  # where no corner of the ball's own mesh is in the light's way
    assert clear.mean() > 0.3
    np.testing.assert_allclose(picture[clear], truth[clear], rtol=0.1)  # a sample that is black takes 1/4


# --- light that passes walls -----------------------------------------------------------------------------------------


def shell(thickness):
    """A closed box with walls of a thickness, seen from inside and from outside."""
    inner = box((-1, -1, -1), (1, 1, 1))[:, ::-1]
    return np.concatenate([inner, box(*(side * (1 + thickness) * np.ones(3) for side in (-1, 1)))])


WALLS = [(1.0, 0.0), (1e-6, 0.0), (1e-3, 10.0), (1e3, 10.0), (1e8, 0.0)]
FAR_WALLS = [(1.0, 1e6), (1e-6, 1e7)]


@pytest.mark.parametrize(
    ("precision", "scale", "shift"),
    [(precision, *place) for precision in PRECISIONS for place in WALLS + FAR_WALLS * (precision == "float64")],
)
@pytest.mark.parametrize("light", [(0.3, 1.001, -0.2), (2.0, 3.0, 1.5), (30.0, -20.0, 70.0)])
def test_no_light_comes_through_a_wall_of_a_ten_thousandth(light, precision, scale, shift):
    camera = look((0.5, 0.6, 0.7), (-0.6, -0.8, -0.9), 110)
    scene = make_scene([Part(shell(1e-4), two_sided=True)], [(light, (9e3, 9e3, 9e3))], camera)
    assert not rt.render(placed(scene, precision, scale, shift), spp=4, size=(64, 64)).rgb.any()


@each_precision
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
def test_no_light_leaves_a_shade_of_a_ten_thousandth(scale, precision):
    """A lamp in a closed box on a table, and the table about it."""
    table = quad((-4, -1.01, 4), (4, -1.01, 4), (4, -1.01, -4), (-4, -1.01, -4))
    parts = [Part(shell(1e-4)), Part(table, two_sided=True)]
    for place in ((0, 0, 0), (0.999, -0.999, 0.3)):
        scene = make_scene(parts, [(place, (9e3, 9e3, 9e3))], look((0, 1, 6), (0, -0.5, 0), 50))
        assert not rt.render(placed(scene, precision, scale), spp=4, size=(64, 64)).rgb.any()


# --- lights on surfaces ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [(0, 1, 0), (0.3, 1, -0.2), (1, 0, 0.1), (1, 1, 0), (1, 1, 1)])
@pytest.mark.parametrize(("precision", "shift"), [("float32", 0), ("float32", 100), ("float64", 0), ("float64", 1e6)])
def test_a_light_on_a_wall_lights_all_others(where, precision, shift):
    """In the plane, in an edge or in a corner: its rays end on what they reach, which does not stop them."""
    camera = look((-0.9, -0.8, 0.95), (0.5, 0.3, -0.6), 90)
    room = make_scene([Part(box((-1, -1, -1), (1, 1, 1))[:, ::-1])], [(where, (9, 9, 9))], camera)
    moved = placed(room, precision, shift=shift)
    picture = rt.render(moved, spp=1, size=(64, 64))
    walls = picture.aov["prim_id"] // 2  # two triangles each
    inside = np.lib.stride_tricks.sliding_window_view(walls, (3, 3)).reshape(62, 62, 9)
    inside = (inside == inside[..., :1]).all(axis=-1)
    lit = inside & ~np.isin(walls[1:-1, 1:-1], np.flatnonzero(_holds(room, where)) // 2)
    assert lit.sum() > 500
    assert (picture.rgb[1:-1, 1:-1][lit] > 0).all()


def _holds(scene, point):
    """Which triangles of axis-parallel walls hold a point in their plane."""
    corners = scene.mesh.vertices[scene.mesh.faces]
    return ((corners == np.asarray(point)).all(axis=1) & (np.ptp(corners, axis=1) == 0)).any(axis=1)


@each_precision
def test_a_light_on_a_sheet_shines_to_both_sides_and_what_is_behind_a_sheet_to_none(precision):
    sheet = quad((-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2))
    floor, roof = sheet - [0, 1, 0], sheet[:, ::-1] + [0, 1, 0]
    for height, above, below in ((0.0, True, True), (1e-3, True, False), (-1e-3, False, True)):
        for part, y, seen in ((roof, 0.5, above), (floor, -0.5, below)):
            scene = make_scene([Part(sheet), Part(part)], [((0.1, height, 0.2), (9, 9, 9))])
            camera = look((0, y, 0), (0, 2 * y, 0), 60, (1, 0, 0))
            picture = rt.render(placed(dataclasses.replace(scene, camera=camera), precision), spp=4, size=(32, 32)).rgb
            assert picture.all() if seen else not picture.any()


# --- smooth normals ---------------------------------------------------------------------------------------------------


@each_precision
@pytest.mark.parametrize("rings", [3, 6, 20])
def test_no_light_comes_round_a_coarse_ball(rings, precision):
    """The light is behind it, the eye opposite: all triangles in sight are turned away, though some normals are not."""
    triangles, normals = ball(rings)
    for direction in np.random.default_rng(1).normal(size=(4, 3)):
        place = 1.6 * direction / np.linalg.norm(direction)
        camera = look(place, (0, 0, 0), 80, (0.3, 1, 0.2))
        scene = make_scene([Part(triangles, normals=normals)], [(-place, (9e3, 9e3, 9e3))], camera)
        assert not rt.render(placed(scene, precision), spp=8, size=(64, 64)).rgb.any()
        front = dataclasses.replace(scene, lights=scene.lights._replace(position=place[None]))
        assert (rt.render(placed(front, precision), spp=8, size=(64, 64)).rgb > 0).mean() > 0.3


@each_precision
def test_normals_that_lean_to_a_light_behind_a_sheet_bring_none_of_it(precision):
    sheet = quad((-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2))
    lean = np.broadcast_to([0.9998, 0.02, 0.0], (2, 3, 3))
    for two_sided in (False, True):
        part = Part(sheet, normals=lean, two_sided=two_sided)
        scene = make_scene([part], [((5, -0.3, 0), (9e3, 9e3, 9e3))], look((0, 2, 2), (0, 0, 0), 40))
        assert not rt.render(placed(scene, precision), spp=4, size=(32, 32)).rgb.any()


@each_precision
def test_a_smooth_ball_of_glass_sends_no_ray_to_the_wrong_side(precision):
    """Each path meets the ball's triangles from outside, then from inside, in turn, but for total reflections.

    So nothing of a black core is seen through a shell of index 1, whatever its normals: it does not bend rays.
    """
    triangles, normals = ball(6)
    wild = normals + 0.5 * np.random.default_rng(2).normal(size=normals.shape)
    wild /= np.linalg.norm(wild, axis=2, keepdims=True)
    parts = [glass(triangles, 1.0, normals=wild), Part(0.5 * triangles, albedo=(0.5, 0.5, 0.5))]
    lights, camera = [((3, 4, 5), (300, 300, 300))], look((0, 0.3, 4), (0, 0, 0))
    parts[0] = parts[0]._replace(transparent_shadow=True)
    bare = make_scene(parts[1:], lights, camera, background=(1, 1, 1))
    covered = make_scene(parts, lights, camera, background=(1, 1, 1))
    ask = {"spp": 2, "size": (48, 48)}
    difference = rt.render(placed(covered, precision), **ask).rgb - rt.render(placed(bare, precision), **ask).rgb
    assert (np.abs(difference).max(axis=-1) < 1e-3).mean() > 0.999


# --- the shipped hard scenes -----------------------------------------------------------------------------------------


def off(picture, truth):
    """Which pixels are visibly wrong: by a fifth, or by 2 % of the brightest where they are dark."""
    return (np.abs(picture - truth) > 0.2 * truth + 0.02 * truth.max()).any(axis=-1)


@pytest.mark.parametrize("path", epsilons.HARD, ids=lambda path: path.stem)
def test_a_hard_scene_is_right_here_and_wrong_with_constants(path):
    scene, size = rt.load(path), (96, 96)
    assert scene.about.endswith(".")
    assert scene.warnings == ()
    truth = rt.render(scene, size=size, precision="float64").rgb
    assert off(rt.render(scene, size=size, precision="float32").rgb, truth).mean() < 0.001  # a sample at an edge
    wrong = epsilons.render(scene, size)
    if path.stem == "edges":  # holes in the disc, well inside its rim
        black = np.lib.stride_tricks.sliding_window_view(~truth.any(axis=-1), (3, 3)).all(axis=(-1, -2))
        assert wrong[1:-1, 1:-1][black].any(axis=-1).sum() > 5
        assert not rt.render(scene, size=size, seed=1).rgb[1:-1, 1:-1][black].any()
    else:
        assert off(wrong, truth).mean() > 0.03  # other samples change up to 1 %, at edges


def test_every_failure_has_a_scene_and_a_small_picture():
    pictures = {path.stem.removeprefix("hard-"): path for path in (epsilons.ROOT / "docs/pictures").glob("hard-*.png")}
    assert set(pictures) == {path.stem for path in epsilons.HARD}
    assert all(path.stat().st_size <= 110_000 for path in pictures.values())
