"""Points inside closed meshes: what counts as closed, and the surface itself."""

import pickle
from collections import Counter

import numpy as np
import pytest

import rays
import raytrace as rt
from raytrace.accel.closed import open_edges, point_numbers
from raytrace.accel.inside import closure_of

PRECISIONS = ["float32", "float64"]


@pytest.mark.nojit
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_surface_is_inside(precision):
    bvh = rt.BVH(*rays.cube(), precision)
    values = [-2.0, -1.0, 0.0, 1.0]
    points = np.stack(np.meshgrid(values, values, values), axis=-1).reshape(-1, 3)
    beside = np.nextafter(np.array([1.0, 0.25, 0.25], precision), np.array([2, 0.25, 0.25], precision))
    points = np.concatenate([points, [[1, 0.25, 0.25]], [beside]])
    assert np.array_equal(bvh.contains(points), (np.abs(points) <= 1).all(axis=1))


def test_points_on_walls_along_the_rays_are_inside():
    """Triangles whose planes hold the direction of the rays, and triangles without area, which hold nothing."""
    bvh = rt.BVH(*rays.cube(), "float64")
    x, y, z = closure_of(bvh).direction
    corners = np.array([[0, 0, 0], [x, y, z], [1, 0, 0], [0, 1, 0]])  # two sides hold the direction
    bvh = rt.BVH(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], "float64")
    bvh._closure = closure_of(bvh)._replace(direction=np.array([x, y, z]))
    share = np.array([[0.25, 0.5], [0.5, 0.25], [0.5, 0.0], [0.0, 0.5], [1.0, 0.0], [0.0, 0.0]])
    points = share[:, :1] * corners[1] + share[:, 1:] * [1, 0, 0]  # exact: the weights are powers of two
    assert bvh.contains(points).all()
    flat = [[0, 0, 0], [0, 0, 3], [0, 0, 5]]
    vertices, faces = rays.joined(rays.cube(), (np.array(flat, float), np.array([[0, 1, 2], [0, 1, 2]])))
    assert rt.BVH(vertices, faces).contains([[0, 0, 4], [0, 0, 0.5]]).tolist() == [False, True]


def test_points_that_are_not_finite_are_outside():
    bvh = rt.BVH(*rays.cube())
    points = np.zeros((6, 3))
    points[:3] = np.diag([np.nan, np.inf, -np.inf])
    points[4] = 1e300  # beyond float32
    assert bvh.contains(points).tolist() == [False, False, False, True, False, True]
    assert bvh.contains([0, 0, 0]).tolist() == [True]
    assert bvh.contains(np.zeros((0, 3))).shape == (0,)
    with pytest.raises(ValueError, match=r"^points: expected an array of shape .* got shape \(1, 2\)"):
        bvh.contains([[0, 0]])


def test_overlapping_bodies_count_by_parity():
    vertices, faces = rays.joined(rays.cube(), (rays.cube()[0] + [1, 0, 0], rays.cube()[1]))
    bvh = rt.BVH(vertices, faces)
    assert bvh.contains([[-0.5, 0, 0], [0.5, 0, 0], [1.5, 0, 0]]).tolist() == [True, False, True]
    turned = rt.BVH(vertices, np.concatenate([faces[:12, ::-1], faces[12:]]))
    assert turned.contains([[-0.5, 0, 0], [0.5, 0, 0], [1.5, 0, 0]]).tolist() == [True, False, True]


def test_an_open_mesh_is_an_error_that_names_the_first_edge():
    vertices, faces = rays.cube()
    bvh = rt.BVH(vertices, faces[:-1])
    message = (
        r"^contains: the mesh is not closed: 3 edges are a side of an odd number of triangles; the first is the edge "
        r"from \(-?1, -?1, -?1\) to \(-?1, -?1, -?1\) of triangle \d+; fill the holes first$"
    )
    for _ in range(2):
        with pytest.raises(ValueError, match=message):
            bvh.contains([[0, 0, 0]])
    edges = open_edges(bvh.vertices, bvh.faces)
    ends = {tuple(end.tolist()) for end in edges.first}
    assert ends < {tuple(vertices[k].tolist()) for k in faces[-1]}
    assert ends < {tuple(vertices[k].tolist()) for k in faces[edges.triangle]}
    assert bvh.count_hits([0, 0, 0], [0.1, 0.2, 1], crossings=True).shape == (1,)


def test_edges_are_matched_by_position():
    vertices, faces = rays.icosphere(1)
    corners = vertices[faces].reshape(-1, 3)
    corners[corners == 0] *= np.random.default_rng(4).choice([-1, 1], (corners == 0).sum())  # -0 is 0
    apart = np.arange(len(corners)).reshape(-1, 3)
    assert open_edges(corners, apart).count == 0
    assert rt.BVH(corners, apart).contains([[0, 0, 0]]).all()
    twice = np.concatenate([faces, faces[:5]])
    sides = Counter(frozenset((face[k], face[k - 1])) for face in twice.tolist() for k in range(3))
    assert open_edges(vertices, twice).count == sum(count % 2 for count in sides.values()) > 0
    repeated = np.concatenate([faces, faces[:, [0, 0, 0]], faces[:, [0, 1, 1]]])
    assert open_edges(vertices, repeated).count == 0
    moved = corners.copy()
    moved[7] = np.nextafter(moved[7], 9)
    assert open_edges(moved, apart).count == 4


def test_position_numbers_survive_equal_hashes(monkeypatch):
    vertices = np.array([[1.0, 2, 3], [3, 2, 1], [1, 2, 3], [0, 0, 0], [-0.0, 0, -0.0]])
    expected = point_numbers(vertices)
    assert len({*expected.tolist()}) == 3
    monkeypatch.setattr("raytrace.accel.closed.MIX", (0, 0, 0))
    number = point_numbers(vertices)
    assert np.array_equal(number[:, None] == number, expected[:, None] == expected)


def test_the_check_is_kept_and_pickled():
    bvh = rt.BVH(*rays.cube())
    assert bvh._closure is None
    assert bvh.contains([[0, 0, 0]]).all()
    known = bvh._closure
    assert bvh.contains([[0, 0, 0]]).all()
    assert bvh._closure is known
    copied = pickle.loads(pickle.dumps(bvh))
    assert copied._closure.vertices is copied.vertices
    assert copied.contains([[0, 0, 0]]).all()
