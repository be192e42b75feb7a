"""References to parts of triangles, and how a plane divides them.

A *reference* is a triangle and a box. So a triangle may lie in several leaves. Every point of a triangle lies in one of
its boxes, at least ``margins[WIDEN]`` away from each side that a plane has cut (docs/numerics.md).
"""

from typing import NamedTuple

import numpy as np

from raytrace.accel.boxes import BOX, centre, high, low
from raytrace.accel.grow import HALF, Binary
from raytrace.accel.lanes import bits, load, maximum, minimum, peek, store
from raytrace.jit import inlined, subroutine

WIDEN, LEAST = range(2)  # places in ``References.margins``
NEITHER, FRONT, BACK, BOTH = range(4)  # sides of a plane on which a reference has a part


class References(NamedTuple):
    """A binary tree whose triangles may be divided."""

    tree: Binary
    limit: np.ndarray  # (n,) i4: where the places of a node in ``tree.order`` end; those behind its references are free
    triangles: np.ndarray  # (12m,) f, world units: vertices and normals of all triangles
    margins: np.ndarray  # (2,) f: WIDEN, world units: how far the box of a part reaches beyond a plane; LEAST, world
    # units^2: nodes whose halves share less (half the surface of a box) are not divided


class Cut(NamedTuple):
    """A plane that divides references."""

    axis: int
    x: float  # world units


@inlined
def corners_along(triangles, first: int, axis: int):
    """Places of the three vertices of a triangle, sorted by one coordinate."""
    a, b, c = first, first + 3, first + 6
    if peek(triangles, b + axis) < peek(triangles, a + axis):
        a, b = b, a
    if peek(triangles, c + axis) < peek(triangles, b + axis):
        b, c = c, b
    if peek(triangles, b + axis) < peek(triangles, a + axis):
        a, b = b, a
    return a, b, c


@inlined
def point_of_edge(triangles, a: int, b: int, axis: int, x):
    """Point of an edge where a coordinate is x; the fourth lane has no meaning."""
    p, q = peek(triangles, a + axis), peek(triangles, b + axis)
    start = load(triangles, a, HALF)
    share = (x - p) / (q - p) if p < q else x - x
    return start + (load(triangles, b, HALF) - start) * share


@inlined
def section(triangles, corners, axis: int, x):
    """Box of the points of a triangle where a coordinate is x, which lies in its range: two registers."""
    a, b, c = corners
    before = x < peek(triangles, b + axis)
    p = point_of_edge(triangles, a, c, axis, x)
    q = point_of_edge(triangles, a if before else b, b if before else c, axis, x)
    return minimum(p, q), minimum(-p, -q)


@inlined
def with_corner(part, triangles, place: int):
    """Grow the box in two registers by a vertex."""
    p = load(triangles, place, HALF)
    return minimum(part[0], p), minimum(part[1], -p)


@inlined
def hull(part, other):
    """The box, in two registers, around two boxes."""
    return minimum(part[0], other[0]), minimum(part[1], other[1])


@inlined
def write_part(refs: References, k: int, part, sides, at: int) -> bool:
    """Write the box of a part, widened, within that of reference k; return whether there is such a part."""
    boxes = refs.tree.boxes
    margin = peek(refs.margins, WIDEN)
    least = maximum(part[0] - margin, load(boxes, BOX * k, HALF))
    most = maximum(part[1] - margin, load(boxes, BOX * k + HALF, HALF))
    store(sides, at, least)
    store(sides, at + HALF, most)
    sides[at + 3] = sides[at + 7] = 0.0
    return bits(least + most > 0.0) & 7 == 0


@subroutine
def divide(refs: References, k: int, cut: Cut, sides) -> int:
    """Write the boxes of both parts of reference k; return the sides on which it has one."""
    triangles, axis, box = refs.triangles, cut.axis, refs.tree.boxes
    corners = corners_along(triangles, 12 * np.int64(refs.tree.order[k]), axis)
    first = max(low(box, BOX * k, axis), peek(triangles, corners[0] + axis))
    last = min(high(box, BOX * k, axis), peek(triangles, corners[2] + axis))
    middle, x = peek(triangles, corners[1] + axis), min(max(cut.x, first), last)
    here = section(triangles, corners, axis, x)
    front, back = (
        hull(section(triangles, corners, axis, first), here),
        hull(here, section(triangles, corners, axis, last)),
    )
    if first <= middle and middle <= x:
        front = with_corner(front, triangles, corners[1])
    if x <= middle and middle <= last:
        back = with_corner(back, triangles, corners[1])
    in_front, behind = write_part(refs, k, front, sides, 0), write_part(refs, k, back, sides, BOX)
    return FRONT * in_front + BACK * behind


@inlined
def side_of(refs: References, k: int, free: int, limit: int, cut: Cut, sides) -> int:
    """Side of a plane to which reference k goes; ``BOTH`` where it is divided, and there is a place for the other part.

    What would be thinner than the widening is not divided.
    """
    boxes, margin = refs.tree.boxes, peek(refs.margins, WIDEN) + peek(refs.margins, WIDEN)
    if high(boxes, BOX * k, cut.axis) <= cut.x + margin:
        return FRONT
    if low(boxes, BOX * k, cut.axis) >= cut.x - margin:
        return BACK
    if free < limit:
        side = divide(refs, k, cut, sides)
        if side != NEITHER:
            return side
    return FRONT if centre(boxes, BOX * k, cut.axis) < cut.x + cut.x else BACK
