"""Axis-aligned boxes while a tree is built: low x y z, high x y z in an array of six."""

import numpy as np

from raytrace.jit import inlined


@inlined
def clear(box):
    """Make a box empty: low inf, high -inf."""
    for k in range(3):
        box[k] = np.inf
        box[k + 3] = -np.inf


@inlined
def include(box, other):
    """Grow a box by another."""
    for k in range(3):
        box[k] = other[k] if other[k] < box[k] else box[k]
        box[k + 3] = other[k + 3] if other[k + 3] > box[k + 3] else box[k + 3]


@inlined
def half_area(box):
    """Half the surface of a box."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x
