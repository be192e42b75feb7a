"""Labels of angles in the figure of a path do not overlap."""

import numpy as np

from raytrace.show.path_section import _free_place


def test_labels_are_turned_and_pushed_until_they_are_free():
    size, labels = np.array([0.26, 0.12]), []
    for at in ([0, 0], [0.05, 0], [0.1, 0.02]):
        _free_place(np.array(at, np.float64), np.array([0.1, 0.2]), size, labels)
    np.testing.assert_array_equal(labels[0], [0.1, 0.2])
    for k, label in enumerate(labels):
        assert all((np.abs(label - other) >= size).any() for other in labels[:k])
