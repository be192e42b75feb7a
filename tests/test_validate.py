"""Statistics of trees, and the validator: it passes sound trees and fails on every way of breaking one."""

import numpy as np
import pytest

import rays
import raytrace as rt
from test_build import flaws, planted

pytestmark = pytest.mark.engine

SOUP = rays.soup(500, seed=1)


def broken(case):
    """A tree with one thing wrong."""
    bvh = rt.BVH(*SOUP)
    part, field, damage, _ = list(planted())[case]
    record = getattr(bvh.tree, part)
    changed = getattr(record, field).copy()
    damage(changed)
    bvh.tree = bvh.tree._replace(**{part: record._replace(**{field: changed})})
    return bvh


@pytest.mark.parametrize("split", ["sah", "median"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("count", [0, 1, 8, 9, 500])
def test_sound_trees_pass(count, precision, split):
    bvh = rt.BVH(SOUP[0], SOUP[1][:count], precision, split)
    bvh.validate()
    assert flaws(bvh.tree, bvh.triangles) == []


@pytest.mark.parametrize("case", range(9))
def test_broken_trees_are_told(case):
    with pytest.raises(ValueError, match=r"leaf|node"):
        broken(case).validate()


def test_triangles_without_area_are_missed_by_no_one():
    vertices = np.concatenate([SOUP[0], np.zeros((3, 3))])
    bvh = rt.BVH(vertices, np.concatenate([SOUP[1], [[len(SOUP[0])] * 3]]))
    bvh.validate()
    assert bvh.stats.triangles == len(SOUP[1])


def test_numbers_of_a_tree_that_can_be_counted_by_hand():
    """Two leaves of one box each: a node, and every ray meets the root; areas are those of the leaves."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    vertices = np.concatenate([square, square + [0, 0, 1]])
    faces = [[0, 1, 2], [0, 2, 3]] * 4 + [[4, 5, 6], [4, 6, 7]] * 4
    stats = rt.BVH(vertices, faces).stats
    assert (stats.triangles, stats.nodes, stats.leaves, stats.levels, stats.fill) == (16, 1, 2, 1, 1.0)
    assert stats.sah_cost == pytest.approx(1 + (1 + 1) / 3, rel=1e-4)  # half areas: two squares of 1 in a cube of 3
    assert stats.bytes_per_triangle == (256 + 2 * 416) / 16
