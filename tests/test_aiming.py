import numpy as np
import pytest

import rays
from raytrace.hardcases.aiming import bad_rays, edge_points, lattice, signed_axes, towards


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_edge_points_are_at_edges_and_vertices_and_a_few_ulps_beside(precision):
    vertices, faces = rays.cube()
    vertices = vertices + 4
    points = edge_points((vertices, faces), precision, seed=1)
    assert points.dtype == precision
    half = len(points) // 2
    assert half == 8 + 3 * 18
    assert np.array_equal(points[:8], vertices)
    ulps = (points[half:] - points[:half]) / np.spacing(points[:half].max(axis=1, keepdims=True))
    assert np.array_equal(ulps, np.round(ulps))
    assert set(np.unique(ulps)) == {-3, -2, -1, 0, 1, 2, 3}
    # on an edge of the cube two coordinates are those of its corners, on a diagonal one
    assert (np.isin(points[:half], (3, 5)).sum(axis=1) >= 1).all()


def test_rays_lead_from_every_origin_to_every_target():
    o, d = towards([[0, 0, 1], [5, 5, 5]], np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.float32))
    assert d.dtype == np.float32
    assert (o + d).tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]] * 2


def test_lattice_rays_are_small_integers_with_a_direction():
    o, d = lattice(500, seed=2)
    assert np.array_equal(o, np.round(o))
    assert set(np.abs(o).ravel()) == {0, 1, 2, 3, 4}
    assert set(np.abs(d).ravel()) == {0, 1, 2}
    assert (d != 0).any(axis=1).all()
    assert np.signbit(d[d == 0]).any()
    assert not np.signbit(d[d == 0]).all()


def test_axes_come_with_zeros_of_both_signs():
    axes = signed_axes()
    assert len({axis.tobytes() for axis in axes}) == 24
    assert ((axes == 0).sum(axis=1) == 2).all()


def test_bad_rays_are_bad_each_in_one_way():
    o, d = bad_rays()
    bad = ~np.isfinite(o).all(axis=1) | ~np.isfinite(d).all(axis=1) | (d == 0).all(axis=1)
    assert bad.all()
    assert ((~np.isfinite(o)).sum(axis=1) + (~np.isfinite(d)).sum(axis=1))[:18].tolist() == [1] * 18
