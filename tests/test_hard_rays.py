"""The cases themselves, by exact arithmetic: what they say must hold, does."""

import numpy as np
import pytest

from raytrace.hardcases.oracle import Oracle
from raytrace.hardcases.rays import cases

pytestmark = pytest.mark.engine

CASES = {case.name: case for case in cases()}
PRECISIONS = ("float32", "float64")


@pytest.mark.parametrize("name", CASES)
def test_a_case_is_made_of_the_numbers_of_a_precision(name):
    for precision in PRECISIONS:
        query = CASES[name].query(precision)
        n = len(query.o)
        assert n > 10
        assert {a.dtype.name for a in (query.vertices, query.o, query.d, query.tmin, query.tmax)} == {precision}
        assert query.o.shape == query.d.shape == (n, 3)
        assert query.tmin.shape == query.tmax.shape == query.inside.shape == (n,)
        assert np.isfinite(query.vertices).all()
        assert query.faces.min() >= 0
        assert query.faces.max() < len(query.vertices)
        again = CASES[name].query(precision)
        for a, b in zip(query, again, strict=True):
            assert np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")


def test_a_case_can_be_thinned():
    case = CASES["cube, from inside"]
    query, thin = case.query("float64"), case.query("float64", 7)
    assert np.array_equal(thin.o, query.o[::7])
    assert np.array_equal(thin.tmax, query.tmax[::7])
    assert thin.vertices is not None
    assert len(thin.inside) == len(thin.o)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.query("float64").inside.any()])
def test_whatever_starts_inside_meets_a_wall(name, precision):
    query = CASES[name].query(precision, 11)
    crossings = Oracle(query.vertices[query.faces], query.o, query.d).crossings
    ahead = np.isin(np.arange(len(query.o)), crossings.ray[crossings.t > 0])
    if (precision, name) == ("float32", "translation 1e+07"):  # numbers are 1 apart: the sphere is a few points
        return
    assert ahead[query.inside].all()


def test_aimed_rays_cross_edges_and_vertices():
    for name, least in (("lattice rays, slab planes", 0.3), ("axes, signed zeros", 0.3), ("cube, from inside", 0.3)):
        query = CASES[name].query("float64", 3)
        crossings = Oracle(query.vertices[query.faces], query.o, query.d).crossings
        at_rim = np.unique(crossings.ray[(crossings.kind > 0) & (crossings.t > 0)])
        assert len(at_rim) / len(query.o) > least


@pytest.mark.parametrize("name", ["no area, alone", "rays not finite"])
def test_nothing_is_there_to_be_hit(name):
    query = CASES[name].query("float64")
    assert len(Oracle(query.vertices[query.faces], query.o, query.d).crossings.ray) == 0


def test_distances_that_are_said_to_be_tied_are_integers_or_those_of_equal_triangles():
    query = CASES["coplanar overlaps"].query("float32")
    assert set(Oracle(query.vertices[query.faces], query.o, query.d).crossings.t.tolist()) == {2.0, 3.0}
    query = CASES["10,000 duplicates"].query("float32")
    assert len(np.unique(query.vertices[query.faces].reshape(-1, 9), axis=0)) == 2
    assert [name for name, case in CASES.items() if case.query("float64", 50).tied] == [
        "coplanar overlaps",
        "10,000 duplicates",
    ]


def test_names_are_unique_and_the_list_is_long():
    names = [case.name for case in cases()]
    assert len(set(names)) == len(names) > 50
    assert all(case.must for case in CASES.values())


def test_grazing_rays_graze():
    for name in ("grazing 1e-7, flat", "grazing 1e-7, turned"):
        query = CASES[name].query("float64")
        cosine = Oracle(query.vertices[query.faces], query.o, query.d).crossings.cosine
        np.testing.assert_allclose(cosine, 1e-7, rtol=1e-6)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_components_are_as_small_as_they_are_said_to_be(precision):
    d = np.sort(np.abs(CASES["denormal components"].query(precision).d), axis=1)
    assert (d[:, 2] == 1).all()
    assert (d[:, 1] <= 3 * np.finfo(precision).tiny).all()
    assert (d[:, 0] > 0).mean() > 0.4
    length = np.linalg.norm(CASES["directions 1e-20 long"].query("float64").d, axis=1)
    assert (length < 1e-19).all()
