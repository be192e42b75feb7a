"""The ways of drawing: the same picture where it should be, and not where it should not."""

import numpy as np
import pytest

from raytrace.accel import query
from raytrace.accel.inputs import columns_of
from raytrace.records import Hits, Rays
from raytrace.rendering import compiled_scene
from raytrace.rendering.rendering import render
from raytrace.reporting import configurations
from raytrace.reporting.configurations import Configuration, ConfiguredScene, configurations_of, steps_of, weight_of
from raytrace.scene.plan import make_plan
from small_scenes import Part, box, make_scene, studio

SIZE = (24, 24)


@pytest.mark.parametrize("tree", ["median", "none"])
def test_a_tree_changes_no_bit_of_the_picture(tree):
    scene = studio()
    subject = ConfiguredScene(scene, Configuration("sobol", "float64", tree=tree), SIZE)
    expected = render(scene, 2, SIZE, 5, "float64", "sobol")
    np.testing.assert_array_equal(subject.render(2, 5).rgb, expected.rgb)


def test_without_a_tree_a_ray_is_tested_against_all_triangles():
    scene = studio()
    tested = {}
    for tree in ("sah", "none"):
        subject = ConfiguredScene(scene, Configuration("sobol", "float32", tree=tree), SIZE)
        stage = compiled_scene._compiled[subject.scene]["float32"]
        for name, bvh in (("all", stage.bvh), ("shadow", stage.shadow_bvhs[0])):
            work = bvh.work()
            past = (np.array([[-20.0, 30.0, 10.0]], np.float32), np.array([[-1.0, 0.1, 0.2]], np.float32))
            limits = (np.zeros(1, np.float32), np.full(1, np.inf, np.float32))
            rays = Rays(*(columns_of(array, 1) for array in (*past, *limits)))
            hits = Hits(np.empty(1, "f4"), np.empty(1, "i4"), np.empty(1, "f4"), np.empty(1, "f4"))
            query.closest_hit(bvh.tree, rays, hits, 1, work)
            tested[tree, name] = int(work.counts[1])
            assert hits.prim_id[0] == -1
            count = int(np.isfinite(bvh.triangles[:, 9]).sum())
            assert tested[tree, name] >= (count if tree == "none" else 0)
    assert tested["sah", "all"] == tested["sah", "shadow"] == 0


def test_a_scene_keeps_its_own_tree():
    scene = studio()
    before = render(scene, 1, SIZE, 0, "float32").rgb
    ConfiguredScene(scene, Configuration("sobol", "float32", triangle="moller-trumbore"), SIZE)
    assert compiled_scene._compiled[scene]["float32"].bvh.triangle == "watertight"
    np.testing.assert_array_equal(render(scene, 1, SIZE, 0, "float32").rgb, before)


def test_the_absolute_threshold_loses_small_triangles():
    scene = make_scene([Part(1e-3 * box((-1, -1, -1), (1, 1, 1)))], background=(0.1, 0.1, 0.1))
    scene = scene.__class__(**{**vars(scene), "camera": scene.camera._replace(position=np.array([0, 0, 5e-3]))})
    right, wrong = (
        ConfiguredScene(scene, Configuration("sobol", "float64", triangle=t), SIZE)
        for t in ("watertight", "moller-trumbore")
    )
    assert (right.render(1, 0).rgb == 0).any()  # a black box before the background
    assert not (wrong.render(1, 0).rgb == 0).any()


def test_the_first_way_is_the_usual_one_and_each_is_there_once():
    scene = studio()
    found = configurations_of(scene)
    assert found[0] == Configuration("sobol", "float64")  # as the scene asks
    assert len(set(found)) == len(found)
    assert {way.sampler for way in found} == {"sobol", "stratified", "independent"}
    assert {way.precision for way in found} == {"float32", "float64"}
    assert {way.triangle for way in found} == {"watertight", "moller-trumbore"}
    assert {way.tree for way in found} == {"sah", "median", "none"}


def test_a_large_scene_is_not_drawn_without_a_tree(monkeypatch):
    monkeypatch.setattr(configurations, "FEW_TRIANGLES", 100)
    assert not [way for way in configurations_of(studio()) if way.tree == "none"]


def test_adaptive_sampling_aims_at_ever_smaller_errors():
    (way,) = (way for way in configurations_of(studio()) if way.adaptive)
    assert way.name == "sobol, adaptive, float64"
    assert list(steps_of(way)) == sorted(steps_of(way), reverse=True)
    weights = [weight_of(way, step) for step in steps_of(way)]
    assert weights == sorted(weights)


def test_steps_go_from_1_to_256_samples():
    assert steps_of(Configuration("sobol", "float32")) == (1, 2, 4, 8, 16, 32, 64, 128, 256)
    assert steps_of(Configuration("sobol", "float32", tree="median")) == (4, 16, 64)


def test_the_trees_of_shadow_rays_in_path_tracing_are_configured_too():
    configured = ConfiguredScene(studio(), Configuration("sobol", "float32", tree="median"), SIZE).scene
    compiled = compiled_scene.compiled_of(configured, make_plan(configured), "float32")
    traced = compiled_scene.paths_of(configured, compiled, "path")
    assert [bvh.split for bvh in (traced.bvh, traced.shadow_bvh, traced.passed_bvh)] == ["median"] * 3
