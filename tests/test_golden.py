"""Every shipped scene still looks as it did when its picture was approved: same seed, same samples, same light."""

from pathlib import Path

import pytest

import raytrace as rt
from golden_gate import GOLDEN
from small_scenes import studio

SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_scene_looks_like_its_golden(path, golden):
    golden(path.stem, rt.render(path, size=(96, 96), spp=16, sampler="sobol", precision="float32", seed=0).rgb)


def test_studio_looks_like_its_golden(golden):
    golden("studio", rt.render(studio()).rgb)


def test_no_golden_is_left_over():
    assert {path.stem for path in GOLDEN.glob("*.npz")} == {path.stem for path in SCENES} | {"studio"}
