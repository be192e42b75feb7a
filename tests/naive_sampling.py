"""Twins of the samplers in plain integers; every function also takes arrays of uint64 that hold 32 bits."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

MASK = 0xFFFFFFFF  # arithmetic modulo 2^32


def mix(h: Any) -> Any:
    """A bijection of 32 bits that spreads every bit over all [lowbias32, Wellons 2018]."""
    h = ((h ^ (h >> 16)) * 0x7FEB352D) & MASK
    h = ((h ^ (h >> 15)) * 0x846CA68B) & MASK
    return h ^ (h >> 16)


def key(seed: Any, x: Any, y: Any, dim: Any) -> Any:
    """The 32 bits that stand for a dimension of a pixel."""
    h = mix(seed)
    for part in (x, y, dim):
        h = mix((h + part) & MASK)
    return mix(h)


def to_unit(bits: Any) -> Any:
    """24 of 32 bits as a number in [0, 1)."""
    return (bits >> 8) * 2.0**-24


def uniform(seed: Any, x: Any, y: Any, s: Any, dim: Any) -> Any:
    """Sampler "independent"."""
    return to_unit(mix((key(seed, x, y, dim) + s) & MASK))


def bit_reverse(x: Any) -> Any:
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF)):
        x = ((x >> shift) & mask) | ((x & mask) << shift)
    return x


def sobol_raw(s: Any, dim: int) -> Any:
    """Bits of point s of the first two Sobol dimensions, in natural order [Joe2008]."""
    if dim == 0:
        return bit_reverse(s)
    bits, direction = s & 0, 0x80000000
    for i in range(32):
        bits = bits ^ (((s >> i) & 1) * direction)
        direction ^= direction >> 1
    return bits


def owen_scramble(bits: Any, k: Any) -> Any:
    """Nested uniform scrambling by a hash that carries upwards only [Laine2011], constants of [Vegdahl2021]."""
    x = bit_reverse(bits)
    x ^= (x * 0x3D20ADEA) & MASK
    x = (x + k) & MASK
    x = (x * ((k >> 16) | 1)) & MASK
    x ^= (x * 0x05526C56) & MASK
    x ^= (x * 0x53A22864) & MASK
    return bit_reverse(x)


def mirrored(bits: Any, k: Any) -> Any:
    """Scramble all bits but the first for themselves, as a Gray code; the first one mirrors the others."""
    gray = owen_scramble((bits << 1) & MASK, k) >> 1
    plain = gray & 0
    while np.any(gray):
        plain, gray = plain ^ gray, gray >> 1
    first = (bits ^ k) >> 31
    return plain ^ (first * MASK)


def owen_sobol(seed: Any, x: Any, y: Any, s: Any, dim: int) -> Any:
    """Sampler "sobol"."""
    return to_unit(mirrored(sobol_raw(s, dim), key(seed, x, y, dim)))


def stratified(seed: Any, x: Any, y: Any, s: Any, dim: int, spp: int) -> Any:
    """Sampler "stratified": one jittered point in each cell of a grid, from a cell on that the pixel's key chooses.

    The next one is a golden section of the grid further on, or as near below it as meets all cells.
    """
    nx = math.isqrt(spp - 1) + 1  # ceil(sqrt(spp))
    ny = -(-spp // nx)
    n = nx * ny
    step = max(k for k in range(1, max(round(n * (5**0.5 - 1) / 2), 1) + 1) if math.gcd(k, n) == 1)
    j = (s % n * step + key(seed, x, y, 2) % n) % n
    cell, side = ((j % nx), nx) if dim == 0 else ((j // nx), ny)
    return (cell + uniform(seed, x, y, s, dim)) / side


def film_points(
    sampler: str, seed: int, spp: int, window: tuple[int, int, int, int], first: int = 0
) -> NDArray[np.float64]:
    """Film points (h, w, spp, 2) in pixels of the window (x, y, w, h) of the film."""
    left, top, width, height = window
    axes = (range(top, top + height), range(left, left + width), range(first, first + spp))
    y, x, s = np.meshgrid(*(np.array(axis, np.uint64) for axis in axes), indexing="ij")
    extra = (spp,) if sampler == "stratified" else ()
    draw = {"independent": uniform, "sobol": owen_sobol, "stratified": stratified}[sampler]
    return np.stack([x + draw(seed, x, y, s, 0, *extra), y + draw(seed, x, y, s, 1, *extra)], axis=-1)
