"""Edges of an image: differences of pixels from their neighbours, and from the neighbours' linear extrapolation."""

from typing import NamedTuple

from raytrace.accel.lanes import load, maximum, minimum, packet, packet_width, store
from raytrace.jit import inlined, kernel


class Differences(NamedTuple):
    """Squared differences of pixels from two opposite neighbours, summed over the channels."""

    before: float
    after: float
    second: float


@kernel
def edges(image, columns: int, steps, bends, between):
    """Differences of each pixel from its two neighbours in four directions: squared, summed over the channels.

    An even slope has steps (first differences) and no bends (second differences). An edge bends the pixels that it
    crosses, or those on both sides of it. The value of a pixel that it crosses lies between those of its neighbours.

    Parameters
    ----------
    image : (3 m,) float64 array
        The channels one after the other, each row by row; m is a multiple of the number of lanes.
    columns : int
        Pixels per row, at least as many as there are lanes.
    steps, bends, between : (m,) float64 arrays
        Updated to the maximum of what they hold and of: the largest first difference, the largest second difference,
        and the largest of the smaller first differences of each direction. The first two rows and the last two are not
        changed.
    """
    like, width = packet(steps), packet_width(steps)
    m = len(steps)
    for i in range(2 * columns // width * width, m - 2 * columns, width):
        step, bend, least = load(steps, i, like), load(bends, i, like), load(between, i, like)
        for away in (1, columns - 1, columns, columns + 1):
            before, after, second = _differences(image, m, i, away, like)
            step, bend = maximum(maximum(before, after), step), maximum(second, bend)
            least = maximum(minimum(before, after), least)
        store(steps, i, step)
        store(bends, i, bend)
        store(between, i, least)


@kernel
def weigh(marks, columns: int, own, width: int, error):
    """Squared error of each pixel: its own, plus weighted differences from its neighbours where they bend.

    A step counts at most as much as the largest bend of the 3 x 3 pixels around it: a slope is not an edge.

    Parameters
    ----------
    marks : (3 n,) float64 array
        ``steps``, ``bends`` and ``between`` of ``edges``, for the image with two more rows above and below, one more
        column before it, and at least one after it.
    columns : int
        Pixels per row of ``marks``.
    own : (3 (m + packet),) float64 array
        For the pixels of the image, row by row: their own squared error, the weight of ``between``, the weight of
        ``steps``.
    width : int
        Pixels per row of the image.
    error : (m + packet,) float64 array
        Output; elements after the last pixel are meaningless.
    """
    like, lanes = packet(error), packet_width(error)
    n, m = len(marks) // 3, len(error)
    for row in range(n // columns - 4):
        for x in range(0, width, lanes):
            at, i = row * width + x, (row + 2) * columns + x + 1
            bent = like
            for above in (i - columns, i, i + columns):
                for k in range(above - 1, above + 2):
                    bent = maximum(load(marks, n + k, like), bent)
            step, between = minimum(load(marks, i, like), bent), minimum(load(marks, 2 * n + i, like), bent)
            total = load(own, at, like) + load(own, m + at, like) * between
            store(error, at, total + load(own, 2 * m + at, like) * step)


@inlined
def _differences(image, m: int, i: int, away: int, like) -> Differences:
    """Differences of pixel i from the two neighbours that are ``away`` elements before and after it."""
    before = after = second = like
    for k in range(3):
        centre = load(image, k * m + i, like)
        x = load(image, k * m + i - away, like) - centre
        y = load(image, k * m + i + away, like) - centre
        before, after, second = before + x * x, after + y * y, second + (x + y) * (x + y)
    return Differences(before, after, second)
