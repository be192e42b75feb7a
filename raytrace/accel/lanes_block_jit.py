"""Operations of ``lanes`` on rows of vectors and on blocks of pixels, for Numba."""

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import signature

from raytrace.accel import lanes
from raytrace.accel.lanes_jit import lane_count, pointer
from raytrace.accel.lanes_types import I32, I64, Lanes, Mask, registered, vector_of


def _vectors(a, like):
    return types.UniTuple(Lanes(a.dtype, lane_count(like)), 3)


def _emit_load_rows(builder, sig, args):
    """Three loads, whose columns are collected."""
    at, element, size = pointer(builder, sig, args)
    kind = vector_of(sig.return_type.dtype)
    places = [builder.gep(at, [I64(kind.count * k)], source_etype=element) for k in range(3)]
    return _columns(builder, [builder.load(place, align=size, typ=kind) for place in places], kind)


def _columns(builder, loads, kind):
    """Collect the columns of rows of three from three registers: first from two of them, then from the third."""
    n = kind.count
    rows = ir.Constant(ir.ArrayType(kind, 3), ir.Undefined)
    for axis in range(3):
        places = range(axis, 3 * n, 3)
        early = ir.Constant(ir.VectorType(I32, n), [place if place < 2 * n else 0 for place in places])
        late = ir.Constant(ir.VectorType(I32, n), [k if p < 2 * n else p - n for k, p in enumerate(places)])
        column = builder.shuffle_vector(builder.shuffle_vector(*loads[:2], early), loads[2], late)
        rows = builder.insert_value(rows, column, axis)
    return rows


def _rows_of_block(builder, sig, args, n):
    """Addresses of the rows of a block of n elements, their length and type, and the alignment of elements."""
    at, element, size = pointer(builder, sig, args)
    length = min(n, 4)
    offsets = [builder.mul(args[2], I64(k)) for k in range(n // length)]
    return [builder.gep(at, [offset], source_etype=element) for offset in offsets], length, element, size


def _joined(builder, parts):
    """Registers side by side in one; their number is a power of two."""
    while len(parts) > 1:
        both = ir.Constant(ir.VectorType(I32, 2 * parts[0].type.count), list(range(2 * parts[0].type.count)))
        parts = [builder.shuffle_vector(a, b, both) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


def _emit_load_block(builder, sig, args):
    rows, length, element, size = _rows_of_block(builder, sig, args, sig.return_type.n)
    return _joined(builder, [builder.load(row, align=size, typ=ir.VectorType(element, length)) for row in rows])


def _emit_load_block_rows(builder, sig, args):
    """Three loads per row, which seldom cross cache lines; joined, they are what a row of all elements would be."""
    kind = vector_of(sig.return_type.dtype)
    rows, length, element, size = _rows_of_block(builder, sig, args, kind.count)
    places = [builder.gep(row, [I64(k * length)], source_etype=element) for row in rows for k in range(3)]
    parts = [builder.load(at, align=size, typ=ir.VectorType(element, length)) for at in places]
    count = len(rows)
    return _columns(builder, [_joined(builder, parts[k * count : (k + 1) * count]) for k in range(3)], kind)


def _emit_store_block(builder, sig, args):
    values, n = args[3], sig.args[3].n
    rows, length, element, size = _rows_of_block(builder, sig, args, n)
    if isinstance(sig.args[3], Mask):
        values = builder.zext(values, ir.VectorType(element, n))
    for k, row in enumerate(rows):
        places = ir.Constant(ir.VectorType(I32, length), list(range(k * length, (k + 1) * length)))
        builder.store(builder.shuffle_vector(values, values, places), row, align=size)


registered(lambda a, i, like: signature(_vectors(a, like), a, types.int64, like), _emit_load_rows)(lanes.load_rows)


registered(
    lambda a, i, line, like: signature(Lanes(a.dtype, like.n), a, types.int64, types.int64, like),
    _emit_load_block,
)(lanes.load_block)


registered(
    lambda a, i, line, like: signature(_vectors(a, like), a, types.int64, types.int64, like),
    _emit_load_block_rows,
)(lanes.load_block_rows)


registered(
    lambda a, i, line, x: signature(types.none, a, types.int64, types.int64, x),
    _emit_store_block,
)(lanes.store_block)
