"""Light sampling alone, surface sampling alone and both: a hundredth of tests/bench/multiple_importance.py."""

import pytest

import raytrace as rt
from light_scenes import SCENES
from light_techniques import TECHNIQUES, compare, images, sidak

SIZE, SEEDS = (24, 24), 16
LEVEL = sidak(1e-3, 2 * len(SCENES))


@pytest.mark.parametrize("name", SCENES)
def test_techniques_agree_and_both_together_are_no_worse(name):
    scene = rt.load(SCENES[name]())
    of = {each: images(scene, each, 8, range(100 * k, 100 * k + SEEDS), SIZE) for k, each in enumerate(TECHNIQUES)}
    variance = {each: of[each].variance.mean() for each in TECHNIQUES}
    for each in ("light", "surface"):
        verdict = compare(of[each], of["both"], LEVEL)
        assert verdict.p > LEVEL
        assert verdict.found < 0.2 * of["both"].mean
    noise = 1.3  # of the variances, which are estimated from few samples
    assert variance["both"] <= noise * (1.5 * min(variance["light"], variance["surface"]) + of["both"].mean ** 2 / 2)
