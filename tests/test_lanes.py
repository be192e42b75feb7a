"""Every operation on lanes: compiled against its meaning in NumPy, and that against numbers worked out by hand."""

from fractions import Fraction
from itertools import product

import numba
import numpy as np
import pytest

import rays
from raytrace.accel import lanes
from raytrace.accel.lanes import (
    absolute,
    bits,
    compress,
    convert,
    count,
    first_bit,
    fma,
    gather,
    lane_max,
    lane_min,
    lane_numbers,
    load,
    load_block,
    load_block_rows,
    load_rows,
    machine_epsilon,
    mask_of,
    maximum,
    minimum,
    packet,
    packet_width,
    peek,
    poke,
    power_of_two,
    prefetch,
    reverse_bits,
    select,
    splat,
    splat_int,
    sqrt,
    store,
    store_block,
    to_int,
    to_real,
)
from raytrace.native import compiler  # noqa: F401  (teaches Numba the lanes, and their width)

pytestmark = pytest.mark.engine

WIDTHS = (4, 8, 16)
FLOATS = ("float32", "float64")


def corners(dtype):
    """The numbers where arithmetic is peculiar."""
    info = np.finfo(dtype)
    numbers = [0.0, 1.0, 1.0 + info.eps, 1.5, 3.0, 0.1, 1e-3, 123456.7, info.max, info.tiny, info.smallest_subnormal]
    numbers += [info.tiny * 0.75, np.inf, info.max / 2]
    return np.array([*numbers, *(-x for x in numbers), np.nan], dtype)


def pairs(dtype):
    """All pairs of corners and some ordinary numbers, filled up to whole registers; three flat arrays."""
    a, b = np.array(list(product(corners(dtype), repeat=2)), dtype).T
    rng = np.random.default_rng(1)
    n = -(-(len(a) + 400) // 16) * 16
    more = rng.normal(size=(2, n - len(a))) * 10.0 ** rng.integers(-6, 7, (2, n - len(a)))
    c = rng.permutation(np.resize(np.concatenate([corners(dtype), rng.normal(size=60).astype(dtype)]), n))
    return np.concatenate([a, more[0].astype(dtype)]), np.concatenate([b, more[1].astype(dtype)]), c


REAL = [*"+-*/", "neg", "sqrt", "absolute", "minimum", "maximum", "select", "scalar first", "scalar last"]
REAL += ["select with a scalar", "minimum with a scalar", "splat", "splat of a lane"]
TRUTH = ["<", "<=", ">", ">=", "==", "!=", "and", "or", "not", "loaded", "scalar"]


def real_kernel(width):
    """One kernel with every operation on floats, so that few are compiled."""

    def kernel(a, b, c, out, truth, number, power):
        size = len(a)
        for i in range(0, size, width):
            x, y, z = load(a, i, width), load(b, i, width), load(c, i, width)
            store(out, i, x + y)
            store(out, size + i, x - y)
            store(out, 2 * size + i, x * y)
            store(out, 3 * size + i, x / y)
            store(out, 4 * size + i, -x)
            store(out, 5 * size + i, sqrt(x))
            store(out, 6 * size + i, absolute(x))
            store(out, 7 * size + i, minimum(x, y))
            store(out, 8 * size + i, maximum(x, y))
            store(out, 9 * size + i, select(z > 0.0, x, y))
            store(out, 10 * size + i, 1.0 / x)
            store(out, 11 * size + i, x * 3 - 0.1)
            store(out, 12 * size + i, select(x < y, 0.1, x))
            store(out, 13 * size + i, minimum(x, 0.5))
            store(out, 14 * size + i, splat(0.1, x))
            store(out, 15 * size + i, splat(y[3], x))
            store(truth, i, x < y)
            store(truth, size + i, x <= y)
            store(truth, 2 * size + i, x > y)
            store(truth, 3 * size + i, x >= y)
            store(truth, 4 * size + i, x == y)
            store(truth, 5 * size + i, x != y)
            store(truth, 6 * size + i, (x < y) & (y < z))
            store(truth, 7 * size + i, (x < y) | (y < z))
            store(truth, 8 * size + i, ~(x < y))
            store(truth, 9 * size + i, load(truth, size + i, width))
            store(truth, 10 * size + i, x <= 0.5)
            number[i] = bits(x < y)
            number[i + 1] = count(x < y)
            number[i + 2] = first_bit(bits(x <= y) | 1 << 40)
            store(power, i, power_of_two(select(absolute(x) < np.inf, x, 1.0)))

    return numba.njit(error_model="numpy")(kernel)


KERNELS = {width: real_kernel(width) for width in WIDTHS}


def plain(kernel):
    return getattr(kernel, "py_func", kernel)


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("width", WIDTHS)
def test_operations_on_floats_are_compiled_to_their_meaning(width, dtype):
    a, b, c = pairs(dtype)
    n = len(a)
    got, expected = (
        (np.empty(len(REAL) * n, dtype), np.empty(len(TRUTH) * n, bool), np.zeros(n, np.int64), np.empty(n, dtype))
        for _ in range(2)
    )
    with np.errstate(all="ignore"):
        KERNELS[width](a, b, c, *got)
        plain(KERNELS[width])(a, b, c, *expected)
    for name, x, y in zip(REAL, got[0].reshape(-1, n), expected[0].reshape(-1, n), strict=True):
        assert rays.same_bits(x, y), name
    for name, x, y in zip(TRUTH, got[1].reshape(-1, n), expected[1].reshape(-1, n), strict=True):
        assert np.array_equal(x, y), name
    assert np.array_equal(got[2], expected[2])
    assert rays.same_bits(got[3], expected[3])


@pytest.mark.parametrize("dtype", FLOATS)
def test_compiled_operations_are_those_of_numpy(dtype):
    """The same results once more, without the plain functions: no error can hide in both."""
    a, b, c = pairs(dtype)
    n, width = len(a), 8
    out, truth, number, power = (
        np.empty(len(REAL) * n, dtype),
        np.empty(len(TRUTH) * n, bool),
        np.zeros(n, int),
        a.copy(),
    )
    with np.errstate(all="ignore"):
        KERNELS[width](a, b, c, out, truth, number, power)
        expected = {
            "+": a + b,
            "-": a - b,
            "*": a * b,
            "/": a / b,
            "neg": -a,
            "sqrt": np.sqrt(a),
            "absolute": np.abs(a),
        }
    out = dict(zip(REAL, out.reshape(-1, n), strict=True))
    truth = dict(zip(TRUTH, truth.reshape(-1, n), strict=True))
    for name, values in expected.items():
        assert rays.same_bits(out[name], values), name
    for name, values in {
        "<": a < b,
        ">=": a >= b,
        "==": a == b,
        "!=": a != b,
        "not": ~(a < b),
        "and": (a < b) & (b < c),
    }.items():
        assert np.array_equal(truth[name], values), name
    less = (a < b).reshape(-1, width)
    assert np.array_equal(number[::width], less @ (1 << np.arange(width)))
    assert np.array_equal(number[1::width], less.sum(axis=1))
    either = np.isnan(a) | np.isnan(b)
    assert either.any()
    for name in ("minimum", "maximum"):  # of zeros of two signs, too, the second
        assert rays.same_bits(out[name][either | (a == b)], b[either | (a == b)])
    normal = np.isfinite(a) & (np.abs(a) >= np.finfo(dtype).tiny)
    assert ((power <= np.abs(a)) & (np.abs(a) / 2 < power))[normal].all()
    assert (np.frexp(power[normal])[0] == 0.5).all()
    assert (power[np.abs(a) < np.finfo(dtype).tiny] == 0).all()


def fma_kernel(width):
    def kernel(a, b, c, out):
        size = len(a)
        for i in range(0, size, width):
            x, y, z = load(a, i, width), load(b, i, width), load(c, i, width)
            store(out, i, fma(x, y, z))
            store(out, size + i, fma(2.5, x, 0.1))

    return numba.njit(error_model="numpy")(kernel)


FMA = {width: fma_kernel(width) for width in WIDTHS}


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("width", WIDTHS)
def test_fma_is_compiled_to_its_meaning(width, dtype):
    a, b, c = pairs(dtype)
    got, expected = np.empty((2, 2 * len(a)), dtype)
    with np.errstate(all="ignore"):
        FMA[width](a, b, c, got)
        plain(FMA[width])(a, b, c, expected)
    assert rays.same_bits(got, expected)


@pytest.mark.nojit
@pytest.mark.parametrize("dtype", FLOATS)
def test_fma_is_rounded_once(dtype):
    """Against rationals: the result is the nearest number, of two the even one."""
    rng = np.random.default_rng(2)
    a, b = (rng.normal(size=(2, 400)) * 10.0 ** rng.integers(-3, 4, (2, 400))).astype(dtype)
    c = (-(a * b) * rng.choice([1, 1 + np.finfo(dtype).eps, 1 - 1e-3, 0.3, 1e5], 400)).astype(dtype)  # much cancels
    half = 12 if dtype == "float32" else 26
    a[0], b[0], c[0] = 1 + 2.0**-half, 1 + 2.0**-half, 2.0 ** (-2 * half)  # a tie
    got = fma(a, b, c)
    assert got.dtype == dtype
    out = np.empty(2 * 400, dtype)
    FMA[8](a, b, c, out)
    assert rays.same_bits(out[:400], got)
    twice = 0
    for x, y, z, r in zip(a, b, c, got, strict=True):
        exact = Fraction(float(x)) * Fraction(float(y)) + Fraction(float(z))
        error = abs(Fraction(float(r)) - exact)
        for end in (np.inf, -np.inf):
            rival = abs(Fraction(float(np.nextafter(r, r.dtype.type(end)))) - exact)
            assert error < rival or (error == rival and r.view(f"u{r.itemsize}") % 2 == 0)
        twice += x * y + z != r
    assert twice > 50  # two roundings do differ


@pytest.mark.nojit
def test_plain_functions_mean_what_they_say():
    nan = np.nan
    x = np.array([1, nan, 3, -0.0], "f4")
    y = np.array([nan, 2, 2, 0.0], "f4")
    assert rays.same_bits(minimum(x, y), np.array([nan, 2, 2, 0.0], "f4"))
    assert rays.same_bits(maximum(x, y), np.array([nan, 2, 3, 0.0], "f4"))
    assert rays.same_bits(minimum(1.5, y), np.array([nan, 1.5, 1.5, 0.0], "f4"))
    assert rays.same_bits(select(x == 1, x, 7.5), np.array([1, 7.5, 7.5, 7.5], "f4"))
    assert bits(np.array([True, False, True, True])) == 13
    assert count(np.array([True, False, True, True])) == 3
    assert first_bit(40) == first_bit(np.int64(40)) == 3
    assert mask_of(13, x).tolist() == [True, False, True, True]
    assert to_int(np.array([2.9, -2.9, -0.0], "f4")).tolist() == [2, -2, 0]
    assert reverse_bits(np.array([1, 3 << 30, 0xF0000001], np.uint32)).tolist() == [1 << 31, 3, 0x8000000F]
    assert power_of_two(np.array([3.99, -0.3, 4, 0, 1e-40], "f4")).tolist() == [2, 0.25, 4, 0, 0]
    assert load(np.arange(9.0), 2, 4).tolist() == [2, 3, 4, 5]
    assert [column.tolist() for column in load_rows(np.arange(9.0), 1, 2)] == [[1, 4], [2, 5], [3, 6]]
    eight = np.zeros(8)
    assert load_block(np.arange(20.0), 2, 10, eight).tolist() == [2, 3, 4, 5, 12, 13, 14, 15]
    assert load_block_rows(np.arange(50.0), 1, 20, eight)[1].tolist() == [2, 5, 8, 11, 22, 25, 28, 31]
    block = np.zeros(12)
    store_block(block, 1, 6, np.arange(8.0) + 1)
    assert block.tolist() == [0, 1, 2, 3, 4, 0, 0, 5, 6, 7, 8, 0]
    assert convert(np.array([1 + 2.0**-30, -2]), x[:2].astype("f4")).tolist() == [1, -2]
    assert lane_numbers(x).tolist() == [0, 1, 2, 3]
    assert splat_int(-1, 4).tolist() == [-1] * 4
    assert gather(np.arange(9.0), np.array([8, 0], np.int32)).tolist() == [8, 0]
    assert (lane_min(y[1:]), lane_max(y[1:])) == (0, 2)
    target = np.zeros(4)
    compress(target, 1, np.array([False, True, True, False]), np.arange(4.0))
    assert target.tolist() == [0, 1, 2, 0]


def whole_kernel(width):
    """Every operation on integers, and those that move lanes about."""

    def kernel(u, v, i32, reals, mask, out, out_i, out_f, moved):
        size = len(u)
        for i in range(0, size, width):
            x, y, k = load(u, i, width), load(v, i, width), load(i32, i, width)
            f = load(reals, i, width)
            store(out, i, x + y)
            store(out, size + i, x - y)
            store(out, 2 * size + i, x * y)
            store(out, 3 * size + i, x ^ (y >> np.uint32(7)))
            store(out, 4 * size + i, (x >> np.uint32(16)) | np.uint32(1))
            store(out, 5 * size + i, x // y)
            store(out, 6 * size + i, x % y)
            store(out, 7 * size + i, reverse_bits(x))
            store(out, 8 * size + i, select(x < y, x, y))
            store(out, 9 * size + i, splat(np.uint32(0xFFFFFFFF), x) + np.uint32(2))
            store(out, 10 * size + i, x % np.uint32(1000))
            store(out, 11 * size + i, (x & y) << np.uint32(3))
            store(out_i, i, k * np.int32(3) - lane_numbers(f))
            store(out_i, size + i, select(k < np.int32(5), k, splat_int(-1, f)))
            store(out_i, 2 * size + i, splat_int(7, width))
            store(out_i, 3 * size + i, select(k >= 0, k, np.int32(0)))
            store(out_i, 4 * size + i, gather(i32, lane_numbers(f)))
            store(out_i, 5 * size + i, to_int(f * 100.0))
            store(out_i, 6 * size + i, select(mask_of(bits(f > 0.0), f), k, np.int32(0)))
            store(out_f, i, to_real(x >> np.uint32(8), f))
            store(out_f, size + i, gather(reals, lane_numbers(f) + np.int32(i)))
            store(out_f, 2 * size + i, splat(lane_min(f), f))
            store(out_f, 3 * size + i, splat(lane_max(f), f))
            out_f[4 * size + i] = f[width - 1]
            prefetch(reals, i)
            poke(out_f, 4 * size + i + 1, peek(reals, i))
            if 3 * (i + width) <= size:
                rows = load_rows(reals, 3 * i, width)
                store(out_f, 5 * size + i, rows[0])
                store(out_f, 6 * size + i, rows[1])
                store(out_f, 7 * size + i, rows[2])
            sent = load(mask, i, width)
            compress(moved, moved_so_far(mask, i), sent, f)

    return numba.njit(error_model="numpy")(kernel)


@numba.njit
def moved_so_far(mask, i):
    number = 0
    for k in range(i):
        number += mask[k]
    return number


@pytest.mark.parametrize(("width", "dtype"), [(4, "float64"), (8, "float32"), (16, "float32")])
def test_operations_on_integers_and_moves_are_compiled_to_their_meaning(width, dtype):
    rng = np.random.default_rng(3)
    n = 160
    u, v = rng.integers(1, 2**32, (2, n), np.uint32)
    u[:8], v[:8] = [0, 1, 2**31, 2**32 - 1] * 2, [1] * 4 + [2**32 - 1] * 4
    i32 = rng.integers(-9, 10, n, np.int32)
    reals, mask = rng.normal(size=n).astype(dtype), rng.random(n) < 0.4
    mask[:16], mask[16:32] = True, False
    outputs = [
        (np.zeros(12 * n, np.uint32), np.zeros(7 * n, np.int32), np.zeros(8 * n, dtype), np.full(n, 9, dtype))
        for _ in "ab"
    ]
    kernel = whole_kernel(width)
    kernel(u, v, i32, reals, mask, *outputs[0])
    plain(kernel)(u, v, i32, reals, mask, *outputs[1])
    for got, expected in zip(*outputs, strict=True):
        assert rays.same_bits(got, expected)
    out, out_i, out_f, moved = outputs[0]
    wide, other = u.astype(np.uint64), v.astype(np.uint64)
    for row, expected in enumerate(
        [wide + other, wide - other, wide * other, wide ^ (other >> 7), (wide >> 16) | 1, wide // other]
    ):
        assert np.array_equal(out[row * n : row * n + n], expected & 0xFFFFFFFF)
    assert np.array_equal(out[6 * n : 7 * n], wide % other)
    assert np.array_equal(out[10 * n : 11 * n], wide % 1000)
    assert np.array_equal(out[11 * n :], ((wide & other) << 3) & 0xFFFFFFFF)
    assert np.array_equal(out_i[3 * n : 4 * n], np.maximum(i32, 0))
    assert np.array_equal(out_i[5 * n : 6 * n], np.trunc(reals * np.dtype(dtype).type(100)).astype(np.int32))
    assert np.array_equal(out_i[6 * n :], np.where(reals > 0, i32, 0))
    assert np.array_equal(out_f[:n], (u >> 8).astype(dtype))
    assert rays.same_bits(out_f[n : 2 * n], reals)
    assert np.array_equal(out_f[2 * n : 3 * n], np.repeat(reals.reshape(-1, width).min(axis=1), width))
    whole = n // 3 // width * width
    assert np.array_equal(out_f[5 * n :].reshape(3, n)[:, :whole], reals[: 3 * whole].reshape(whole, 3).T)
    assert np.array_equal(moved, np.concatenate([reals[mask], np.full(n - mask.sum(), 9)]))  # and nothing beyond


@pytest.mark.nojit
@pytest.mark.parametrize("dtype", FLOATS)
def test_packets_fill_a_register(dtype):
    a = np.zeros(4, dtype)
    assert packet_width(a) * a.itemsize * 8 == lanes.BITS
    assert lanes.BITS in (128, 256, 512)
    assert len(packet(a)) == packet_width(a) <= rays.PACKET
    assert packet(a).dtype == dtype
    assert machine_epsilon(a) == np.finfo(dtype).eps

    @numba.njit
    def compiled(array):
        return packet_width(array), machine_epsilon(array)

    assert compiled(a) == (packet_width(a), np.finfo(dtype).eps)
