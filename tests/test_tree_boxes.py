"""Levels of the tree as they are drawn: the boxes of the tree itself, each around its triangles."""

import numpy as np
import pytest

import raytrace as rt
from raytrace.accel.layout import boxes_of, children_of
from raytrace.passes.camera import make_view
from raytrace.show.tree_boxes import box_edges, level_of, project
from shipped_scenes import SCENES, load
from small_scenes import look, studio

WIDER = 1e-14  # boxes are rounded outward by some units in the last place of coordinates up to 7


def tree_of(scene, split="sah"):
    return rt.BVH(scene.mesh.vertices, scene.mesh.faces, "float64", split)


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("depth", [0, 1, 2, 3, 64])
def test_every_box_holds_its_triangles_and_none_is_left_out(depth, split):
    bvh = tree_of(load(next(path for path in SCENES if path.stem == "glass-sphere")), split)
    level = level_of(bvh.tree, len(bvh.triangles), depth)
    assert np.array_equal(level.box_of >= 0, np.isfinite(bvh.triangles[:, 9]))
    corners = bvh.triangles[:, :9].reshape(-1, 3, 3)
    for box in range(len(level.low)):
        held = corners[level.box_of == box]
        low, high = held.min(axis=(0, 1)), held.max(axis=(0, 1))
        assert (level.low[box] <= low).all()
        assert (level.high[box] >= high).all()
        np.testing.assert_allclose(level.low[box], low, atol=WIDER)
        np.testing.assert_allclose(level.high[box], high, atol=WIDER)
    assert level.leaf.all() == (depth >= bvh.levels)


def test_level_one_is_the_root_node_and_level_zero_the_box_around_it():
    bvh = tree_of(studio())
    used = children_of(bvh.tree.nodes)[0] != 0
    low, high = boxes_of(bvh.tree.nodes)[0, :3].T[used], boxes_of(bvh.tree.nodes)[0, 3:].T[used]
    level = level_of(bvh.tree, len(bvh.triangles), 1)
    assert sorted(map(tuple, level.low)) == sorted(map(tuple, low))
    assert sorted(map(tuple, level.high)) == sorted(map(tuple, high))
    around = level_of(bvh.tree, len(bvh.triangles), 0)
    assert (around.low == low.min(axis=0)).all()
    assert (around.high == high.max(axis=0)).all()


def test_the_drawing_holds_the_level_and_its_lines_are_edges_of_the_boxes():
    scene = studio()
    drawing = rt.show.bvh(scene, depth=1)
    bvh = tree_of(scene)
    for name, array in level_of(bvh.tree, len(bvh.triangles), 1)._asdict().items():
        np.testing.assert_array_equal(drawing.data[name], array)
    (axes,) = drawing.figure.axes
    drawn = np.concatenate([np.array(lines.get_segments()) for lines in axes.collections]).reshape(-1, 2)
    view = make_view(scene.camera, (1000, 1000), np.dtype(np.float64))
    ends, depth = project(view, box_edges(drawing.data["low"], drawing.data["high"]))
    assert (depth > 0).any()
    for end in ends[(depth > 0).all(axis=2)].reshape(-1, 2):
        assert np.abs(drawn - end).max(axis=1).min() < 1e-6


def test_a_box_has_twelve_edges_of_the_lengths_of_its_sides():
    edges = box_edges(np.zeros((1, 3)), np.array([[1.0, 2.0, 4.0]]))[0]
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths.tolist()) == [1.0] * 4 + [2.0] * 4 + [4.0] * 4


def test_points_are_seen_where_rays_through_them_go():
    view = make_view(look((1, 2, 6), (0.5, 0, 0), 40), (64, 48), np.dtype(np.float64))
    x, y = 13.5, 40.25
    d = view.forward + (x - view.centre[0]) * view.right + (y - view.centre[1]) * view.down
    film, depth = project(view, view.origin + 3.0 * d)
    np.testing.assert_allclose(film, [x - 0.5, y - 0.5], rtol=1e-12)  # imshow: the first pixel's centre is 0
    np.testing.assert_allclose(depth, 3.0, rtol=1e-12)


def test_a_wireframe_is_dark_on_edges_and_light_inside():
    drawing = rt.show.bvh(studio(), depth=0)
    picture = drawing.figure.axes[0].images[0].get_array()
    assert picture.shape == (1000, 1000, 3)
    assert picture.max() <= 1.0
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
