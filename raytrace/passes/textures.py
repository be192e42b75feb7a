"""Textures: colours that vary over surfaces, looked up where paths meet them and where lamps are sampled.

All numbers are those of the kernels' precision. An image repeats; the centre of texel (i, j) lies at
((i + 1/2) / w, (j + 1/2) / h), row 0 at the bottom. Interpolation is a + t (b - a), so that equal colours are kept.
"""

import numpy as np

from raytrace.accel.hit_points import blend
from raytrace.accel.lanes import (
    absolute,
    bits,
    gather,
    load,
    machine_epsilon,
    packet,
    packet_width,
    peek,
    select,
    splat,
    splat_int,
    sqrt,
    to_int,
    to_real,
)  # fmt: skip
from raytrace.accel.vectors import choose3
from raytrace.jit import inlined, kernel
from raytrace.passes.surface import load3, numbers_of, one_row, row_of, store3, vector_of
from raytrace.texture_records import CHECKERBOARD, NEAREST


@inlined
def floor(x, eps):
    """The largest whole number that is at most x, exactly, for lanes of any finite size.

    Below 1 / eps, adding 1 / eps and subtracting it rounds |x| to a whole number; above, all numbers are whole.
    """
    size = absolute(x)
    near = select(size < 1.0 / eps, (size + 1.0 / eps) - 1.0 / eps, size)
    near = select(x < 0.0, -near, near)
    return select(near > x, near - 1.0, near)


@inlined
def fraction(x, eps):
    """The part of x above its floor, in [0, 1); 0 where that rounds to 1, and where x is not finite."""
    part = x - floor(x, eps)
    return select((part >= 0.0) & (part < 1.0), part, 0.0)


@inlined
def is_odd(x, eps):
    """Whether the floor of x is odd."""
    whole = floor(x, eps)
    return whole - 2.0 * floor(0.5 * whole, eps) == 1.0


@inlined
def colour_of(texels, index):
    """Colours of texels."""
    at = index * np.int32(3)
    return gather(texels, at), gather(texels, at + np.int32(1)), gather(texels, at + np.int32(2))


@inlined
def between(a, b, t):
    """Colours a + t (b - a)."""
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])


@inlined
def uv_at(uv, prim, u, v):
    """Texture coordinates, interpolated between the corners of triangles."""
    return (
        blend(row_of(uv, prim, 6, 0), row_of(uv, prim, 6, 2), row_of(uv, prim, 6, 4), u, v),
        blend(row_of(uv, prim, 6, 1), row_of(uv, prim, 6, 3), row_of(uv, prim, 6, 5), u, v),
    )


@inlined
def colors_at(colors, prim, u, v):
    """Colours, interpolated between the corners of triangles."""
    return (
        blend(row_of(colors, prim, 9, 0), row_of(colors, prim, 9, 3), row_of(colors, prim, 9, 6), u, v),
        blend(row_of(colors, prim, 9, 1), row_of(colors, prim, 9, 4), row_of(colors, prim, 9, 7), u, v),
        blend(row_of(colors, prim, 9, 2), row_of(colors, prim, 9, 5), row_of(colors, prim, 9, 8), u, v),
    )


@inlined
def square_at(first, s, t, eps):
    """Texels of a checkerboard: the first one where floor(s) + floor(t) is even."""
    a, b = is_odd(s, eps), is_odd(t, eps)
    return select((a & ~b) | (b & ~a), first + np.int32(1), first)


@inlined
def cell(x, width, eps):
    """Along one axis of an image: the texels before and after a coordinate, and how far it is from the first."""
    at = fraction(x, eps) * to_real(width, x) - 0.5
    low = to_int(at)
    low = select(to_real(low, x) > at, low - np.int32(1), low)
    t, high = at - to_real(low, x), low + np.int32(1)
    return select(low < np.int32(0), low + width, low), select(high < width, high, high - width), t


@inlined
def bilinear_at(texels, first, size, s, t, eps):
    """Colours of images of a size (width, height), interpolated between four texels."""
    x0, x1, tx = cell(s, size[0], eps)
    y0, y1, ty = cell(t, size[1], eps)
    low, high = first + y0 * size[0], first + y1 * size[0]
    bottom = between(colour_of(texels, low + x0), colour_of(texels, low + x1), tx)
    return between(bottom, between(colour_of(texels, high + x0), colour_of(texels, high + x1), tx), ty)


@inlined
def nearest_at(first, size, s, t, eps):
    """Texels of images of a size (width, height) in whose squares coordinates lie."""
    x, y = to_int(fraction(s, eps) * to_real(size[0], s)), to_int(fraction(t, eps) * to_real(size[1], t))
    x = select(x < size[0], x, size[0] - np.int32(1))
    y = select(y < size[1], y, size[1] - np.int32(1))
    return first + y * size[0] + x


@inlined
def varied_by_color(colors, prim, u, v):
    if colors is None:
        zero = splat(0.0, u)
        return zero, zero, zero
    return colors_at(colors, prim, u, v)


@inlined
def numbers_of_textures(textures, row):
    """Kind, first texel, size and scale of textures."""
    layout, scale = textures.layout, textures.scale
    if one_row(row):
        like, at = packet(scale), np.int64(row[0]) * 4
        size = splat_int(peek(layout, at + 2), row), splat_int(peek(layout, at + 3), row)
        factors = splat(peek(scale, at // 2), like), splat(peek(scale, at // 2 + 1), like)
        return splat_int(peek(layout, at), row), splat_int(peek(layout, at + 1), row), size, factors
    size = row_of(layout, row, 4, 2), row_of(layout, row, 4, 3)
    factors = row_of(scale, row, 2, 0), row_of(scale, row, 2, 1)
    return row_of(layout, row, 4, 0), row_of(layout, row, 4, 1), size, factors


@inlined
def varied_by_uv(uv, textures, row, point, colour):
    """Colours of images and checkerboards; ``colour`` for textures of another kind."""
    if uv is None:
        return colour
    prim, u, v = point
    eps = machine_epsilon(textures.scale)
    kind, first, size, scale = numbers_of_textures(textures, row)
    a, b = vector_of(uv, prim, 6, 0), vector_of(uv, prim, 6, 3)  # as ``uv_at``
    s, t = blend(a[0], a[2], b[1], u, v) * scale[0], blend(a[1], b[0], b[2], u, v) * scale[1]
    near, board = kind == np.int32(NEAREST), kind == np.int32(CHECKERBOARD)
    if bits(near | board) != 0:
        texel = select(near, nearest_at(first, size, s, t, eps), square_at(first, s, t, eps))
        colour = choose3(near | board, colour_of(textures.texels, select(near | board, texel, first)), colour)
    smooth = kind < np.int32(NEAREST)
    if bits(smooth) != 0:
        colour = choose3(smooth, bilinear_at(textures.texels, first, size, s, t, eps), colour)
    return colour


@inlined
def texture_at(textures, row, point):
    """Colours of textures at points: triangles, and barycentric coordinates u and v."""
    colour = varied_by_color(textures.colors, point[0], point[1], point[2])
    return varied_by_uv(textures.uv, textures, row, point, colour)


@inlined
def varied(textures, rows, material, point, constant):
    """Colours of materials at points, as ``texture_at`` has them; ``rows`` says which of them have a texture."""
    row = gather(rows, material)
    textured = row >= np.int32(0)
    if bits(textured) == 0:
        return constant
    return choose3(textured, texture_at(textures, select(textured, row, np.int32(0)), point), constant)


@kernel
def look_up_reflectance(paths, n, textures, surfaces, vertices):
    """Reflectance of the surfaces that paths meet, from textures or from the table of materials."""
    like, size = packet(paths.pdf), len(paths.pdf)
    hits = paths.rays.hits
    for i in range(0, n, packet_width(paths.pdf)):
        material = load(vertices.material_id, i, like)
        there = material >= np.int32(0)
        if bits(there) == 0:
            continue
        material, prim = numbers_of(material, there), numbers_of(load(hits.prim_id, i, like), there)
        u, v = load(hits.u, i, like), load(hits.v, i, like)
        constant = vector_of(surfaces.reflectance, material, 3, 0)
        colour = varied(textures, textures.reflectance, material, (prim, u, v), constant)
        store3(vertices.reflectance, i, size, colour)


@inlined
def reflectance_of(column, surfaces, material, i, size):
    """Reflectance of the surfaces that paths i, i + 1, ... meet; column: ``Vertices.reflectance``."""
    if column is None:
        return vector_of(surfaces.reflectance, material, 3, 0)
    return load3(column, i, size, packet(surfaces.reflectance))


@inlined
def index_of(column, surfaces, material, i, size):
    """Index and absorption index of conductors; those of a textured reflectance r are 1 and 2 sqrt(r / (1 - r))."""
    eta, k = vector_of(surfaces.eta, material, 3, 0), vector_of(surfaces.k, material, 3, 0)
    if column is None:
        return eta, k
    r = load3(column, i, size, packet(surfaces.reflectance))
    textured, one = eta[0] == 0.0, splat(1.0, r[0])
    own = 2.0 * sqrt(r[0] / (1.0 - r[0])), 2.0 * sqrt(r[1] / (1.0 - r[1])), 2.0 * sqrt(r[2] / (1.0 - r[2]))
    return choose3(textured, (one, one, one), eta), choose3(textured, own, k)
