"""The oracle's integers against its twin's fractions."""

from fractions import Fraction

import numpy as np
import pytest

import exact
import rays
from raytrace.hardcases.oracle import EDGE, INTERIOR, VERTEX, Oracle

KINDS = {"interior": INTERIOR, "edge": EDGE, "vertex": VERTEX}


def agree(corners, o, d):
    """Compare every pair with the twin; how many cross in each way."""
    crossings = Oracle(corners, o, d).crossings
    found = {(int(ray), int(prim)): k for k, (ray, prim) in enumerate(zip(crossings.ray, crossings.prim, strict=True))}
    seen = dict.fromkeys((*KINDS, "coplanar", "miss"), 0)
    for i in range(len(o)):
        for j in range(len(corners)):
            expected = exact.classify(corners[j], o[i], d[i])
            seen[expected.kind] += 1
            assert ((i, j) in found) == (expected.kind in KINDS)
            if expected.kind in KINDS:
                k = found[i, j]
                assert crossings.kind[k] == KINDS[expected.kind]
                got = crossings.t[k], crossings.u[k], crossings.v[k]
                assert got == tuple(map(float, (expected.t, expected.u, expected.v)))
    return seen


def test_lattice_rays_cross_as_the_twin_says():
    corners = np.floor(np.random.default_rng(1).uniform(-2, 3, (40, 3, 3)))
    corners = np.unique(corners.reshape(-1, 9), axis=0).reshape(-1, 3, 3)  # of equal triangles only the first is told
    seen = agree(corners, *rays.lattice(150, seed=2))
    assert min(seen.values()) > 20, seen


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_aimed_rays_cross_as_the_twin_says(precision):
    vertices, faces = rays.cube()
    vertices = (vertices * 0.3 + 0.1).astype(precision)
    targets = rays.edge_points((vertices, faces), precision, seed=3)[::3]
    seen = agree(vertices[faces], *rays.towards([[0.05, 0.02, 0.1], [2, 3, -1]], targets))
    assert seen["interior"] > 100  # beside edges, by less than float64 can tell


@pytest.mark.parametrize("far", [1e-30, 1e3, 1e12])
def test_numbers_of_very_different_size_cross_as_the_twin_says(far):
    rng = np.random.default_rng(4)
    corners = rng.normal(size=(12, 3, 3)) * 10.0 ** rng.integers(-12, 3, (12, 1, 1))
    targets = np.einsum("ij,ijk->ik", rng.dirichlet([0.3] * 3, 12), corners)
    o = rng.normal(size=(12, 3)) * far
    d = (targets - o) * 10.0 ** rng.integers(-20, 20, (12, 1))
    d[::4, 0] = 5e-324
    seen = agree(corners, o, d)
    assert seen["interior"] >= 5


@pytest.mark.parametrize("power", [-300, -40, 40, 300])
def test_size_and_length_change_only_the_unit(power):
    vertices, faces = rays.icosphere(1)
    o, d = rays.towards([[0.1, 0.2, 0.3]], rays.edge_points((vertices, faces), "float64", seed=5))
    plain = Oracle(vertices[faces], o, d).crossings
    scale = 2.0**power
    large = Oracle(vertices[faces] * scale, o * scale, d).crossings
    long = Oracle(vertices[faces], o, d * scale).crossings
    for name in ("ray", "prim", "kind", "u", "v", "cosine"):
        assert np.array_equal(getattr(plain, name), getattr(large, name))
        assert np.array_equal(getattr(plain, name), getattr(long, name))
    assert np.array_equal(plain.t * scale, large.t)
    assert np.array_equal(plain.t / scale, long.t)
    assert np.array_equal(plain.edge * scale, large.edge)
    assert np.array_equal(plain.height, long.height)


def test_edges_heights_and_cosines_are_those_of_the_picture_along_the_ray():
    oracle = Oracle([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], [[1, 1, 3], [1, 1, 3]], [[0, 0, -4], [0, 3, -3]])
    crossings = oracle.crossings
    assert crossings.ray.tolist() == [0]
    np.testing.assert_allclose(crossings.edge, [[2**0.5, 1, 1]])
    np.testing.assert_allclose(crossings.cosine, 1)
    np.testing.assert_allclose(crossings.height, 8**0.5)  # over the longest side
    slanted = Oracle([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], [[1, 0.5, 0.5]], [[0, 1, -1]]).crossings
    np.testing.assert_allclose(slanted.edge[0, 2], 0.5**0.5)  # y = 1 is seen at 45 degrees
    np.testing.assert_allclose(slanted.cosine, 0.5**0.5)


def test_of_equal_triangles_the_first_is_told():
    triangle = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]
    oracle = Oracle([np.ones((3, 3)), triangle, triangle, triangle], [[1, 1, 3]], [[0, 0, -1]])
    assert oracle.crossings.prim.tolist() == [1]
    assert oracle.first[oracle.group].tolist() == [0, 1, 1, 1]
    assert oracle.has_area(np.arange(4)).tolist() == [False, True, True, True]


def test_bad_rays_and_empty_meshes_cross_nothing():
    triangle = [[[0, 0, 0], [4, 0, 0], [0, 4, 0]]]
    assert len(Oracle(triangle, *rays.bad_rays()).crossings.ray) == 0
    assert len(Oracle(np.zeros((0, 3, 3)), [[1, 1, 1]], [[0, 0, 1]]).crossings.ray) == 0
    assert len(Oracle(triangle, np.zeros((0, 3)), np.zeros((0, 3))).crossings.ray) == 0


def test_facing_is_exact():
    """Fibonacci numbers: F(n)^2 and F(n - 1) F(n + 1) differ by 1, which their products in float64 can't show."""
    a, b, c = 4660046610375530309.0, 7540113804746346429.0, 12200160415121876738.0
    a, b, c = (float(np.float64(x)) for x in (a, b, c))
    for sign in (1, -1):
        corners = [[0, 0, 0], [b, a, 0], [c, b, 0]] if sign > 0 else [[0, 0, 0], [c, b, 0], [b, a, 0]]
        det = Fraction(b) * Fraction(b) - Fraction(a) * Fraction(c)
        expected = int(np.sign(det)) * sign
        assert Oracle([corners], [[0, 0, 1]], [[0, 0, 1]]).facing(np.array([0]), np.array([0])).tolist() == [expected]


def test_distance_is_that_of_the_nearest_point_of_the_triangle():
    rng = np.random.default_rng(6)
    corners, o, d = rng.normal(size=(200, 3, 3)), rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    t = rng.uniform(-1, 2, 200)
    oracle, pairs = Oracle(corners, o, d), np.arange(200)
    got = oracle.distance(pairs, pairs, t)
    # the nearest of many points of a triangle is a little farther than the nearest of all
    s = np.linspace(0, 1, 60)
    u, v = (a.ravel() for a in np.meshgrid(s, s))
    weights = np.stack([1 - u, u * (1 - v), u * v])
    points = np.einsum("wk,nwx->nkx", weights, corners)
    nearest = np.linalg.norm(points - (o + t[:, None] * d)[:, None], axis=2).min(axis=1)
    assert (got <= nearest + 1e-14).all()
    assert (got >= nearest - 0.1).all()
    assert np.median(nearest - got) < 0.002


def test_distance_loses_nothing_where_float64_would_cancel():
    """A sliver of height 1e-12, and a point 1e-20 over it, seen from 1e6 away."""
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0.5, 1e-12, 0]]])
    o, d = np.array([[0.5, 5e-13, -1e6]]), np.array([[0, 0, 1.0]])
    oracle, pair = Oracle(corners, o, d), np.array([0])
    assert oracle.distance(pair, pair, np.array([1e6]))[0] == 0
    up = np.nextafter(1e6, 2e6)
    assert oracle.distance(pair, pair, np.array([up]))[0] == up - 1e6
    flat = Oracle(corners, [[0.5, 5e-13, 1e-20]], [[1, 0, 0]])
    assert flat.distance(pair, pair, np.array([0.0]))[0] == 1e-20


def test_reach_is_the_distance_to_the_farthest_vertex():
    oracle = Oracle([[[3, 4, 0], [0, 0, 0], [1, 1, 1]]], [[0, 0, 0]], [[0, 0, 1]])
    np.testing.assert_allclose(oracle.reach(np.array([0]), np.array([0])), 5)
