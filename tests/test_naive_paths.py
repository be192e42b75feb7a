"""Path tracing against its brute-force twin, which samples no lights; tests/bench/path_twin.py has more samples."""

import pytest

from light_techniques import sidak
from twin_scenes import SCENES, differences

SIZE, SEEDS = (12, 12), 12
LEVEL = sidak(1e-3, 3 * len(SCENES))  # a test per channel


@pytest.mark.parametrize("name", SCENES)
def test_the_twin_agrees(name):
    scene = SCENES[name]()
    for verdict, mean in differences(scene, SIZE, SEEDS, (12, 64), LEVEL):
        assert verdict.p > LEVEL
        assert verdict.found < 0.2 * mean
