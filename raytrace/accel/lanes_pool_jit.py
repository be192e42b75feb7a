"""Operations of ``lanes`` that choose among lanes, for Numba."""

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import signature

from raytrace.accel import lanes
from raytrace.accel.lanes_jit import pointer
from raytrace.accel.lanes_types import I32, I64, SUFFIXES, intrinsic, registered


def _emit_store_packed(builder, sig, args):
    """Packed in a register, then stored: a compressing store is microcoded on some processors, and far slower."""
    at, element, size = pointer(builder, sig, args)
    mask, x = args[2:]
    name = f"llvm.experimental.vector.compress.v{x.type.count}{SUFFIXES[str(element)]}"
    values = intrinsic(builder, name, x.type, [x, mask, ir.Constant(x.type, ir.Undefined)])
    builder.store(values, at, align=size)


registered(lambda a, i, mask, x: signature(types.none, a, types.int64, mask, x), _emit_store_packed)(lanes.store_packed)


def _emit_least_lane(builder, sig, args):
    """The numbers of the lanes stand in the last bits; the least of these integers is found by one reduction."""
    mask, x = args
    n, integer = x.type.count, I32 if sig.args[1].elem == types.float32 else I64
    kind = ir.VectorType(integer, n)
    keys = builder.and_(builder.bitcast(x, kind), ir.Constant(kind, [-n] * n))
    keys = builder.or_(keys, ir.Constant(kind, list(range(n))))
    keys = builder.select(mask, keys, ir.Constant(kind, [2 ** (integer.width - 1) - 1] * n))
    least = intrinsic(builder, f"llvm.vector.reduce.smin.v{n}i{integer.width}", integer, [keys])
    least = builder.and_(least, integer(n - 1))
    return least if integer is I64 else builder.zext(least, I64)


registered(lambda mask, x: signature(types.int64, mask, x), _emit_least_lane)(lanes.least_lane)


def _emit_peek_either(builder, sig, args):
    first, a, i, b, j = args
    at, element, size = pointer(builder, signature(types.none, sig.args[1], types.int64), [a, i])
    other, _, _ = pointer(builder, signature(types.none, sig.args[3], types.int64), [b, j])
    if first.type.width != 1:
        first = builder.trunc(first, ir.IntType(1))
    return builder.load(builder.select(first, at, other), align=size, typ=element)


registered(
    lambda first, a, i, b, j: signature(a.dtype, types.boolean, a, types.int64, b, types.int64), _emit_peek_either
)(lanes.peek_either)
