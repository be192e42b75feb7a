"""The stack of a traversal: what is left to visit, and how far away it is."""

import numpy as np

from raytrace.accel.lanes import peek, poke
from raytrace.jit import inlined

ROOT = np.int32(0)
NOTHING = np.int32(-(2**31))  # no child


@inlined
def push(work, base, top, t, child, lanes):
    """Put a child on the stack, which above ``base`` is sorted with the nearest on top."""
    k = top
    while k > base and peek(work.t, k - 1) < t:
        poke(work.t, k, peek(work.t, k - 1))
        poke(work.child, k, peek(work.child, k - 1))
        poke(work.alive, k, peek(work.alive, k - 1))
        k -= 1
    poke(work.t, k, t)
    poke(work.child, k, child)
    poke(work.alive, k, lanes)
    return top + 1


@inlined
def pop(work, base, top, tmax):
    """The nearest child on the stack above ``base`` that is not behind tmax, or NOTHING; the height of the stack."""
    while top > base:
        top -= 1
        if peek(work.t, top) <= tmax:
            return peek(work.child, top), top
    return NOTHING, top
