"""The stack of a traversal: nodes and leaves still to visit, and their distances."""

import numpy as np

from raytrace.accel.lanes import peek, poke
from raytrace.jit import inlined
from raytrace.work_records import Work

ROOT = np.int32(0)
NOTHING = np.int32(-(2**31))  # no child


@inlined
def push(work: Work, base: int, top: int, t, child: int, lanes: int):
    """Push a child with its distance and the bits of the lanes that enter it; return the new height.

    The stack is kept sorted above ``base``, with the nearest child on top.
    """
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
def put(work: Work, top: int, child: int, lanes: int):
    """Push a child without its distance, on top of all others; return the new height."""
    poke(work.child, top, child)
    poke(work.alive, top, lanes)
    return top + 1


@inlined
def pop(work: Work, base: int, top: int, tmax):
    """Nearest child on the stack above ``base`` that is not beyond tmax, or NOTHING; and the new height."""
    while top > base:
        top -= 1
        if peek(work.t, top) <= tmax:
            return peek(work.child, top), top
    return NOTHING, top
