"""Operations of ``lanes`` for Numba: the types and the LLVM instructions of each."""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import signature

from raytrace.accel import lanes
from raytrace.accel.lanes_types import (
    ELEMENTS,
    I32,
    I64,
    SUFFIXES,
    Lanes,
    Mask,
    intrinsic,
    like_lanes,
    registered,
    splatted,
    spread,
    vector_call,
    vector_of,
)


def lane_count(like):
    return like.literal_value if isinstance(like, types.IntegerLiteral) else like.n


def pointer(builder, sig, args):
    """Address of element ``args[1]`` of the flat array ``args[0]``, element type and size; the index may be lanes."""
    element = ELEMENTS[sig.args[0].dtype]
    data = builder.extract_value(args[0], 4)  # member `data` of Numba's array record
    at = builder.gep(data, [args[1]], source_etype=element)
    lanes = isinstance(args[1].type, ir.VectorType)
    at.type = ir.VectorType(ir.PointerType(), args[1].type.count) if lanes else ir.PointerType()
    return at, element, element.width // 8 if isinstance(element, ir.IntType) else sig.args[0].dtype.bitwidth // 8


def _load_type(a, i, like):
    n = lane_count(like)
    return signature(Mask(n) if a.dtype == types.boolean else Lanes(a.dtype, n), a, types.int64, like)


def _emit_load(builder, sig, args):
    at, element, size = pointer(builder, sig, args)
    values = builder.load(at, align=size, typ=ir.VectorType(element, sig.return_type.n))
    return builder.trunc(values, vector_of(sig.return_type)) if isinstance(sig.return_type, Mask) else values


def _emit_store(builder, sig, args):
    at, element, size = pointer(builder, sig, args)
    values = args[2]
    if isinstance(sig.args[2], Mask):
        values = builder.zext(values, ir.VectorType(element, sig.args[2].n))
    builder.store(values, at, align=size)


def _emit_gather(builder, sig, args):
    at, element, size = pointer(builder, sig, args)
    n = sig.return_type.n
    everywhere = ir.Constant(ir.VectorType(ir.IntType(1), n), [1] * n)
    kind = ir.VectorType(element, n)
    operands = [at, I32(size), everywhere, ir.Constant(kind, ir.Undefined)]
    return intrinsic(builder, f"llvm.masked.gather.v{n}{SUFFIXES[str(element)]}.v{n}p0", kind, operands)


def _emit_compress(builder, sig, args):
    at, element, _ = pointer(builder, sig, args)
    name = f"llvm.masked.compressstore.v{sig.args[3].n}{SUFFIXES[str(element)]}"
    intrinsic(builder, name, ir.VoidType(), [args[3], at, args[2]])


registered(
    lambda a: signature(types.int64, a),
    lambda builder, sig, args: I64(lanes.BITS // sig.args[0].dtype.bitwidth),
)(lanes.packet_width)


registered(
    lambda a: signature(types.int64, a),
    lambda builder, sig, args: I64(min(4, lanes.BITS // sig.args[0].dtype.bitwidth)),
)(lanes.group_size)


registered(
    lambda a: signature(a.dtype, a),
    lambda builder, sig, args: ir.Constant(
        ELEMENTS[sig.return_type], 2.0 ** (-23 if sig.return_type.bitwidth == 32 else -52)
    ),
)(lanes.machine_epsilon)


registered(
    lambda a: signature(a.dtype, a),
    lambda builder, sig, args: ir.Constant(
        ELEMENTS[sig.return_type], float(np.finfo(f"f{sig.return_type.bitwidth // 8}").max)
    ),
)(lanes.machine_largest)


def _emit_peek(builder, sig, args):
    at, element, size = pointer(builder, sig, args)
    return builder.load(at, align=size, typ=element)


def _emit_poke(builder, sig, args):
    at, _, size = pointer(builder, sig, args)
    builder.store(args[2], at, align=size)


registered(lambda a, i: signature(a.dtype, a, types.int64), _emit_peek)(lanes.peek)


registered(lambda a, i, x: signature(types.none, a, types.int64, a.dtype), _emit_poke)(lanes.poke)


def _emit_prefetch(builder, sig, args):
    at, _, _ = pointer(builder, sig, args)
    read, keep, data = I32(0), I32(3), I32(1)
    intrinsic(builder, "llvm.prefetch.p0", ir.VoidType(), [at, read, keep, data])


registered(lambda a, i: signature(types.none, a, types.int64), _emit_prefetch)(lanes.prefetch)


registered(_load_type, _emit_load)(lanes.load)


registered(
    lambda a: signature(Lanes(a.dtype, lanes.BITS // a.dtype.bitwidth), a),
    lambda b, sig, args: ir.Constant(vector_of(sig.return_type), 0.0),
)(lanes.packet)


registered(lambda a, i, x: signature(types.none, a, types.int64, x), _emit_store)(lanes.store)


registered(lambda a, index: signature(Lanes(a.dtype, index.n), a, index), _emit_gather)(lanes.gather)


registered(lambda a, i, mask, x: signature(types.none, a, types.int64, mask, x), _emit_compress)(lanes.compress)


def _emit_splat(builder, sig, args):
    return splatted(builder, args[0], sig.return_type.n)


def _emit_power_of_two(builder, sig, args):
    lanes = sig.return_type
    integer, mask = (I32, 0x7F800000) if lanes.elem == types.float32 else (I64, 0x7FF0000000000000)
    kind = ir.VectorType(integer, lanes.n)
    exponent = builder.and_(builder.bitcast(args[0], kind), ir.Constant(kind, [mask] * lanes.n))
    return builder.bitcast(exponent, vector_of(lanes))


def _emit_bits(builder, sig, args):
    return builder.zext(builder.bitcast(args[0], ir.IntType(sig.args[0].n)), I64)


def _emit_mask_of(builder, sig, args):
    return builder.bitcast(builder.trunc(args[0], ir.IntType(sig.args[1].n)), vector_of(sig.return_type))


def _emit_reduce(name):
    def emit(builder, sig, args):
        kind = args[0].type
        name_of = f"llvm.vector.reduce.{name}.v{kind.count}{SUFFIXES[str(kind.element)]}"
        shape = ir.FunctionType(kind.element, [kind])
        return builder.call(cgutils.get_or_insert_function(builder.module, shape, name_of), args, fastmath=("nnan",))

    return emit


registered(lambda x, like: signature(Lanes(like.elem, like.n), like.elem, like), _emit_splat)(lanes.splat)


registered(lambda x, like: signature(Lanes(types.int32, lane_count(like)), types.int32, like), _emit_splat)(
    lanes.splat_int
)


registered(
    lambda like: signature(Lanes(types.int32, like.n), like),
    lambda b, sig, args: ir.Constant(vector_of(sig.return_type), list(range(sig.return_type.n))),
)(lanes.lane_numbers)


registered(
    lambda x, like: signature(Lanes(like.elem, like.n), x, like),
    lambda b, sig, args: b.sitofp(args[0], vector_of(sig.return_type)),
)(lanes.to_real)


def _emit_convert(builder, sig, args):
    change = builder.fpext if sig.args[0].elem.bitwidth < sig.return_type.elem.bitwidth else builder.fptrunc
    return args[0] if sig.args[0] == sig.return_type else change(args[0], vector_of(sig.return_type))


registered(lambda x, like: signature(Lanes(like.elem, x.n), x, like), _emit_convert)(lanes.convert)


registered(
    lambda x: signature(Lanes(types.int32, x.n), x),
    lambda b, sig, args: b.fptosi(args[0], vector_of(sig.return_type)),
)(lanes.to_int)


registered(like_lanes(), vector_call("llvm.fma"))(lanes.fma)


registered(like_lanes(), vector_call("llvm.sqrt"))(lanes.sqrt)


registered(like_lanes(), vector_call("llvm.fabs"))(lanes.absolute)


registered(like_lanes(), vector_call("llvm.bitreverse"))(lanes.reverse_bits)


def _choice(compare):
    def emit(builder, sig, args):
        a, b = spread(builder, sig, args)
        return builder.select(builder.fcmp_ordered(compare, a, b), a, b)

    return emit


registered(like_lanes(), _choice("<"))(lanes.minimum)


registered(like_lanes(), _choice(">"))(lanes.maximum)


def _select_type(mask, a, b):
    pair = like_lanes()(a, b)
    return pair and signature(pair.return_type, mask, *pair.args)


registered(_select_type, lambda builder, sig, args: builder.select(*spread(builder, sig, args)))(lanes.select)


registered(like_lanes(), _emit_power_of_two)(lanes.power_of_two)


registered(lambda mask: signature(types.int64, mask), _emit_bits)(lanes.bits)


registered(lambda x, like: signature(Mask(like.n), types.int64, like), _emit_mask_of)(lanes.mask_of)


registered(lambda x: signature(x.elem, x), _emit_reduce("fmin"))(lanes.lane_min)


registered(lambda x: signature(x.elem, x), _emit_reduce("fmax"))(lanes.lane_max)


def _group(compare):
    """Emitter: exchange lanes with those 1 and 2 away, and keep the smaller or the larger."""

    def emit(builder, sig, args):
        values, n = args[0], sig.args[0].n
        for distance in (1, 2)[: 2 if n >= 4 else 1]:
            others = ir.Constant(ir.VectorType(I32, n), [k ^ distance for k in range(n)])
            moved = builder.shuffle_vector(values, values, others)
            values = builder.select(builder.fcmp_ordered(compare, moved, values), moved, values)
        return values

    return emit


registered(lambda x: signature(x, x), _group("<"))(lanes.group_min)


registered(lambda x: signature(x, x), _group(">"))(lanes.group_max)


registered(
    lambda x: signature(types.int64, types.int64),
    lambda b, sig, args: intrinsic(b, "llvm.cttz.i64", I64, [args[0], ir.IntType(1)(1)]),
)(lanes.first_bit)


registered(
    lambda mask: signature(types.int64, mask),
    lambda b, sig, args: intrinsic(b, "llvm.ctpop.i64", I64, [_emit_bits(b, sig, args)]),
)(lanes.count)
