"""Path tracing against closed forms, with fixed seeds, so that a failure is no accident."""

import numpy as np
import pytest

import raytrace as rt
from light_cases import cases

SEEDS = 8
SIGMAS = 4.5  # of the mean over seeds; the spread is estimated from those few, hence more than 4


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_closed_forms(case, precision):
    scene = rt.load(case.scene)
    means = np.array(
        [rt.render(scene, spp=16, size=(16, 16), seed=seed, precision=precision).rgb.mean() for seed in range(SEEDS)],
        np.float64,
    )
    error, spread = means.mean() - case.expected, means.std(ddof=1) / np.sqrt(SEEDS)
    assert abs(error) <= SIGMAS * spread + case.tolerance * case.expected
    assert spread < 0.05 * case.expected
