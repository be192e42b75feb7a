"""Precision: chosen by a bound that holds, and told where none serves."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.accel import hit_points
from raytrace.scene.precision import (
    FLOAT32_LEVELS,
    FLOAT32_RANGE,
    FLOAT64_RANGE,
    GAMMA,
    TOLERANCE,
    choose_precision,
    gamma,
    smallest_height,
)
from small_scenes import Part, look, make_scene, quad

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"
FLOOR = quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1))
TWO_SQUARES = {
    "camera": {"position": [0, 0, 4], "look_at": [0, 0, 0], "fov": 40},
    "materials": {"m": {"type": "diffuse", "albedo": [1, 1, 1]}},
    "objects": [{"rectangle": {}, "material": "m"}],
}
LIGHT = ((0, 2, 0), (1, 1, 1))


def auto(scene):
    """The scene with precision "auto", small and with few samples."""
    return dataclasses.replace(scene, settings=scene.settings._replace(precision="auto", size=(16, 16), spp=2))


def moved(scene, scale=1.0, shift=0.0):
    """The whole scene, camera and lights too, scaled and then shifted along x."""
    shift = np.array([shift, 0.0, 0.0])
    camera = scene.camera._replace(
        position=scale * scene.camera.position + shift, look_at=scale * scene.camera.look_at + shift
    )
    lights = scene.lights._replace(position=scale * scene.lights.position + shift)
    mesh = scene.mesh._replace(vertices=scale * scene.mesh.vertices + shift)
    return dataclasses.replace(scene, camera=camera, lights=lights, mesh=mesh)


def test_the_cornell_box_is_drawn_in_float32_and_the_bound_says_why():
    precision = rt.explain(BOX).precision
    assert precision.name == "float32"
    assert gamma("float32") == GAMMA * 2.0**-24 / (1 - GAMMA * 2.0**-24)
    assert precision.largest == 6.8  # the camera's z
    assert precision.error == 6.8 * gamma("float32")
    assert precision.error <= TOLERANCE * precision.feature
    assert precision.why == (
        "error of a point at most gamma(27) x 6.8 = 1.1e-05, is less than 1% of the smallest feature, 0.42"
    )


def test_the_bound_covers_the_points_that_float32_computes():
    scene = rt.load(BOX)
    layers = {p: rt.render(scene, spp=1, size=(64, 64), precision=p).aov for p in ("float32", "float64")}
    same = layers["float32"]["prim_id"] == layers["float64"]["prim_id"]
    assert same.mean() > 0.999
    exact = layers["float64"]["position"][same].astype(np.float64)
    # off the surface, not along it: along it a point moves with its ray
    ng = layers["float64"]["normal"][same]
    off = np.abs(((layers["float32"]["position"][same] - exact) * ng).sum(axis=-1))
    assert off.max() <= rt.explain(scene).precision.error


@pytest.mark.parametrize(
    ("scale", "shift", "reason"),
    [
        (1.0, 1e6, "in float32, error of a point at most gamma(27) x 1e+06 = 1.6, is more than 1% of the smallest"),
        (1e-13, 0.0, "sizes leave 1e-12 .. 1e+12"),
        (1e13, 0.0, "sizes leave 1e-12 .. 1e+12"),
    ],
    ids=["far from the origin", "tiny", "huge"],
)
def test_where_float32_is_too_coarse_the_box_is_drawn_in_float64(scale, shift, reason):
    scene = moved(rt.load(BOX), scale, shift)
    precision = rt.explain(scene).precision
    assert precision.name == "float64"
    assert precision.why.startswith(reason)
    picture = rt.render(scene, spp=1, size=(32, 32))
    assert picture.provenance["precision"] == "float64"
    if scale == 1.0:
        there, here = picture.rgb, rt.render(BOX, spp=1, size=(32, 32), precision="float64").rgb
        assert np.isclose(there, here, rtol=1e-3).all(axis=-1).mean() > 0.995  # but for pixels at edges


@pytest.mark.parametrize("scale", [1e-10, 1e10])
def test_sizes_alone_do_not_ask_for_float64(scale):
    scene = moved(rt.load(BOX), scale)
    assert rt.explain(scene).precision.name == "float32"
    scene = dataclasses.replace(scene, lights=scene.lights._replace(flux=scale**2 * scene.lights.flux))
    ask = {"spp": 4, "size": (48, 48)}
    picture, box = rt.render(scene, **ask), rt.render(BOX, **ask)
    assert picture.provenance["precision"] == "float32"
    assert np.isclose(picture.rgb, box.rgb, rtol=1e-4, atol=1e-6).all(axis=-1).mean() > 0.995


def test_a_sliver_asks_for_float64():
    sliver = np.array([[[0, 0, 0], [1, 0, 0], [0.5, 1e-5, 0]]])
    precision = choose_precision(auto(make_scene([Part(FLOOR), Part(sliver)], [LIGHT])))
    assert precision.name == "float64"
    assert precision.feature == pytest.approx(1e-5)
    assert "is more than 1% of the smallest feature, 1e-05" in precision.why


def test_a_far_camera_counts_as_a_coordinate():
    near = auto(make_scene([Part(FLOOR)], [LIGHT]))
    assert choose_precision(near).name == "float32"
    assert choose_precision(dataclasses.replace(near, camera=look((0, 0, 1e7), (0, 0, 0)))).name == "float64"


def test_a_far_light_does_not_and_need_not():
    """A shadow ray to a light far away keeps its direction to eps, and starts and ends where all others do."""
    screen = quad((-0.4, 0.1, 0), (0.4, 0.1, 0), (0.4, 0.7, 0), (-0.4, 0.7, 0))
    place = 1e9 * np.array([0.2, 0.8, -0.55])
    scene = auto(make_scene([Part(FLOOR), Part(screen)], [(place, 1e18 * np.ones(3))], look((0, 2, 3), (0, 0, 0))))
    assert (choose_precision(scene).name, choose_precision(scene).largest) == ("float32", 3.0)
    pictures = [rt.render(scene, size=(64, 64), precision=name).rgb for name in ("float32", "float64")]
    assert 0.1 < (pictures[1] > 0).mean() < 0.9
    assert np.isclose(*pictures, rtol=1e-5).all(axis=-1).mean() > 0.999  # but for a sample at the shadow's edge
    farther = dataclasses.replace(scene, lights=scene.lights._replace(position=np.array([[0, 1e13, 0]])))
    assert choose_precision(farther).why == "sizes leave 1e-12 .. 1e+12"  # the square of the distance


def test_triangles_without_area_are_no_features():
    mesh = make_scene([Part(FLOOR)]).mesh
    point, line = np.zeros((1, 3), np.int64), np.array([[0, 0, 1]])
    assert smallest_height(mesh) == pytest.approx(2**0.5)
    assert smallest_height(mesh._replace(faces=np.concatenate([mesh.faces, point, line]))) == pytest.approx(2**0.5)


def test_a_scene_without_area_has_a_plan_and_a_black_picture():
    scene = auto(make_scene([Part(FLOOR)], [LIGHT]))
    scene = dataclasses.replace(scene, mesh=scene.mesh._replace(vertices=0 * scene.mesh.vertices))
    precision = choose_precision(scene)
    assert (precision.name, precision.feature) == ("float32", np.inf)
    assert not rt.render(scene).rgb.any()


@pytest.mark.parametrize("asked", ["float32", "float64"])
def test_the_scene_s_wish_outranks_the_bound(asked):
    scene = rt.load(BOX)
    wished = dataclasses.replace(scene, settings=scene.settings._replace(precision=asked))
    assert rt.explain(wished).precision.name == asked
    assert rt.explain(wished).precision.why == "set by the scene"
    assert rt.render(wished, spp=1, size=(8, 8)).provenance["precision"] == asked


def test_a_wish_that_the_bound_contradicts_is_told_so():
    scene = moved(rt.load(BOX), shift=1e6)
    wished = dataclasses.replace(scene, settings=scene.settings._replace(precision="float32"))
    assert choose_precision(wished).why == "set by the scene; features below 1.6e+02 are not safe in float32"


def test_features_that_float64_can_not_tell_apart_are_told():
    sliver = np.array([[[0, 0, 0], [1, 0, 0], [0.5, 1e-13, 0]]])
    precision = choose_precision(auto(make_scene([Part(FLOOR), Part(sliver)], [LIGHT])))
    assert precision.name == "float64"
    assert precision.why.endswith("; features below 1.5e-12 are not safe in float64")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"background": np.array([0, 1e31, 0])}, True),
        ({"background": np.array([0, 1e-31, 0])}, True),
        ({"background": np.array([0, 1e29, 1e-29])}, False),
    ],
)
def test_levels_that_float32_can_not_hold_ask_for_float64(change, told):
    scene = dataclasses.replace(auto(make_scene([Part(FLOOR)], [LIGHT])), **change)
    assert (choose_precision(scene).why == "fluxes, background or indices leave 1e-30 .. 1e+30") == told
    assert (choose_precision(scene).name == "float64") == told


@pytest.mark.parametrize(
    ("lights", "material", "told"),
    [
        ({"type": "spot", "intensity": [1e31, 0, 0]}, {}, "intensities leave"),
        ({"type": "directional", "direction": [0, -1, 0], "irradiance": [1e-31, 0, 0]}, {}, "irradiances leave"),
        ({"type": "environment", "radiance": [1e31, 0, 0]}, {}, "radiances of the environment leave"),
        ({}, {"emission": [1e31, 1, 1]}, "emissions leave"),
        ({}, {"type": "conductor", "eta": [1, 1, 1], "k": [1, 1, 1e-31]}, "values of k leave"),
        ({}, {"type": "conductor", "eta": [1, 1, 1e-31], "k": [1, 1, 1]}, "values of eta leave"),
        ({}, {"type": "conductor", "reflectance": [1, 1, 1]}, "error of a point at most"),  # k is infinite: no lack
        ({"type": "spot", "position": [0, 1e13, 0]}, {}, "sizes leave"),
    ],
)
def test_levels_and_places_of_all_kinds_count(lights, material, told):
    spot = {"position": [0, 2, 0], "look_at": [0, 0, 0], "intensity": [1, 1, 1], "cutoff": 30}
    lights = spot | lights if lights.get("type") == "spot" else lights
    if material.get("type") != "conductor":
        material = {"type": "diffuse", "albedo": [0, 0, 0]} | material
    scene = {**TWO_SQUARES, "lights": [lights] if lights else [], "materials": {"m": material}}
    assert rt.explain(scene).precision.why.startswith(told)


def test_a_light_that_is_too_far_is_named_by_its_row_of_the_file():
    point = {"type": "point", "position": [0, 1, 0], "flux": [1, 1, 1]}
    spot = {"type": "spot", "position": [0, 1, 0], "look_at": [0, 0, 0], "intensity": [1, 1, 1], "cutoff": 30}
    sun = {"type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1]}
    lights = [spot, sun, point, {**spot, "position": [0, 1e80, 0]}, {**point, "position": [0, -1e80, 0]}]
    with pytest.raises(rt.SceneError) as caught:
        rt.explain({**TWO_SQUARES, "lights": lights})
    assert [line.split(": ")[1] for line in caught.value.problems] == ["lights[4]", "lights[3]"]


def test_a_transform_whose_terms_cancel_beyond_float64_is_refused():
    there, back = np.eye(4), np.eye(4)
    there[0, 3], back[0, 3] = 1e10, 1e15
    vertices = [[-1e10, 0, 0], [-1e10 + 1, 0, 0], [-1e10, 1, 0]]
    near = {"mesh": (vertices, [[0, 1, 2]]), "material": "m", "matrix": there.tolist()}
    assert rt.explain({**TWO_SQUARES, "objects": [near]}).precision.name == "float32"
    far = {"mesh": ([[x - (1e15 - 1e10), y, z] for x, y, z in vertices], [[0, 1, 2]]), "material": "m"}
    with pytest.raises(rt.SceneError, match=r"objects\[0\].*its transform adds numbers up to 2e\+15 to a size of 1"):
        rt.explain({**TWO_SQUARES, "objects": [{**far, "matrix": back.tolist()}]})


@pytest.mark.parametrize("shift", [1e14, 1e15])
def test_a_scene_that_no_precision_can_hold_is_refused_and_told_the_bound(shift):
    scene = moved(rt.load(BOX), shift=shift)
    error = GAMMA * 2.0**-53 * shift
    with pytest.raises(rt.SceneError, match=r"objects\[0\]: floor.obj has size 2, but") as caught:
        rt.explain(scene)
    assert len(caught.value.problems) == len(scene.objects)
    assert all(f"gamma(27) x {shift:.3g} = {error:.2g}" in problem for problem in caught.value.problems)
    assert all(str(BOX) in problem for problem in caught.value.problems)
    with pytest.raises(rt.SceneError):
        rt.render(scene, size=(8, 8), precision="float32")


def test_a_scene_just_within_float64_is_drawn():
    scene = moved(rt.load(BOX), shift=1e11)
    assert rt.explain(scene).precision.name == "float64"
    ask = {"spp": 1, "size": (32, 32)}
    there, here = rt.render(scene, **ask).rgb, rt.render(BOX, precision="float64", **ask).rgb
    assert np.isclose(there, here, rtol=0.01).all(axis=-1).mean() > 0.98  # but for pixels at edges


@pytest.mark.parametrize("part", ["camera", "light", "tiny"])
def test_what_leaves_the_range_of_float64_is_refused(part):
    scene = auto(make_scene([Part(FLOOR)], [LIGHT]))
    if part == "camera":
        scene = dataclasses.replace(scene, camera=look((0, 1e80, 1), (0, 0, 0)))
    elif part == "light":
        scene = dataclasses.replace(scene, lights=scene.lights._replace(position=np.array([[0, 1e80, 0]])))
    else:
        scene = moved(scene, scale=1e-80)
    said = {
        "camera": "camera: coordinates reach 1e",
        "light": "lights.0.: coordinates",
        "tiny": "can represent less than 1e-75",
    }
    with pytest.raises(rt.SceneError, match=said[part]):
        choose_precision(scene)


def test_a_small_object_near_the_origin_may_stand_beside_a_huge_one():
    """Half a micrometre beside the Earth."""
    speck, plain = 5e-7 * FLOOR, 6.4e6 * FLOOR - [0, 1, 0]
    scene = auto(make_scene([Part(speck), Part(plain)], [LIGHT], look((0, 1e-6, 1e-6), (0, 0, 0))))
    assert choose_precision(scene).name == "float64"


def test_the_bound_is_that_of_points_on_surfaces():
    """3 roundings of a coordinate and 12 of the triangle's extent, which is at most twice the largest coordinate."""
    assert hit_points.ROUNDINGS * (1 + 2 * hit_points.EXTENTS) == GAMMA


def test_the_limits_are_where_areas_and_their_errors_are_normal_numbers():
    for (low, high), dtype in ((FLOAT32_RANGE, np.float32), (FLOAT64_RANGE, np.float64)):
        kind = np.finfo(dtype)
        assert low**2 * float(kind.eps) > float(kind.tiny)
        assert high**2 < float(kind.max) / 100
    assert FLOAT64_RANGE[0] ** 4 > np.finfo(np.float64).tiny
    assert FLOAT64_RANGE[1] ** 4 < np.finfo(np.float64).max
    assert FLOAT32_LEVELS[1] * 100 < np.finfo(np.float32).max
