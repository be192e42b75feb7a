"""Every shipped scene still looks as it did when its picture was approved: same seed, same samples, same light."""

import pytest

import raytrace as rt
from shipped_scenes import ALL, load
from small_scenes import studio

pytestmark = pytest.mark.engine


@pytest.mark.parametrize("path", ALL, ids=lambda path: path.stem)
def test_scene_looks_like_its_golden(path, golden):
    scene = load(path)
    golden.check(rt.render(scene, size=(96, 96), spp=16, sampler="sobol", precision="float32", seed=0), path.stem)


def test_studio_looks_like_its_golden(golden):
    golden.check(rt.render(studio()), "studio")


def test_no_golden_is_left_over(golden):
    folder = golden.location.folder
    assert {path.stem for path in folder.glob("*.npz")} == {path.stem for path in ALL} | {"studio"}
    assert {path.stem for path in folder.glob("*.png")} == {path.stem for path in folder.glob("*.npz")}
