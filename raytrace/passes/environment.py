"""An environment image: its radiance in a direction, and directions in proportion to it.

The image is latitude-longitude, y up: a unit direction d has u = atan2(d_x, -d_z) / 2 pi and v = acos(d_y) / pi. Cell
(j, i) lies between the centres of texels i - 1 and i, of rows j - 1 and j; rows 0 and h are half cells at the poles. A
cell is drawn by the mean of its filtered luminance times its solid angle, and a point in it exactly in proportion to
the filtered luminance. So the density is 0 only where the radiance is, and radiance over density varies within a cell
by the sine of the polar angle only.
"""

import numpy as np

from raytrace.accel.lanes import (
    bits,
    gather,
    lane_numbers,
    load,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    select,
    splat,
    sqrt,
    to_int,
    to_real,
)  # fmt: skip
from raytrace.accel.vectors import scaled
from raytrace.jit import inlined, kernel
from raytrace.passes.angles import atan2, sin_cos_of_turns
from raytrace.passes.lights import ENVIRONMENT, chosen, put, starts
from raytrace.passes.paths import LIGHT_U, add, brought, power_heuristic, random_bits
from raytrace.passes.sampling import LAST
from raytrace.passes.surface import load3
from raytrace.passes.textures import between, colour_of

RED, GREEN, BLUE = 0.2126, 0.7152, 0.0722  # luminance of Rec. 709 primaries
SMALLEST = 1e-20  # the sine at the poles


@inlined
def luminance(colour):
    return RED * colour[0] + GREEN * colour[1] + BLUE * colour[2]


@inlined
def real_of(x, like):
    """Lanes of uint32 as floats, rounded."""
    return to_real(x >> np.uint32(16), like) * 65536.0 + to_real(x & np.uint32(0xFFFF), like)


@inlined
def corners_of(image, j, i):
    """Colours at the corners of cells: before and after in u, of the upper row of texels and of the lower one."""
    height, width = peek(image.size, 0), peek(image.size, 1)
    upper = select(j > np.int32(0), j - np.int32(1), np.int32(0)) * width
    lower = select(j < height, j, height - np.int32(1)) * width
    left, right = select(i > np.int32(0), i - np.int32(1), width - np.int32(1)), i
    return (
        (colour_of(image.texels, upper + left), colour_of(image.texels, upper + right)),
        (colour_of(image.texels, lower + left), colour_of(image.texels, lower + right)),
    )


@inlined
def filtered(corners, s, t):
    """Bilinear colours in cells."""
    return between(between(corners[0][0], corners[0][1], s), between(corners[1][0], corners[1][1], s), t)


@inlined
def mean_luminance(corners):
    """Luminance of cells, averaged over u and v."""
    upper = luminance(corners[0][0]) + luminance(corners[0][1])
    return 0.25 * (upper + (luminance(corners[1][0]) + luminance(corners[1][1])))


@inlined
def width_of(begins, at):
    """How many of 2^32 random numbers belong to rows."""
    return gather(begins, at + np.int32(1)) - gather(begins, at)


@inlined
def density(image, j, i, corners, colour, sine):
    """Density of directions, 1 / sr: that of (u, v) over 2 pi^2 sin(theta)."""
    height, width = peek(image.size, 0), peek(image.size, 1)
    row = real_of(width_of(image.rows, j), sine) * 2.0**-32
    column = real_of(width_of(image.columns, j * (width + np.int32(1)) + i), sine) * 2.0**-32
    mean = mean_luminance(corners)
    shape = luminance(colour) / select(mean > 0.0, mean, 1.0)
    half = (j == np.int32(0)) | (j == height)
    cells = np.float64(width) * np.float64(height) / (2.0 * np.pi * np.pi)
    share = peek(image.share, 0) * select(half, splat(2.0, sine), 1.0)
    return share * (row * column) * (shape * cells) / maximum(sine, SMALLEST)


@inlined
def turned(turn, d, k, step):
    """A direction through the rotation of the image: rows (k = 3, step = 1) to it, columns (1, 3) back from it."""
    return (
        peek(turn, 0) * d[0] + peek(turn, step) * d[1] + peek(turn, 2 * step) * d[2],
        peek(turn, k) * d[0] + peek(turn, k + step) * d[1] + peek(turn, k + 2 * step) * d[2],
        peek(turn, 2 * k) * d[0] + peek(turn, 2 * k + step) * d[1] + peek(turn, 2 * k + 2 * step) * d[2],
    )


@inlined
def seen(image, d):
    """Radiance from directions, and the density with which ``sample_image`` finds them."""
    x, y, z = turned(image.turn, d, 3, 1)
    height, width = peek(image.size, 0), peek(image.size, 1)
    sine = sqrt(x * x + z * z)
    u, v = atan2(x, -z) / (2.0 * np.pi), atan2(sine, y) / np.pi
    across = select(u < 0.0, u + 1.0, u) * np.float64(width) + 0.5
    down = maximum(v, 0.0) * np.float64(height) + 0.5
    i, j = to_int(across), to_int(down)
    j = select(j < height, j, height)
    s, t = across - to_real(i, x), down - to_real(j, x)
    i = select(i < width, i, i - width)
    corners = corners_of(image, j, i)
    colour = filtered(corners, s, t)
    return colour, density(image, j, i, corners, colour, sine)


@inlined
def search(begins, first, n, number):
    """The last of n rows, from ``first`` on, whose begin is at most a number."""
    low = first - first
    step = 1
    while step < n:
        step *= 2
    while step > 0:
        middle = low + np.int32(step)
        inside = middle < np.int32(n)
        at = select(inside, middle, low)
        low = select(inside & (gather(begins, first + at) <= number), middle, low)
        step //= 2
    return low


@inlined
def within(begins, at, number, like):
    """How far a number lies in the range of its row, in [0, 1)."""
    share = real_of(number - gather(begins, at), like) / real_of(width_of(begins, at), like)
    return minimum(share, LAST)


@inlined
def linear(u, a, b):
    """Point of 0 .. 1 whose density is linear, from a at 0 to b at 1; neither is negative [Pharr2023, A.4.1]."""
    largest = maximum(a, b)
    unit = select(largest > 0.0, largest, 1.0)
    a, b = a / unit, b / unit
    below = a + sqrt(a * a + u * (b * b - a * a))
    return minimum(u * (a + b) / select(below > 0.0, below, 1.0), LAST)


@inlined
def sample_cell(image, first, second, like):
    """Directions in the frame of the image: cells, positions in them, and whether there is one."""
    height, width = peek(image.size, 0), peek(image.size, 1)
    j = search(image.rows, to_int(like), height + 1, first)
    begin = j * (width + np.int32(1))
    i = search(image.columns, begin, width, second)
    some = (first < gather(image.rows, j + np.int32(1))) & (second < gather(image.columns, begin + i + np.int32(1)))
    corners = corners_of(image, j, i)
    upper = luminance(corners[0][0]) + luminance(corners[0][1])
    lower = luminance(corners[1][0]) + luminance(corners[1][1])
    t = linear(within(image.rows, j, first, like), upper, lower)
    left = luminance(corners[0][0]) + t * (luminance(corners[1][0]) - luminance(corners[0][0]))
    right = luminance(corners[0][1]) + t * (luminance(corners[1][1]) - luminance(corners[0][1]))
    s = linear(within(image.columns, begin + i, second, like), left, right)
    return j, i, corners, s, t, some


@inlined
def direction(image, j, i, s, t):
    """Unit directions in the frame of the image, and the sines of their polar angles."""
    height, width = peek(image.size, 0), peek(image.size, 1)
    u = (to_real(i, s) - 0.5 + s) / np.float64(width)
    u = select(u < 0.0, u + 1.0, u)
    edge = j == np.int32(0)
    end = j == height
    down = to_real(j, s) - 0.5 + select(edge, 0.5 + 0.5 * t, select(end, 0.5 * t, t))
    sine, y = sin_cos_of_turns(0.5 * (down / np.float64(height)))
    across, along = sin_cos_of_turns(u)
    return (sine * across, y, -(sine * along)), sine


@kernel
def sample_image(sampler, paths, n, depth, table, image, vertices, incident):
    """Sample directions of an environment image, in proportion to its filtered luminance."""
    like = packet(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        _, wanted = chosen(table, incident, i, ENVIRONMENT)
        if bits(wanted) != 0:
            first, second = random_bits(sampler, paths, i, depth, LIGHT_U)
            row, column, corners, s, t, some = sample_cell(image, first, second, like)
            colour = filtered(corners, s, t)
            local, sine = direction(image, row, column, s, t)
            pdf = density(image, row, column, corners, colour, sine)
            wanted = wanted & some & (pdf > 0.0)
            wi = turned(image.turn, local, 1, 3)
            light = wi, scaled(colour, 1.0 / select(wanted, pdf, splat(1.0, like))), pdf
            put(incident, i, wanted, (starts(vertices, i), wi, splat(np.inf, like)), light)


@kernel
def see_image(paths, n, image, radiance):
    """Add the radiance of the image that paths see where they leave the scene, weighted by multiple importance."""
    like, size = packet(paths.pdf), len(paths.pdf)
    for i in range(0, n, packet_width(paths.pdf)):
        gone = (load(paths.rays.hits.prim_id, i, like) < np.int32(0)) & (lane_numbers(like) < np.int32(n - i))
        gone = gone & ~brought(load(paths.state, i, like))
        if bits(gone) == 0:
            continue
        colour, other = seen(image, load3(paths.rays.d, i, size, like))
        weight = power_heuristic(load(paths.pdf, i, like), other)
        throughput = load3(paths.throughput, i, size, like)
        value = (
            weight * throughput[0] * colour[0],
            weight * throughput[1] * colour[1],
            weight * throughput[2] * colour[2],
        )
        add(radiance, size, load(paths.rays.slot, i, like), value, gone)
