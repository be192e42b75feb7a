"""Spheres, rectangles and boxes of scenes: their triangles, their normals, their limits."""

import hashlib
import tracemalloc
from collections import Counter

import numpy as np
import pytest

from raytrace.errors import FileError, SceneError
from raytrace.limits import MAX_TRIANGLES
from raytrace.records import RawMesh
from raytrace.scene.load import load
from raytrace.scene.normals import face_normals
from raytrace.scene.shapes import FLATNESS, ShapeSize, box, rectangle, sphere_frequency, unit_sphere
from scene_files import scene

pytestmark = pytest.mark.nojit


def shape(**keys):
    """The mesh of a scene of one object."""
    return load(scene(objects=[{"material": "white", **keys}])).mesh


def ball(**keys):
    return {"center": [0, 0, 0], "radius": 1, **keys}


def sides(mesh):
    """Each directed edge, with how often it occurs."""
    faces = mesh.faces
    return Counter(zip(faces.ravel().tolist(), np.roll(faces, -1, axis=1).ravel().tolist(), strict=True))


def depth(mesh):
    """The most that the triangles lie within the unit sphere; a plane's distance bounds that of its triangle."""
    return 1 - (face_normals(mesh) * mesh.vertices[mesh.faces[:, 0]]).sum(axis=1).min()


# The sphere -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 30])
def test_a_sphere_is_closed_its_fronts_face_outwards_and_its_vertices_lie_on_it(n):
    mesh = unit_sphere(n)
    assert (len(mesh.faces), len(mesh.vertices)) == (8 * n * n, 4 * n * n + 2)
    edges = sides(mesh)
    assert all((count, edges[b, a]) == (1, 1) for (a, b), count in edges.items())
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=0, atol=3e-16)
    assert ((face_normals(mesh) * mesh.vertices[mesh.faces].mean(axis=1)).sum(axis=1) > 0).all()
    assert not np.signbit(mesh.vertices[mesh.vertices == 0]).any()


def test_the_depth_of_a_sphere_stays_below_its_bound():
    for n in [*range(1, 60), 150, 400]:
        assert depth(unit_sphere(n)) * n * n < FLATNESS
    assert 1.02 * max(depth(unit_sphere(n)) * n * n for n in range(1, 60)) > FLATNESS


@pytest.mark.parametrize("tolerance", [1.0, 0.5, 0.2, 0.05, 1e-2, 1e-3, 3e-5])
def test_a_sphere_keeps_its_tolerance_with_few_triangles(tolerance):
    n = sphere_frequency(tolerance)
    assert depth(unit_sphere(n)) <= tolerance
    if n > 2:
        assert depth(unit_sphere(n - 2 - n // 50)) > tolerance


def test_triangles_of_a_sphere_have_similar_sizes():
    mesh = unit_sphere(30)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert area.max() < 2 * area.min()


def test_poles_and_the_half_circle_towards_z_are_along_edges():
    """So that texture coordinates can have their seam there."""
    mesh = unit_sphere(5)
    x, y, z = mesh.vertices[mesh.faces].transpose(2, 0, 1)
    for axis in (x, y, z):
        assert not ((axis.min(axis=1) < 0) & (axis.max(axis=1) > 0)).any()
    assert (np.abs(mesh.vertices[:, 1]) == 1).sum() == 2


def test_the_bits_of_a_sphere_do_not_depend_on_the_machine():
    digest = hashlib.sha256(unit_sphere(20).vertices.astype("<f8").tobytes()).hexdigest()
    assert digest == "e8c2e76295911c76252162c0e693aaeef91987303ce374a7332f1f908d9cf58b"


def test_centre_and_radius_place_a_sphere():
    mesh = shape(sphere=ball(center=[1, 2, 3], radius=0.5, tolerance=0.1))
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - [1, 2, 3], axis=1), 0.5, atol=1e-15)
    assert len(mesh.faces) == 8 * 3**2


def test_the_transform_moves_the_centre_as_well():
    turn = {"axis": [0, 0, 1], "angle": 90}
    mesh = shape(sphere=ball(center=[1, 0, 0], radius=0.5), scale=2, rotate=turn, translate=[0, 0, 5])
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - [0, 2, 5], axis=1), 1, atol=1e-15)


@pytest.mark.parametrize("flip", [False, True])
def test_a_smooth_sphere_has_its_exact_normals_also_as_an_ellipsoid(flip):
    scale = np.array([1.0, -2.0, 0.5])
    mesh = shape(sphere=ball(tolerance=0.05), scale=scale.tolist(), normals="smooth", flip=flip)
    exact = mesh.vertices / scale**2
    exact *= (-1 if flip else 1) / np.linalg.norm(exact, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, exact[mesh.faces], atol=1e-15)
    assert ((mesh.normals.sum(axis=1) * face_normals(RawMesh(mesh.vertices, mesh.faces, None, None))).sum(1) > 0).all()


def test_a_flat_sphere_has_no_normals():
    assert shape(sphere=ball()).normals is None


# Rectangle and box ----------------------------------------------------------------------------------------------------


def test_a_rectangle_faces_plus_z():
    mesh = rectangle()
    assert face_normals(mesh).tolist() == [[0, 0, 1]] * 2
    assert mesh.vertices.min(axis=0).tolist() == [-1, -1, 0]
    assert mesh.vertices.max(axis=0).tolist() == [1, 1, 0]
    corners = mesh.vertices[mesh.faces]
    assert np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].tolist() == [4, 4]


def test_a_box_is_closed_and_its_fronts_face_outwards():
    mesh = box()
    edges = sides(mesh)
    assert all((count, edges[b, a]) == (1, 1) for (a, b), count in edges.items())
    normals, middles = face_normals(mesh), mesh.vertices[mesh.faces].mean(axis=1)
    assert ((normals * middles).sum(axis=1) == 1).all()
    assert Counter(map(tuple, normals.tolist())) == {tuple(s * row): 2 for row in np.eye(3) for s in (1.0, -1.0)}


def test_shapes_are_named_after_what_they_are():
    entries = [{"box": {}}, {"sphere": ball()}, {"rectangle": {}}, {"box": {}, "scale": 2}]
    found = load(scene(objects=[{"material": "white", **entry} for entry in entries]))
    assert found.objects == ("box", "sphere", "rectangle", "box (2)")
    assert found.warnings == ()


# Transforms -----------------------------------------------------------------------------------------------------------

MATRIX = [[0, -2, 0, 1], [3, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
MIRROR = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def test_a_matrix_maps_column_vectors():
    points = np.c_[rectangle().vertices, np.ones(4)]
    assert shape(rectangle={}, matrix=MATRIX).vertices.tolist() == (points @ np.array(MATRIX).T)[:, :3].tolist()


def test_a_matrix_equals_the_same_scale_rotation_and_translation():
    apart = shape(box={}, scale=[3, 2, 1], rotate={"axis": [0, 0, 1], "angle": 90}, translate=[1, 2, 3])
    together = shape(box={}, matrix=MATRIX)
    assert apart.vertices.tolist() == together.vertices.tolist()
    assert apart.faces.tolist() == together.faces.tolist()


def test_rotations_are_applied_in_order():
    y, x = {"axis": [0, 1, 0], "angle": 90}, {"axis": [1, 0, 0], "angle": 90}
    first = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    second = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    corners = rectangle().vertices * [3, 1, 1]
    found = shape(rectangle={}, scale=[3, 1, 1], rotate=[y, x])
    assert found.vertices.tolist() == (corners @ (second @ first).T).tolist()
    assert shape(rectangle={}, rotate=[]).vertices.tolist() == rectangle().vertices.tolist()


def test_a_list_of_one_rotation_has_the_bits_of_the_rotation():
    turn = {"axis": [1, 2, 3], "angle": 17}
    one, several = shape(box={}, rotate=turn), shape(box={}, rotate=[turn])
    assert one.vertices.tobytes() == several.vertices.tobytes()


@pytest.mark.parametrize("normals", ["flat", "smooth"])
@pytest.mark.parametrize("matrix", [MATRIX, MIRROR], ids=["keeps", "mirrors"])
@pytest.mark.parametrize("flip", [False, True])
def test_fronts_stay_outside_under_any_matrix_and_flip_turns_them_inside(matrix, flip, normals):
    mesh = shape(sphere=ball(tolerance=0.1), matrix=matrix, flip=flip, normals=normals)
    away = mesh.vertices[mesh.faces].mean(axis=1) - mesh.vertices.mean(axis=0)
    ng = face_normals(RawMesh(mesh.vertices, mesh.faces, None, None))
    sign = -1 if flip else 1
    assert (sign * (ng * away).sum(axis=1) > 0).all()
    if normals == "smooth":
        assert (sign * (mesh.normals.sum(axis=1) * away).sum(axis=1) > 0).all()


def test_a_mesh_of_triangles_is_flipped_with_its_averaged_normals():
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    mesh = shape(mesh=corners, flip=True, normals="smooth")
    assert mesh.faces.tolist() == [[0, 2, 1]]
    assert mesh.normals.tolist() == [[[0, 0, -1]] * 3]


def test_the_sign_of_a_determinant_is_exact():
    """In float64 this one is 0, or has the wrong sign, whatever the order of the sums."""
    tiny = [[1e-200, 0, 0, 0], [0, 1e-200, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]
    plain = [[1e-200, 0, 0, 0], [0, 1e-200, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert shape(box={}, matrix=tiny).faces.tolist() == box().faces[:, [0, 2, 1]].tolist()
    assert shape(box={}, matrix=plain).faces.tolist() == box().faces.tolist()
    e = 2.0**-52
    almost = [[1, 1, 0, 0], [1, 1 - e, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]  # its determinant is -e
    assert shape(box={}, matrix=almost).faces.tolist() == box().faces[:, [0, 2, 1]].tolist()


# Limits ---------------------------------------------------------------------------------------------------------------


def test_a_sphere_of_too_many_triangles_is_refused_before_it_is_made():
    count = ShapeSize(8 * sphere_frequency(1e-8) ** 2, 0).triangles
    assert count > MAX_TRIANGLES
    with pytest.raises(FileError, match=rf"objects\[0\].sphere: with this object there are {count:,} triangles; at"):
        shape(sphere=ball(tolerance=1e-8))


def test_a_sphere_takes_no_more_memory_than_is_allowed():
    entries = [{"sphere": ball(tolerance=1e-5), "material": "white"}]
    with pytest.raises(FileError, match=r"objects\[0\].sphere: memory: the scene, of 696,200 triangles"):
        load(scene(objects=entries), max_memory=1)


def test_making_a_sphere_takes_the_memory_that_is_estimated():
    tracemalloc.start()
    n = 200
    unit_sphere(n)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    estimate = ShapeSize(8 * n * n, 4 * n * n + 2).making()
    assert peak <= estimate < 1.5 * peak


def test_many_spheres_share_one_mesh():
    entries = [{"sphere": ball(center=[k, 0, 0], radius=k + 1, tolerance=1e-2), "material": "white"} for k in range(9)]
    assert len(load(scene(objects=entries)).mesh.faces) == 9 * 8 * sphere_frequency(1e-2) ** 2


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"sphere": ball(center=[1e20, 1e20, 1e20])}, "even in float64 all of it is one point"),
        ({"sphere": ball(radius=1e200)}, "coordinates reach 1e+200 in the world"),
        ({"sphere": ball(radius=1e200), "scale": 1e200}, "coordinates reach inf in the world"),
        ({"box": {}, "rotate": [{"axis": [0, 1, 0], "angle": 1}, {"axis": [0, 0, 0], "angle": 1}]}, "no direction"),
    ],
    ids=["point", "large", "infinite", "axis"],
)
def test_shapes_that_cannot_be_placed_are_errors(keys, told):
    with pytest.raises(SceneError, match=r"objects\[0\]") as caught:
        shape(**keys)
    assert told in str(caught.value)
