"""Axis-aligned boxes of the build: eight numbers side by side, so that one minimum of lanes merges two boxes.

A box at element i of a flat array is: low x, y, z, 0, -high x, -high y, -high z, 0.
"""

import numpy as np

from raytrace.accel.lanes import load, minimum, peek, splat, store
from raytrace.jit import inlined

BOX = 8  # numbers of a box


@inlined
def clear(a, i):
    """Make a box empty: low inf, high -inf."""
    store(a, i, splat(np.inf, load(a, i, 8)))


@inlined
def include(a, i, b, j):
    """Grow box i of a by box j of b."""
    store(a, i, minimum(load(a, i, 8), load(b, j, 8)))


@inlined
def low(a, i, axis):
    """Low side of a box."""
    return peek(a, i + axis)


@inlined
def high(a, i, axis):
    """High side of a box."""
    return -peek(a, i + 4 + axis)


@inlined
def centre(a, i, axis):
    """Twice the middle of a box."""
    return low(a, i, axis) + high(a, i, axis)


@inlined
def half_area(a, i):
    """Half the surface of a box."""
    x, y, z = high(a, i, 0) - low(a, i, 0), high(a, i, 1) - low(a, i, 1), high(a, i, 2) - low(a, i, 2)
    return x * y + y * z + z * x


@inlined
def area_of(box):
    """Half the surface of a box in a register."""
    x, y, z = -(box[4] + box[0]), -(box[5] + box[1]), -(box[6] + box[2])
    return x * y + y * z + z * x
