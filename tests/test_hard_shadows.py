"""The cases themselves, by exact arithmetic: what is said to be lit is lit, what is said to be dark is dark."""

import numpy as np
import pytest

from raytrace.hardcases.oracle import Oracle
from raytrace.hardcases.shadows import GAP, shadow_cases

pytestmark = pytest.mark.engine

CASES = {case.name: case for case in shadow_cases()}


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", CASES)
def test_light_comes_where_it_is_said_to(name, precision):
    query = CASES[name].query(precision, 5)
    corners = query.vertices.astype(np.float64)[query.faces]
    o, d, light = (a.astype(np.float64) for a in (query.o, query.d, query.light))
    seen = Oracle(corners, o, d).crossings
    first = np.unique(seen.ray[(seen.t > 0) & (seen.t < 1.2)])
    assert len(first) == len(o)  # every ray finds a point
    nearest = np.array([seen.t[(seen.ray == k) & (seen.t > 0)].min() for k in range(len(o))])
    p = o + nearest[:, None] * d
    shadow = Oracle(corners, p, light - p).crossings
    # off both ends by more than p is off and by less than the walls are
    between = (shadow.t > 0.2 * GAP) & (shadow.t < 1 - 0.2 * GAP)
    blocked = np.isin(np.arange(len(o)), shadow.ray[between])
    assert (blocked == query.dark).all()


def test_the_cases_span_what_they_should():
    sizes = [
        np.ptp(CASES[f"lit floor, scale {size:.0e}"].query("float64").vertices, axis=0).max() for size in (1e-12, 1e12)
    ]
    assert sizes[0] < 1e-11
    assert sizes[1] > 1e12
    moved = CASES["lit sphere, moved by 1e+07"]
    assert np.abs(moved.query("float64").vertices - 1e7).max() < 1.001
    assert np.abs(moved.query("float32").vertices - 1e7).max() > 900
    wide = CASES["lit floor 200 wide"].query("float32")
    assert np.linalg.norm(np.ptp(wide.vertices, axis=0)) > 200
    assert np.abs(wide.o + wide.d).max() < 2
    assert len({case.name for case in shadow_cases()}) == len(list(shadow_cases())) > 40
