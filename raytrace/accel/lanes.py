"""SIMD lanes: the operations in which kernels are written, such as ``t = fma(plane, inv_d, c)``.

One variable holds a vector register: sixteen rays, or eight boxes. The usual operators work lane by lane, scalars are
broadcast to all lanes, a comparison gives a mask, and ``mask & mask``, ``mask | mask``, ``~mask`` combine masks. In
this file each operation is a plain NumPy function, and a register is a short NumPy array that can be printed. Kernels
run that way when the JIT is disabled. ``lanes_jit`` gives Numba the LLVM instruction of each operation.
"""

from fractions import Fraction
from functools import cache

import numpy as np

from raytrace.native import processor

NODE = 8  # lanes of a node: one ray against eight boxes or triangles, in either precision
PACKET = 16  # most rays of a packet on any machine
BITS = processor.register_bits()  # of one vector register


def packet_width(a):
    """Rays of a packet, for floats like those of ``a``: as many as fill a register (16, 8, 4 float32; half float64)."""
    return BITS // 8 // a.itemsize


def group_size(a):
    """Lanes of a group in packets of elements like those of ``a``: neighbouring rays that share one frustum.

    It is also the largest number of packets of a bundle, so the groups of a bundle fill one register.
    """
    return min(4, packet_width(a))


def machine_epsilon(a):
    """Distance from 1 to the next larger number of the dtype of ``a``."""
    return np.finfo(a.dtype).eps


def machine_largest(a):
    """The largest finite number of the dtype of ``a``."""
    return np.finfo(a.dtype).max


def peek(a, i):
    """Element ``i`` of the flat array ``a``; ``i`` is not negative, so no index wraps around."""
    return a[i]


def poke(a, i, x):
    """Write element ``i`` of the flat array ``a``."""
    a[i] = x


def prefetch(a, i):
    """Bring element ``i`` of the flat array ``a`` and its neighbours into the cache."""


def load(a, i, like):
    """Elements ``i``, ``i + 1``, ... of the flat array ``a``, as many as the number or the register ``like`` says."""
    return a[i : i + (like if isinstance(like, int) else len(like))].copy()


def load_rows(a, i, like):
    """x, y, z of rows of three that begin at element ``i``: three registers, each as by ``load`` with stride 3."""
    n = like if isinstance(like, int) else len(like)
    return tuple(a[i + axis : i + 3 * n : 3].copy() for axis in range(3))


def _rows_of_block(i, line, n):
    """Where the rows of a block of n elements begin, and how long they are."""
    length = min(n, 4)
    return range(i, i + n // length * line, line), length


def load_block(a, i, line, like):
    """Rows of four elements of the flat array ``a``, from elements ``i``, ``i + line``, ... on, side by side."""
    starts, length = _rows_of_block(i, line, len(like))
    return np.concatenate([a[start : start + length] for start in starts])


def load_block_rows(a, i, line, like):
    """x, y, z of a block: rows of four times three elements begin at elements ``i``, ``i + line``, ..."""
    starts, length = _rows_of_block(i, line, len(like))
    return tuple(np.concatenate([a[at + k : at + k + 3 * length - 2 : 3] for at in starts]) for k in range(3))


def store_block(a, i, line, x):
    """Write a register to rows of four elements of the flat array ``a``, from ``i``, ``i + line``, ... on."""
    starts, length = _rows_of_block(i, line, len(x))
    for k, start in enumerate(starts):
        a[start : start + length] = x[k * length : (k + 1) * length]


def packet(a):
    """A register of zeros for one packet of elements like those of ``a``."""
    return np.zeros(packet_width(a), a.dtype)


def store(a, i, x):
    """Write a register to the flat array ``a`` from element ``i`` on."""
    a[i : i + len(x)] = x


def gather(a, index):
    """Lane k is ``a[index[k]]``."""
    return a[index]


def compress(a, i, mask, x):
    """Write the lanes of ``x`` where ``mask`` holds to consecutive elements of the flat array ``a``, from ``i`` on."""
    a[i : i + np.count_nonzero(mask)] = x[mask]


def store_packed(a, i, mask, x):
    """Write the lanes of ``x`` where ``mask`` holds to elements ``i``, ``i + 1``, ... of the flat array ``a``.

    As many elements as ``x`` has lanes are written: those after the last such lane hold anything.
    """
    a[i : i + np.count_nonzero(mask)] = x[mask]


def least_lane(mask, x):
    """Number of the lane with the least ``x`` where ``mask`` holds, not counting the last bits, as many as a lane has.

    Negative numbers are not compared in their order. Without any lane it is the last.
    """
    kind = np.dtype(f"i{x.itemsize}")
    keys = x.view(kind) & kind.type(-len(x)) | np.arange(len(x), dtype=kind)
    return int(np.where(mask, keys, np.iinfo(kind).max).min() & (len(x) - 1))


def peek_either(first, a, i, b, j):
    """Element ``i`` of the flat array ``a`` if ``first`` holds, else element ``j`` of ``b``; without a branch."""
    return a[i] if first else b[j]


def splat(x, like):
    """The scalar ``x`` in every lane of a register like ``like``."""
    return np.full_like(like, x)


def splat_int(x, like):
    """The int32 ``x`` in as many lanes as ``like`` has."""
    return np.full(like if isinstance(like, int) else len(like), x, np.int32)


def lane_numbers(like):
    """0, 1, 2, ... as int32, as many as ``like`` has lanes."""
    return np.arange(len(like), dtype=np.int32)


def to_real(x, like):
    """Integers below 2**24 as floats of the dtype of ``like``, exactly."""
    return x.astype(like.dtype)


def convert(x, like):
    """Floats as floats of the dtype of ``like``, rounded to nearest."""
    return x.astype(like.dtype)


def to_int(x):
    """Floats truncated to int32; none may be NaN or out of range."""
    return x.astype(np.int32)


def fma(a, b, c):
    """``a * b + c`` with a single rounding."""
    like = next(x for x in (a, b, c) if isinstance(x, np.ndarray))
    rows = zip(*(np.broadcast_to(np.asarray(x, like.dtype), like.shape).tolist() for x in (a, b, c)), strict=True)
    return np.array([_fma(*row, like.dtype.type) for row in rows]).astype(like.dtype)


def _fma(a, b, c, dtype):
    if not np.isfinite([a, b]).all() or a == 0.0 or b == 0.0:
        return a * b + c
    if not np.isfinite(c):
        return c
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    if exact == 0:
        return a * b + c
    try:
        nearest = float(exact)
    except OverflowError:
        return np.inf if exact > 0 else -np.inf
    if dtype is np.float64 or Fraction(nearest) == exact:
        return nearest
    # Rounding twice is safe if the first one ends in an odd bit [Boldo2008].
    odd = np.float64(nearest).view(np.int64) & 1
    return nearest if odd else float(np.nextafter(nearest, np.inf if exact > Fraction(nearest) else -np.inf))


def sqrt(x):
    """Square root, correctly rounded."""
    return np.sqrt(x)


def absolute(x):
    """Absolute value; also clears the sign of zeros."""
    return np.abs(x)


def reverse_bits(x):
    """uint32 with its bits in reverse order."""
    return np.array([int(f"{value:032b}"[::-1], 2) for value in x.tolist()], np.uint32)


def minimum(a, b):
    """``a if a < b else b``: where either is NaN, ``b``."""
    return np.where(a < b, a, b)


def maximum(a, b):
    """``a if a > b else b``: where either is NaN, ``b``."""
    return np.where(a > b, a, b)


def select(mask, a, b):
    """``a`` where the mask holds, else ``b``."""
    return np.where(mask, a, b)


def power_of_two(x):
    """The largest power of two that is at most ``|x|``: only its exponent bits; 0 for zero and denormal numbers."""
    power = np.ldexp(np.ones_like(x), np.frexp(x)[1] - 1)
    return np.where(np.abs(x) < np.finfo(x.dtype).tiny, 0, power).astype(x.dtype)


def bits(mask):
    """The mask as an integer: bit k is lane k."""
    return sum(1 << k for k, true in enumerate(mask.tolist()) if true)


def mask_of(x, like):
    """The mask whose lane k is bit k of the integer ``x``, as wide as ``like``."""
    return _mask_of(x, len(like))


@cache
def _mask_of(x, n):
    return np.array([x >> k & 1 == 1 for k in range(n)])


def count(mask):
    """Number of lanes in which the mask is true."""
    return int(np.count_nonzero(mask))


def lane_min(x):
    """Smallest lane; none may be NaN."""
    return x.min()


def lane_max(x):
    """Largest lane; none may be NaN."""
    return x.max()


def group_min(x):
    """In every lane the minimum of its group of four neighbours (of two, if a register has two lanes)."""
    return np.repeat(x.reshape(-1, min(4, len(x))).min(axis=1), min(4, len(x)))


def group_max(x):
    """In every lane the maximum of its group of four neighbours (of two, if a register has two lanes)."""
    return np.repeat(x.reshape(-1, min(4, len(x))).max(axis=1), min(4, len(x)))


def first_bit(x):
    """Index of the lowest bit that is set; ``x`` is not 0."""
    return int(x & -x).bit_length() - 1
