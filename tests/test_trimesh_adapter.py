"""``raytrace.adapters.trimesh``: the ray queries of trimesh."""

import copy
import pickle

import numpy as np
import pytest
import trimesh

from raytrace.adapters.trimesh import RayMeshIntersector


def with_ray(mesh, **options):
    mesh.ray = RayMeshIntersector(mesh, **options)
    return mesh


@pytest.fixture(scope="module")
def nested():
    """A box in a box: up to four hits along a ray."""
    return with_ray(trimesh.util.concatenate([trimesh.creation.box(), trimesh.creation.box(extents=[0.5, 0.5, 0.5])]))


RAYS = np.array([[0.1, 0.05, 3], [0.4, 0.1, 3], [0.6, 0.1, 3.0]]), np.tile([0, 0, -2.0], (3, 1))


def test_all_hits_come_sorted_by_ray_and_distance(nested):
    locations, index_ray, index_tri = nested.ray.intersects_location(*RAYS)
    assert index_ray.tolist() == [0, 0, 0, 0, 1, 1]
    assert np.allclose(locations[:, 2], [0.5, 0.25, -0.25, -0.5, 0.5, -0.5], rtol=0, atol=1e-15)
    assert np.allclose(locations[:, :2], RAYS[0][index_ray, :2], rtol=0, atol=1e-15)
    normals = nested.face_normals[index_tri]
    assert (normals[:, 2] == np.sign(locations[:, 2])).all()
    assert [a.dtype for a in (locations, index_ray, index_tri)] == [np.float64, np.int64, np.int64]


def test_options_choose_the_first_hits(nested):
    ray = nested.ray
    every, _ = ray.intersects_id(*RAYS)
    first, of_ray = ray.intersects_id(*RAYS, multiple_hits=False)
    assert of_ray.tolist() == [0, 1]
    assert first.tolist() == [every[0], every[4]]
    some, of_ray = ray.intersects_id(*RAYS, max_hits=3)
    assert of_ray.tolist() == [0, 0, 0, 1, 1]
    assert some.tolist() == every[[0, 1, 2, 4, 5]].tolist()
    assert ray.intersects_first(*RAYS).tolist() == [every[0], every[4], -1]
    assert ray.intersects_first(*RAYS).dtype == np.int64
    assert ray.intersects_any(*RAYS).tolist() == [True, True, False]


def test_a_location_counts_once_but_all_its_triangles_are_hit():
    mesh = with_ray(trimesh.creation.box().subdivide().subdivide())
    down = np.array([[0.0, 0, 2], [0.125, 0, 2]]), np.tile([0, 0, -1.0], (2, 1))  # through a vertex; an edge's middle
    locations, index_ray, _ = mesh.ray.intersects_location(*down)
    assert index_ray.tolist() == [0, 0, 1, 1]
    assert locations[:, 2].tolist() == [0.5, -0.5, 0.5, -0.5]
    index_tri, index_ray = mesh.ray.intersects_id(*down)
    through = np.isclose(mesh.triangles[index_tri[index_ray == 0]][..., :2], 0).all(axis=2).any(axis=1)
    assert through.all()
    assert np.bincount(index_ray)[0] == np.isclose(mesh.triangles[..., :2], 0).all(axis=2).any(axis=1).sum()
    assert np.bincount(index_ray)[1] == 4


def test_shapes_of_no_hits_and_no_rays(nested):
    for rays in ((RAYS[0][2:], RAYS[1][2:]), (np.empty((0, 3)), np.empty((0, 3)))):
        locations, index_ray, index_tri = nested.ray.intersects_location(*rays)
        assert (locations.shape, index_ray.shape, index_tri.shape) == ((0, 3), (0,), (0,))
    assert nested.ray.contains_points(np.empty((0, 3))).shape == (0,)


def test_a_changed_mesh_gets_a_new_tree():
    mesh = with_ray(trimesh.creation.box())
    assert mesh.ray.intersects_location(*RAYS)[0][0, 2] == 0.5
    mesh.vertices[:, 2] *= 2  # in place
    assert mesh.ray.intersects_location(*RAYS)[0][0, 2] == 1
    mesh.apply_translation([0, 0, 1])
    assert mesh.ray.intersects_location(*RAYS)[0][0, 2] == 2
    mesh.update_faces(mesh.face_normals[:, 2] <= 0.5)  # no top
    assert mesh.ray.intersects_location(*RAYS)[0][0, 2] == 0


def test_contains_is_that_of_trimesh_away_from_the_surface(nested):
    points = np.random.default_rng(3).uniform(-0.6, 0.6, (300, 3))
    points = points[(np.abs(np.abs(points)[:, :, None] - [0.25, 0.5]) > 1e-3).all(axis=(1, 2))]
    inside = [(np.abs(points) < size).all(axis=1) for size in (0.5, 0.25)]
    assert (nested.contains(points) == (inside[0] ^ inside[1])).all()
    assert nested.ray.contains_points(nested.vertices).all()  # the surface belongs to the inside


def test_an_open_mesh_has_an_answer():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.update_faces(mesh.triangles_center[:, 2] < 0.9)  # a hole in the top
    points = np.array([[0, 0, 0], [0.3, 0.2, -0.4], [0, 0, 2], [0.8, 0.8, 0.8], [0.55, 0.75, 0.8]])
    # rays from the last point but one miss; from the first two, both directions cross once
    assert with_ray(mesh).contains(points).tolist() == [True, True, False, False, False]
    through_the_hole = -0.1 * np.array([0.4395064455, 0.617598629942, 0.652231566745]) + [0, 0, 0.6]
    assert mesh.contains([through_the_hole]).shape == (1,)


def test_copies_build_their_own_tree(nested):
    nested.ray.intersects_any(*RAYS)
    for twin in (copy.copy(nested.ray), copy.deepcopy(nested.ray), pickle.loads(pickle.dumps(nested.ray))):
        assert twin._built is None
        assert twin.intersects_any(*RAYS).tolist() == [True, True, False]


def test_distances_of_trimesh_use_it():
    pytest.importorskip("rtree", reason="trimesh finds closest points by rtree")
    sphere = with_ray(trimesh.creation.icosphere(subdivisions=2))
    inner = 0.5 * sphere.vertices[:5]
    assert (trimesh.proximity.signed_distance(sphere, inner) > 0.3).all()


def test_functions_of_trimesh_use_it(nested):
    longest = trimesh.proximity.longest_ray(nested, RAYS[0], RAYS[1])
    assert np.allclose(longest[:2], 2.5)
    assert longest[2] == np.inf
    assert trimesh.voxel.creation.voxelize_ray(nested, 0.25).filled_count > 0


def test_bad_rays_are_refused(nested):
    with pytest.raises(ValueError, match="different shapes"):
        nested.ray.intersects_any(RAYS[0], RAYS[1][:1])
    with pytest.raises(ValueError, match=r"expected \(n, 3\)"):
        nested.ray.intersects_any(RAYS[0][:, :2], RAYS[1][:, :2])
    with pytest.raises(ValueError, match=r"points: expected an \(n, 3\)"):
        nested.ray.contains_points([1, 2, 3])
