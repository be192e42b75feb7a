"""Where a picture has edges: how far pixels are from their neighbours, and from what those foretell."""

from raytrace.accel.lanes import load, maximum, minimum, packet, packet_width, store
from raytrace.jit import inlined, kernel


@kernel
def edges(picture, columns, steps, bends, between):
    """Differences of each pixel from the two beside it, in four directions: squared, summed over the channels.

    An even slope has steps and no bends. An edge bends the pixels that it crosses, or those on both sides of it; what
    it crosses lies between its neighbours.

    Parameters
    ----------
    picture : (3 m,) float64 array
        Channels of rows of pixels, one after the other; m is a multiple of a register.
    columns : int
        Pixels of a row, at least a register of them.
    steps, bends, between : (m,) float64 arrays
        Are given the largest first difference, the largest second one, and the largest of the smaller first ones of a
        direction, where that is more than they hold; not in the first two rows and the last two.
    """
    like, width = packet(steps), packet_width(steps)
    m = len(steps)
    for i in range(2 * columns // width * width, m - 2 * columns, width):
        step, bend, least = load(steps, i, like), load(bends, i, like), load(between, i, like)
        for away in (1, columns - 1, columns, columns + 1):
            before, after, second = _differences(picture, m, i, away, like)
            step, bend = maximum(maximum(before, after), step), maximum(second, bend)
            least = maximum(minimum(before, after), least)
        store(steps, i, step)
        store(bends, i, bend)
        store(between, i, least)


@kernel
def weigh(marks, columns, known, width, error):
    """Squared error of each pixel: its own, and what its neighbours' differences add as far as they bend.

    A step counts only as far as one of the 3 x 3 pixels about it is bent: a slope is no edge.

    Parameters
    ----------
    marks : (3 n,) float64 array
        Steps, bends and what lies between neighbours, as ``edges`` has them: two rows more than the picture above and
        below, one column before it and at least one behind.
    columns : int
        Pixels of a row of those.
    known : (3 (m + packet),) float64 array
        Pixels of the picture, row after row: their own error, and by what the differences between and the steps count.
    width : int
        Pixels of a row of the picture.
    error : (m + packet,) float64 array
        Is given them; what is behind the last pixel means nothing.
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
            total = load(known, at, like) + load(known, m + at, like) * between
            store(error, at, total + load(known, 2 * m + at, like) * step)


@inlined
def _differences(picture, m, i, away, like):
    before = after = second = like
    for k in range(3):
        centre = load(picture, k * m + i, like)
        x = load(picture, k * m + i - away, like) - centre
        y = load(picture, k * m + i + away, like) - centre
        before, after, second = before + x * x, after + y * y, second + (x + y) * (x + y)
    return before, after, second
