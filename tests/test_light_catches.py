"""The checks of light transport do their work: each planted bug turns a closed form red, and none does without one.

The bugs of light_catches.py are planted between the passes. tests/bench/planted_bugs.py plants them in
the source, and runs all checks on each.
"""

import numpy as np
import pytest

import raytrace as rt
from light_cases import cases
from light_catches import BUGS, Usual
from raytrace.rendering import path_wavefront

SIGMAS, SEEDS, SPP = 4.5, 8, 8
CASES = {case.name: case for case in cases()}
USED = (
    "room of albedo 1/2 that emits, depth 1",
    "room of albedo 1/2 that emits, depth 200",
    "two opposed squares, path",
    "back of a lamp that reflects on both sides",
    "inside of a slab, depth 30",
)


def red(front, monkeypatch):
    """Cases that fail when images are rendered by a wavefront."""
    monkeypatch.setattr(path_wavefront, "PathWavefront", front)
    found = set()
    for case in map(CASES.get, USED):
        scene = rt.load(case.scene)
        pictures = [rt.render(scene, spp=SPP, size=(16, 16), seed=k, precision="float32").rgb for k in range(SEEDS)]
        means = np.mean(pictures, axis=(1, 2, 3), dtype=np.float64)
        spread = means.std(ddof=1) / np.sqrt(SEEDS)
        if abs(means.mean() - case.expected) > SIGMAS * spread + case.tolerance * case.expected:
            found.add(case.name)
    return found


def test_nothing_is_red_without_a_bug(monkeypatch):
    assert not red(Usual, monkeypatch)


@pytest.mark.parametrize("bug", BUGS.values(), ids=BUGS.keys())
def test_a_bug_turns_a_closed_form_red(bug, monkeypatch):
    with np.errstate(all="ignore"):
        assert red(bug, monkeypatch)
