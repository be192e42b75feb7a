"""Polygons to triangles: areas, outlines and orientation, of every kind of polygon that files hold."""

import subprocess
import sys

import numpy as np
import pytest

from raytrace.scene.meshes import polygons
from raytrace.scene.meshes.obj import ObjError, read_obj
from raytrace.scene.meshes.ply import read_ply
from raytrace.scene.meshes.polygons import PolygonError, fan, triangulate
from raytrace.scene.transforms import rotation

CHEVRON = [[0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]]  # area 1
L_SHAPE = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]]  # area 3
COMB = [[0, 0, 0], *([x / 2 + 0.5, 2 - x % 2 * 1.5, 0] for x in range(19)), [10, 0, 0]]
KEYHOLE = [[0, 0], [3, 0], [3, 3], [0, 3], [0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1]]  # a hole, area 8
SPIRAL = [[r * np.cos(a), r * np.sin(a), 0] for a in np.linspace(0, 9, 60) for r in [a + 2]]
SPIRAL += [[r * np.cos(a), r * np.sin(a), 0] for a in np.linspace(9, 0, 60) for r in [a + 1]]


def one(points):
    points = np.array(points, np.float64)
    if points.shape[1] == 2:
        points = np.append(points, np.zeros((len(points), 1)), axis=1)
    return points, triangulate(points, np.arange(len(points)), np.array([len(points)]))


def areas(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def newell(points):
    moved = points - points[0]
    return np.cross(moved, np.roll(moved, -1, axis=0)).sum(axis=0) / 2


def check(points, triangles):
    """The triangles cover the polygon once, with its orientation and all of its corners and edges."""
    found, whole = areas(points, triangles), newell(points)
    size = np.linalg.norm(whole)
    assert np.linalg.norm(found, axis=1).sum() == pytest.approx(size, rel=3e-6)
    np.testing.assert_allclose(found.sum(axis=0), whole, atol=1e-12 * size)
    assert len(triangles) == len(points) - 2
    directed = {(a, b) for t in triangles.tolist() for a, b in zip(t, t[1:] + t[:1], strict=True)}
    outline = {edge for edge in directed if edge[::-1] not in directed}
    assert outline == {(k, (k + 1) % len(points)) for k in range(len(points))}


@pytest.mark.parametrize("shape", [CHEVRON, L_SHAPE, COMB, SPIRAL], ids=["chevron", "L", "comb", "spiral"])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
def test_concave_polygons_are_covered_whichever_corner_is_first(shape, turned, reverse):
    points = np.array(shape, float)[:: -1 if reverse else 1]
    if turned:
        points = points @ rotation((1, 2, 3), 40).T * 1e-3 + (5, -7, 2)
    for first in range(len(points)):
        check(*one(np.roll(points, first, axis=0)))


def test_random_stars_are_covered():
    rng = np.random.default_rng(4)
    clipped = 0
    for _ in range(300):
        n = int(rng.integers(4, 50))
        angles = 2 * np.pi * (np.arange(n) + rng.random(n) * 0.9) / n
        radii = rng.uniform(0.05, 1, n)
        points = np.stack([radii * np.cos(angles), radii * np.sin(angles), 0 * radii], axis=1)
        points, triangles = one(points @ rotation(rng.normal(size=3).tolist(), 77).T)
        check(points, triangles)
        clipped += not np.array_equal(triangles, fan(np.array([n])))
    assert clipped > 250


@pytest.mark.parametrize("n", [4, 5, 6, 12, 100])
def test_convex_polygons_keep_their_fan(n):
    angles = 2 * np.pi * np.arange(n) / n
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1) @ rotation((3, 1, 2), 20).T
    for places in (points, points.astype(np.float32), np.round(points, 6)):  # as files round them
        assert np.array_equal(one(places)[1], fan(np.array([n])))
    midpoints = np.stack([points, (points + np.roll(points, -1, axis=0)) / 2], axis=1).reshape(-1, 3)
    for places in (midpoints, midpoints.astype(np.float32)):  # with corners in the midst of edges
        assert np.array_equal(one(places)[1], fan(np.array([2 * n])))


@pytest.mark.parametrize("scale", [1e-150, 1e-90, 1e-40, 1e40, 1e75])
def test_the_scale_does_not_matter(scale):
    assert np.array_equal(one(np.array(CHEVRON) * scale)[1], one(CHEVRON)[1])
    big = np.array(COMB) * scale
    assert np.array_equal(one(big)[1], one(COMB)[1])


def test_corners_on_an_edge_stay_and_leave_no_crack():
    straight = np.insert(np.array(COMB, float), [1, 1, 1], [[0.2, 0.8, 0], [0.25, 1, 0], [0.4, 1.6, 0]], axis=0)
    check(*one(straight))
    long = [[x, 0, 0] for x in range(20, -1, -1)] + [[-1, 3, 0], [5, 1, 0], [10, 3, 0], [15, 1, 0], [21, 3, 0]]
    check(*one(long))


def test_a_hole_that_is_joined_to_the_outline_stays_a_hole():
    points, triangles = one(KEYHOLE)
    assert np.linalg.norm(areas(points, triangles), axis=1).sum() == pytest.approx(8)
    centres = points[triangles].mean(axis=1)[:, :2]
    assert not ((centres > 1) & (centres < 2)).all(axis=1).any()


def test_polygons_that_are_not_planar_are_seen_along_their_normal():
    rng = np.random.default_rng(2)
    for shape in (L_SHAPE, COMB):
        points = np.array(shape, float)
        points[:, 2] += rng.normal(size=len(points)) * 0.05
        points, triangles = one(points @ rotation((1, 1, 0), 70).T)
        found = areas(points, triangles) @ newell(points)
        assert (found > 0).all()  # no fold
        assert found.sum() == pytest.approx(newell(points) @ newell(points))


@pytest.mark.parametrize(
    "points",
    [
        [[0, 0], [1, 1], [1, 0], [0, 1]],  # a bow tie
        [[0, 0], [2, 2], [2, 0], [0, 1]],
        [[0, 0], [1, 0], [2, 0], [1, 0]],  # there and back
        [[1, 1]] * 6,
        [[0, 0], [1, 0], [1, 1], [1, 0], [0, 1]],  # a spike
        [[np.cos(4 * np.pi * k / 5), np.sin(4 * np.pi * k / 5)] for k in range(5)],  # a pentagram
        [[0, 0], [0, 0], [2, 1], [2, 1], [0, 2], [1, 1], [1, 1], [0, 0]],  # every corner twice
        np.random.default_rng(0).random((40, 2)),
        [[0, 0], [np.nan, 0], [1, 1], [0.2, 0.2]],
        [[0, 0], [np.inf, 0], [1, 1], [0.2, 0.2]],
        [[0, 0], [1e308, -1e308], [-1e308, 1e308], [1e308, 1e308], [0, 1e300]],
    ],
    ids=range(11),
)
def test_polygons_without_a_right_answer_give_triangles_of_theirs(points):
    points, triangles = one(points)
    assert 0 < len(triangles) <= len(points) - 2
    assert triangles.min() >= 0
    assert triangles.max() < len(points)


def test_many_polygons_are_triangulated_each_by_itself(monkeypatch):
    monkeypatch.setattr(polygons, "BLOCK", 7)
    shapes = [CHEVRON, [[0, 0, 0], [1, 0, 0], [0, 1, 0]], COMB, L_SHAPE, CHEVRON[1:] + CHEVRON[:1], KEYHOLE]
    shapes = [np.array([[*p, 0][:3] for p in shape], float) + (0, 0, k) for k, shape in enumerate(shapes * 3)]
    sizes = np.array([len(shape) for shape in shapes])
    found = triangulate(np.concatenate(shapes), np.arange(sizes.sum()), sizes)
    expected, before = [], 0
    for shape in shapes:
        expected.append(one(shape)[1] + before)
        before += len(shape)
    assert np.array_equal(found, np.concatenate(expected))


def test_both_readers_triangulate_and_normals_follow():
    text = "".join("v {} {} {}\n".format(*p) for p in CHEVRON) + "vn 0 0 1\nvn 0 0 2\nvn 0 0 3\nvn 0 0 4\n"
    mesh = read_obj((text + "f 1//1 2//2 3//3 4//4\n").encode())
    assert np.array_equal(mesh.faces, mesh.normal_faces)
    assert np.linalg.norm(areas(mesh.vertices, mesh.faces), axis=1).sum() == pytest.approx(1)
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    again = read_ply((head + "".join("{} {} {}\n".format(*p) for p in CHEVRON) + "4 0 1 2 3\n").encode())
    assert np.array_equal(again.faces, mesh.faces)


def test_what_would_take_minutes_is_refused(monkeypatch):
    zigzag = [[x, x % 2, 0] for x in range(60)] + [[60, -1, 0], [0, -1, 0]]
    text = "".join("v {} {} {}\n".format(*p) for p in zigzag) + ("f " + " ".join(map(str, range(1, 63))) + "\n") * 3
    assert len(read_obj(text.encode()).faces) == 180
    monkeypatch.setattr(polygons, "MAX_CLIPPING", 2 * 62**2)
    with pytest.raises(ObjError, match="up to here, concave polygons have 186 corners: too many; export tri") as caught:
        read_obj(text.encode())
    assert caught.value.line == 65
    monkeypatch.setattr(polygons, "MAX_CORNERS", 61)
    with pytest.raises(PolygonError, match="a concave polygon of 62 corners; at most 61: export triangles"):
        one(zigzag)


@pytest.mark.parametrize(("shape", "loaded"), [(L_SHAPE[:4], False), (L_SHAPE, False), (COMB, True)])
def test_the_library_is_loaded_only_for_large_concave_polygons(shape, loaded):
    program = "import sys, numpy as np; from raytrace.scene.meshes.polygons import triangulate\n"
    program += f"triangulate(np.array({shape}, float), np.arange({len(shape)}), np.array([{len(shape)}]))\n"
    program += "print('mapbox_earcut' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == str(loaded)
