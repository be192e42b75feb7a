"""The pipeline equals its brute-force twin, and its bits depend on nothing but the scene, the seed and the pixel."""

import dataclasses

import numpy as np
import pytest

import naive
import raytrace as rt
from naive_sampling import film_points
from raytrace.rendering import film_tiles, rendering
from shipped_scenes import SCENES, each_scene, load
from small_scenes import Part, look, make_scene, studio

pytestmark = pytest.mark.engine

ROOM = next(path for path in SCENES if path.stem == "room")
FILMS = {"bumpy": ((6, 4), 1)}  # the twin tries 300,000 triangles on every ray
SMALL = ((16, 12), 2)
_twins = {}


def twin(path, sampler="sobol"):
    """Linear RGB by the twin, and the arguments that ask the pipeline for the same."""
    size, spp = FILMS.get(path.stem, SMALL)
    if (path, sampler) not in _twins:
        scene = load(path)
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
    # gamma(27) = 2e-6 of the coordinates, a hundredfold of it through curved glass; no sample changes its surface here
    np.testing.assert_allclose(rt.render(scene, precision="float32", **ask).rgb, rgb, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("sampler", ["independent", "stratified"])
def test_samplers_put_their_points_where_the_twin_does(sampler):
    scene, rgb, ask = twin(ROOM, sampler)
    np.testing.assert_allclose(rt.render(scene, precision="float64", **ask).rgb, rgb, rtol=6.1e-8, atol=1e-12)


@pytest.mark.parametrize("depth", [1, 2, 3, 4, 16])
def test_studio_equals_the_twin_at_every_depth(depth):
    scene = studio()
    scene = dataclasses.replace(scene, settings=scene.settings._replace(max_depth=depth))
    rgb = naive.render(scene, film_points("sobol", 0, 4, (0, 0, 48, 48)))
    np.testing.assert_allclose(rt.render(scene, precision="float64").rgb, rgb, rtol=6.1e-8, atol=1e-12)


def heap(seed, scale, shift):
    """Random triangles of every material, with normals up to 60 degrees off, that cut through each other."""
    rng = np.random.default_rng(seed)
    parts = []
    for kind in range(6):
        triangles = rng.normal(size=(12, 1, 3)) + rng.normal(size=(12, 3, 3))
        ng = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        ng = ng / np.linalg.norm(ng, axis=1, keepdims=True)
        normals = ng[:, None] + 0.9 * rng.uniform(-1, 1, (12, 3, 3))
        normals = normals / np.linalg.norm(normals, axis=2, keepdims=True) if kind % 2 else None
        flags = {"two_sided": kind == 2, "transparent_shadow": kind == 5}
        ior = rng.uniform(0.4, 2.5)
        parts.append(Part(scale * triangles + shift, kind // 4, rng.uniform(0, 1, 3), ior, normals=normals, **flags))
    lights = [(scale * rng.normal(size=3) * 4 + shift, scale**2 * rng.uniform(1, 99, 3)) for _ in range(3)]
    camera = look(scale * np.array([1, 2, 6]) + shift, np.full(3, shift), 45)
    return make_scene(parts, lights, camera, background=(0.1, 0.2, 0.3))


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (1e-4, 0.0), (1e5, 0.0), (1.0, 1e4)])
@pytest.mark.parametrize("seed", range(4))
def test_random_triangles_equal_the_twin(seed, scale, shift):
    scene = heap(seed, scale, shift)
    rgb = naive.render(scene, film_points("sobol", 0, 2, (0, 0, 32, 24)), (32, 24))
    picture = rt.render(scene, size=(32, 24), spp=2, precision="float64").rgb
    # points are off by gamma(27) x 1e4 = 3e-11 where shifted; a few bounces may multiply that
    np.testing.assert_allclose(picture, rgb, rtol=6.1e-8 if shift == 0 else 1e-6, atol=1e-12)


SOME = [path for path in SCENES if path.stem in ("cornell-box", "glass-sphere", "room")]


@pytest.mark.parametrize("path", SOME, ids=lambda path: path.stem)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_bits_do_not_depend_on_threads_tiles_batches_or_crop(path, precision, monkeypatch):
    scene = load(path)
    ask = {"size": (75, 50), "spp": 5, "precision": precision, "seed": 3}
    whole = rt.render(scene, threads=1, **ask)
    assert whole.rgb.tobytes() == rt.render(scene, threads=2, **ask).rgb.tobytes()
    part = rt.render(scene, crop=(13, 7, 41, 38), **ask)
    np.testing.assert_array_equal(part.rgb, whole.rgb[7:45, 13:54])
    np.testing.assert_array_equal(part.stderr, whole.stderr[7:45, 13:54])
    for tile, batch in ((32, 1), (8, 100), (64, 1 << 20)):
        monkeypatch.setattr(film_tiles, "TILE", tile)
        monkeypatch.setattr(rendering, "BATCH", batch)
        assert whole.rgb.tobytes() == rt.render(scene, threads=2, **ask).rgb.tobytes()
