"""Positions of samples in a pixel: each number is a function of (seed, pixel, sample, dimension); there is no state."""

from math import ceil, gcd, sqrt
from typing import NamedTuple

import numpy as np

from raytrace.accel.lanes import minimum, reverse_bits, splat, to_real
from raytrace.jit import inlined, specialised

LAST = 1.0 - 2.0**-24  # the largest float32 below 1
FILM_X, FILM_Y, STRATUM = range(3)  # dimensions


class Sobol(NamedTuple):
    """Owen-scrambled Sobol points; each pixel has its own scrambling."""

    seed: int


class Stratified(NamedTuple):
    """One jittered point in each cell of a grid; successive cells lie far apart."""

    seed: int
    columns: int
    rows: int
    step: int  # from one cell to the next; cells are numbered row by row, and wrap around


class Independent(NamedTuple):
    """Independent uniform points."""

    seed: int


Sampler = Sobol | Stratified | Independent


def make_sampler(name, seed, spp):
    """Make the sampler of that name."""
    seed = np.uint32(seed)
    if name == "stratified":
        columns = ceil(sqrt(spp))
        rows = ceil(spp / columns)
        return Stratified(seed, np.uint32(columns), np.uint32(rows), np.uint32(golden_step(columns * rows)))
    return {"sobol": Sobol, "independent": Independent}[name](seed)


def golden_step(cells):
    """Stride through ``cells`` cells: near 0.618 cells, rounded down to a number that is coprime to ``cells``.

    So its multiples visit every cell, and any run of them is spread evenly   [Weyl1916].
    """
    step = max(1, round(0.6180339887 * cells))
    while gcd(step, cells) > 1:
        step -= 1
    return step


@inlined
def mix(h):
    """A bijective hash of 32 bits: lowbias32 of Wellons 2018."""
    h = (h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
    return h ^ (h >> np.uint32(16))


@inlined
def pixel_key(seed, x, y):
    """Hash of seed and pixel; lanes of uint32."""
    return mix(mix(mix(splat(seed, x)) + x) + y)


@inlined
def key(pixel, dimension):
    """Hash of seed, pixel and dimension.

    Mixed twice: the scrambling multiplies high bits by low ones. That would undo the last step of a single mixing, and
    leave the digits of x and y dependent.
    """
    return mix(mix(pixel + np.uint32(dimension)))


@inlined
def unit_interval(h, like):
    """Float in [0, 1) from the 24 highest bits, so that both precisions sample the same positions."""
    return to_real(h >> np.uint32(8), like) * 2.0**-24


@inlined
def owen(x, k):
    """Nested uniform scrambling of bit-reversed numbers, by a hash in which each bit changes only higher bits.

    Laine and Karras 2011, constants of Vegdahl 2021.
    """
    x = x ^ (x * np.uint32(0x3D20ADEA))
    x = x + k
    x = x * ((k >> np.uint32(16)) | np.uint32(1))
    x = x ^ (x * np.uint32(0x05526C56))
    x = x ^ (x * np.uint32(0x53A22864))
    return reverse_bits(x)


@inlined
def sobol_reversed(sample):
    """Second coordinate of Sobol point number ``sample``, its bits reversed.

    Direction numbers v_1 = 2^31, v_i = v_{i-1} ^ (v_{i-1} >> 1). The first coordinate reversed is the number itself.
    """
    x, v = np.uint32(0), np.uint32(1)
    while sample:
        if sample & 1:
            x ^= v
        v ^= v << np.uint32(1)
        sample >>= 1
    return x


def film_sample(sampler: Sampler, pixel, sample: int, like):
    """Position of a sample within its pixel, x and y in [0, 1).

    Parameters
    ----------
    sampler : Sobol, Stratified or Independent
    pixel : lanes of uint32
        ``pixel_key`` of the pixels.
    sample : int
    like : lanes
        A register of the float type of the result.
    """
    take = {Sobol: _sobol, Stratified: _stratified, Independent: _independent}[type(sampler)]
    return take(sampler, pixel, sample, like)


@inlined
def mirrored(x, k):
    """Scramble bit-reversed numbers so that two that differ only in their lowest bit become mirror images.

    The other bits are scrambled on their own, and read as a Gray code, in which the complement of a number differs from
    it in the first digit only.
    """
    g = owen(x >> np.uint32(1), k) >> np.uint32(1)
    g = g ^ (g >> np.uint32(1))
    g = g ^ (g >> np.uint32(2))
    g = g ^ (g >> np.uint32(4))
    g = g ^ (g >> np.uint32(8))
    g = g ^ (g >> np.uint32(16))
    return g ^ (np.uint32(0) - ((x ^ (k >> np.uint32(31))) & np.uint32(1)))


@inlined
def _sobol(sampler: Sobol, pixel, sample, like):
    x = mirrored(splat(np.uint32(sample), pixel), key(pixel, FILM_X))
    y = mirrored(splat(sobol_reversed(sample), pixel), key(pixel, FILM_Y))
    return unit_interval(x, like), unit_interval(y, like)


@inlined
def _independent(sampler: Sampler, pixel, sample, like):
    x = mix(key(pixel, FILM_X) + np.uint32(sample))
    y = mix(key(pixel, FILM_Y) + np.uint32(sample))
    return unit_interval(x, like), unit_interval(y, like)


@inlined
def _stratified(sampler: Stratified, pixel, sample, like):
    jitter_x, jitter_y = _independent(sampler, pixel, sample, like)
    cells = sampler.columns * sampler.rows
    cell = (key(pixel, STRATUM) % cells + np.uint32(sample) % cells * sampler.step) % cells
    row = cell // sampler.columns
    column = cell - row * sampler.columns
    x = (to_real(column, like) + jitter_x) / np.float64(sampler.columns)
    y = (to_real(row, like) + jitter_y) / np.float64(sampler.rows)
    return minimum(x, LAST), minimum(y, LAST)


@specialised(film_sample)
def _film_sample(sampler, pixel, sample, like):
    take = {Sobol: _sobol, Stratified: _stratified, Independent: _independent}[sampler.instance_class]
    return lambda sampler, pixel, sample, like: take(sampler, pixel, sample, like)


def path_bits(sampler, pixel, sample, dimension):
    """Two numbers of 32 random bits for a pair of dimensions that lies after those of the film.

    Parameters
    ----------
    sampler : Sobol, Stratified or Independent
    pixel : lanes of uint32
        ``pixel_key`` of the pixels.
    sample : lanes of uint32
        Numbers of the samples.
    dimension : int
        The first of the pair.
    """
    take = {Sobol: _sobol_bits, Stratified: _independent_bits, Independent: _independent_bits}[type(sampler)]
    return take(sampler, pixel, sample, dimension)


@inlined
def independent_bits(pixel, sample, dimension):
    """Two numbers of 32 random bits that know nothing of those of other samples."""
    return mix(key(pixel, dimension) + sample), mix(key(pixel, dimension + 1) + sample)


@inlined
def _independent_bits(sampler, pixel, sample, dimension):
    return independent_bits(pixel, sample, dimension)


@inlined
def _sobol_bits(sampler, pixel, sample, dimension):
    """Points of the first two Sobol dimensions, in an order of their own for each pair of dimensions.

    The order is a nested uniform scrambling of the sample's number, which keeps blocks of powers of two together: so
    the points of each pair are a net, and those of different pairs know nothing of each other [Burley2020].
    """
    index = owen(reverse_bits(sample), mix(key(pixel, dimension) ^ np.uint32(0x9E3779B9)))
    return owen(index, key(pixel, dimension)), owen(pascal(index), key(pixel, dimension + 1))


@inlined
def pascal(x):
    """Second coordinate of the Sobol points of numbers x, its bits reversed: ``sobol_reversed`` for lanes.

    Its direction numbers are the rows of Pascal's triangle modulo 2, (1 + y)^i for bit i: the polynomial whose
    coefficients are the bits of x, taken at 1 + y. Halves of it are shifted and added, in five steps.
    """
    x = x ^ ((x & np.uint32(0xAAAAAAAA)) >> np.uint32(1))
    x = x ^ ((x & np.uint32(0xCCCCCCCC)) >> np.uint32(2))
    x = x ^ ((x & np.uint32(0xF0F0F0F0)) >> np.uint32(4))
    x = x ^ ((x & np.uint32(0xFF00FF00)) >> np.uint32(8))
    return x ^ ((x & np.uint32(0xFFFF0000)) >> np.uint32(16))


@specialised(path_bits)
def _path_bits(sampler, pixel, sample, dimension):
    takes = {Sobol: _sobol_bits, Stratified: _independent_bits, Independent: _independent_bits}
    take = takes[sampler.instance_class]
    return lambda sampler, pixel, sample, dimension: take(sampler, pixel, sample, dimension)
