"""Axis-aligned boxes of the build: eight numbers side by side, so that one minimum of lanes merges two boxes.

A box at element i of a flat array is: low x, y, z, 0, -high x, -high y, -high z, 0. In a *bin*, a box that grows around
others, the fourth number counts those that begin in it, and the eighth those that end there. So the sum or the minimum
of lanes does all that a bin needs, and no memory is written only in part, which processors are slow to read again.
"""

import numpy as np

from raytrace.accel.lanes import load, mask_of, minimum, peek, select, splat, store
from raytrace.jit import inlined

BOX = 8  # numbers of a box
COUNTS = 1 << 3 | 1 << 7  # bits of the numbers that count


@inlined
def clear(a, i):
    """Make a box empty: low inf, high -inf."""
    store(a, i, splat(np.inf, load(a, i, 8)))


@inlined
def include(a, i, b, j):
    """Grow box i of a by box j of b."""
    store(a, i, minimum(load(a, i, 8), load(b, j, 8)))


@inlined
def empty_bin(like):
    """An empty bin in a register."""
    return select(mask_of(COUNTS, like), splat(0.0, like), splat(np.inf, like))


@inlined
def merged(bin_, other):
    """A bin that holds what two bins hold."""
    return select(mask_of(COUNTS, bin_), bin_ + other, minimum(bin_, other))


@inlined
def tally(bins, i, box, number):
    """Grow bin i around a box, or half a bin around half a box, and add a number to its counts."""
    before = load(bins, i, box)
    store(bins, i, select(mask_of(COUNTS, box), before + number, minimum(before, box)))


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
