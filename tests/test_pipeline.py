"""The pipeline equals its brute-force twin, and its bits depend on nothing but the scene, the seed and the pixel."""

from pathlib import Path

import numpy as np
import pytest

import naive
import raytrace as rt
from naive_sampling import film_points

SCENES = sorted((Path(__file__).parents[1] / "scenes").glob("*.json"))
FILMS = {"bumpy": ((6, 4), 1)}  # the twin tries 300,000 triangles on every ray
SMALL = ((16, 12), 2)
each_scene = pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
_twins = {}


def twin(path, sampler="sobol"):
    """Linear RGB by the twin, and the arguments that ask the pipeline for the same."""
    size, spp = FILMS.get(path.stem, SMALL)
    if (path, sampler) not in _twins:
        scene = rt.load(path)
        points = film_points(sampler, 7, spp, (0, 0, *size))
        _twins[path, sampler] = scene, naive.render(scene, points, size)
    scene, rgb = _twins[path, sampler]
    return scene, rgb, {"size": size, "spp": spp, "seed": 7, "sampler": sampler}


@each_scene
def test_float64_equals_the_twin(path):
    scene, rgb, ask = twin(path)
    # the picture is float32, half a unit in its last place is 6e-8; the rest is rounding on the way
    np.testing.assert_allclose(rt.render(scene, precision="float64", **ask).rgb, rgb, rtol=6.1e-8, atol=1e-12)


@each_scene
def test_float32_equals_the_twin(path):
    scene, rgb, ask = twin(path)
    np.testing.assert_allclose(rt.render(scene, precision="float32", **ask).rgb, rgb, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("sampler", ["independent", "stratified"])
def test_samplers_put_their_points_where_the_twin_does(sampler):
    scene, rgb, ask = twin(SCENES[1], sampler)
    np.testing.assert_allclose(rt.render(scene, precision="float64", **ask).rgb, rgb, rtol=6.1e-8, atol=1e-12)
