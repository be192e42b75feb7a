import numpy as np
import pytest

import rays
from raytrace.hardcases.meshes import CLOSED, choice, cubes, flat, joined, strip, turned, uniform


@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_are_closed_and_face_outwards(name):
    vertices, faces = CLOSED[name][0]()
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forth = {tuple(edge) for edge in edges.tolist()}
    assert len(forth) == len(edges)
    assert forth == {(b, a) for a, b in forth}  # each edge has a triangle on either side, turned alike
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = (a * np.cross(b, c)).sum() / 6
    assert 0.5 < volume <= 8


def test_touching_cubes_fill_a_cube():
    vertices, faces = cubes(3)
    assert len(faces) == 27 * 12
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    np.testing.assert_allclose((a * np.cross(b, c)).sum() / 6, 27)
    assert np.abs(vertices).max() == 1.5


@pytest.mark.parametrize("seed", range(5))
def test_flat_triangles_have_no_area(seed):
    vertices, faces = flat(seed)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a) == 0).all()
    kinds = (a == b).all(axis=1) * 4 + (b == c).all(axis=1) * 2 + (c == a).all(axis=1)
    assert {0, 1, 2, 7} <= set(kinds.tolist())  # collinear, two corners equal, points


def test_strips_hold_slivers_of_that_aspect():
    vertices, faces = strip(8, 1e6)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    heights = np.linalg.norm(np.cross(b - a, c - a), axis=1)  # the longest side is all but 1
    np.testing.assert_allclose(np.sort(heights)[:16], 1e-6)
    assert (np.sort(heights)[16:] > 0.4).all()
    np.testing.assert_allclose(heights.sum() / 2, 1)


def test_a_turn_keeps_lengths_and_angles_and_spares_no_axis():
    points = np.random.default_rng(1).normal(size=(20, 3))
    np.testing.assert_allclose(turned(points) @ turned(points).T, points @ points.T, atol=1e-12)
    assert np.linalg.det(turned(np.eye(3))) > 0
    assert np.abs(turned(np.eye(3))).min() > 0.1


def test_joined_meshes_keep_their_triangles():
    one, two = rays.cube(), rays.grid(2)
    vertices, faces = joined(one, two)
    assert np.array_equal(vertices[faces], np.concatenate([one[0][one[1]], two[0][two[1]]]))


def test_numbers_have_addresses():
    numbers = uniform(3, 5000, 2)
    assert np.array_equal(numbers[:100], uniform(3, 100, 2))
    assert not (uniform(4, 5000, 2) == numbers).any()
    assert -1 <= numbers.min() < -0.99
    assert 0.99 < numbers.max() < 1
    assert abs(numbers.mean()) < 4 / np.sqrt(3 * numbers.size)  # four standard errors
    assert abs(np.corrcoef(numbers.T)[0, 1]) < 4 / np.sqrt(5000)
    assert len(np.unique(numbers)) == numbers.size
    counts = np.unique(choice(5, [1.0, 2.0, 4.0], 3000), return_counts=True)
    assert counts[0].tolist() == [1, 2, 4]
    assert (np.abs(counts[1] - 1000) < 4 * np.sqrt(1000)).all()
