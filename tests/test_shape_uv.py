"""Texture coordinates of spheres, rectangles and boxes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from raytrace.scene.normals import face_normals
from raytrace.scene.shape_uv import box_uv, rectangle_uv, sphere_uv, turns
from raytrace.scene.shapes import box, make_shape, rectangle, unit_sphere

pytestmark = pytest.mark.nojit


def test_turns_agree_with_the_arctangent():
    rng = np.random.default_rng(3)
    y, x = rng.normal(size=(2, 20_000)) * np.exp(5 * rng.normal(size=(2, 20_000)))
    expected = np.array([math.atan2(b, a) / (2 * math.pi) % 1 for a, b in zip(x, y, strict=True)])
    np.testing.assert_allclose(turns(y, x), expected, rtol=0, atol=3e-16)
    corners = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
    eighths = turns(corners[:, 1], corners[:, 0]) * 8
    assert eighths.tolist() == [5, 4, 3, 6, 0, 2, 7, 0, 1]
    assert turns(np.array([-1e-300, -0.0]), np.array([1.0, 1.0])).tolist() == [0, 0]  # below 1


@pytest.mark.parametrize("n", [1, 2, 5, 30])
def test_the_uv_of_a_sphere(n):
    mesh = unit_sphere(n)
    uv, corners = sphere_uv(mesh), mesh.vertices[mesh.faces]
    x, y, z = corners.transpose(2, 0, 1)
    pole = (x == 0) & (z == 0)
    u = np.arctan2(x, z) / (2 * np.pi)
    np.testing.assert_allclose(uv[:, :, 1], 1 - np.arccos(np.clip(y, -1, 1)) / np.pi, rtol=0, atol=2e-8)
    assert (uv[pole][:, 1] == (y[pole] > 0)).all()
    apart = (uv[:, :, 0] - u)[~pole]
    np.testing.assert_allclose(apart, apart.round(), rtol=0, atol=1e-15)  # by whole turns
    spread = np.ptp(uv[:, :, 0], axis=1)
    assert spread.max() <= 0.25 + 1e-15  # no triangle goes the long way round
    assert uv[:, :, 0].min() == 0
    assert uv[:, :, 0].max() == 1
    inside = uv[:, :, 0].mean(axis=1)
    assert ((inside > 0) & (inside < 1)).all()
    np.testing.assert_allclose(inside % 1, np.arctan2(x.sum(axis=1), z.sum(axis=1)) / (2 * np.pi) % 1, atol=0.02)


def test_the_uv_of_a_rectangle():
    assert rectangle_uv(rectangle())[0].tolist() == [[0, 0], [1, 0], [1, 1]]


def test_the_uv_of_a_box_are_those_of_an_image_on_each_side_seen_from_outside():
    mesh = box()
    uv, corners, normals = box_uv(mesh), mesh.vertices[mesh.faces], face_normals(mesh)
    for at, places, normal in zip(corners, uv, normals, strict=True):
        assert sorted(set(places.ravel().tolist())) == [0, 1]
        edges = np.diff(at, axis=0).T
        gradient = np.diff(places, axis=0).T @ np.linalg.pinv(edges)  # of u and v along the side
        right, up = 2 * gradient
        np.testing.assert_allclose([right @ right, up @ up, right @ up], [1, 1, 0], atol=1e-14)
        np.testing.assert_allclose(np.cross(right, up), normal, atol=1e-14)  # not mirrored
        upright = [0, 1, 0] if normal[1] == 0 else [0, 0, -normal[1]]
        np.testing.assert_allclose(up, upright, atol=1e-14)


def test_shapes_have_uv_only_on_request():
    none = dict.fromkeys(("mesh", "sphere", "rectangle", "box"))
    for key, count in (("sphere", 8), ("rectangle", 2), ("box", 12)):
        entry = SimpleNamespace(**{**none, key: SimpleNamespace(tolerance=1.0)})
        assert make_shape(entry).uv is None
        assert make_shape(entry, uv=True).uv.shape == (count, 3, 2)
