"""The heat map: counts of rays that go through the tree alone."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.accel import query
from raytrace.accel.bundle import unbundled
from raytrace.accel.inputs import columns_of
from raytrace.passes.camera import pinhole_directions
from raytrace.records import Hits, Rays
from raytrace.show.prepared_scene import pixel_centres, prepare_scene
from raytrace.show.visit_counts import count_work
from shipped_scenes import SCENES, load
from small_scenes import quad


def scene(name):
    return load(next(path for path in SCENES if path.stem == name))


@pytest.mark.parametrize("split", ["sah", "median"])
def test_pixels_sum_to_what_the_tree_counts_for_rays_of_different_kinds(split):
    prepared = prepare_scene(scene("room"), (24, 18))
    mesh, precision = prepared.scene.mesh, prepared.compiled.bvh.precision
    bvh = rt.BVH(mesh.vertices, mesh.faces, precision, split)
    d = pinhole_directions(prepared.view, *pixel_centres((24, 18)))
    work, dtype, n = bvh.work(), d.dtype, len(d)
    hits = Hits(np.empty(1, dtype), np.empty(1, np.int32), np.empty(1, dtype), np.empty(1, dtype))
    for row in d:  # the same work counts on, ray after ray
        rays = Rays(*(columns_of(np.asarray(a, dtype), 1) for a in (prepared.view.origin[None], row[None], 0, np.inf)))
        query.closest_hit(unbundled(bvh.tree), rays, hits, 1, work)
    data = rt.show.heatmap(prepared.scene, (24, 18), split=split).data
    assert (data["nodes"].sum(), data["triangles"].sum()) == tuple(work.counts)
    assert data["nodes"].shape == data["triangles"].shape == (18, 24)
    assert data["nodes"].max() > 5
    assert n == 24 * 18


def test_a_ray_that_misses_the_root_tests_nothing():
    bvh = rt.BVH(quad((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)).reshape(-1, 3), [[0, 1, 2], [3, 4, 5]])
    counts = count_work(bvh, np.array([0.3, 0.6, 1.0]), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    assert counts.tolist() == [[1, 8], [1, 0], [1, 0]]


def test_the_colours_are_the_counts():
    drawing = rt.show.heatmap(scene("glass-sphere"), (32, 32))
    shown = [axes.images[0] for axes in drawing.figure.axes if axes.images]
    for image, name in zip(shown, ("nodes", "triangles"), strict=True):
        np.testing.assert_array_equal(image.get_array(), drawing.data[name])
        assert image.get_clim()[0] == 0
        assert image.get_clim()[1] <= drawing.data[name].max()
