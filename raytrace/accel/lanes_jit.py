"""What Numba must know of ``lanes``: two types that are LLVM vectors, and the instruction of every operation."""

import operator

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import models, register_model

from raytrace.accel import lanes
from raytrace.accel.lanes import BITS


class Lanes(types.Type):
    """``n`` values of type ``elem``, computed side by side."""

    def __init__(self, elem, n):
        self.elem, self.n = elem, n
        super().__init__(name=f"{elem}x{n}")


class Mask(types.Type):
    """``n`` truth values."""

    def __init__(self, n):
        self.n = n
        super().__init__(name=f"mask{n}")


I32 = ir.IntType(32)


I64 = ir.IntType(64)


_IR = {types.float32: ir.FloatType(), types.float64: ir.DoubleType(), types.boolean: ir.IntType(8)}


_IR |= {types.int32: I32, types.uint32: I32, types.int64: I64}


_SUFFIX = {"float": "f32", "double": "f64", "i8": "i8", "i32": "i32", "i64": "i64"}


def _vector(kind):
    return ir.VectorType(ir.IntType(1) if isinstance(kind, Mask) else _IR[kind.elem], kind.n)


@register_model(Lanes)
@register_model(Mask)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _vector(kind))


def _taught(result, emit, *shapes):
    """Teach Numba a function: its type is ``result(*types)``, its instructions ``emit(builder, sig, args)``."""

    def teach(function):
        class Template(AbstractTemplate):
            key = function
            prefer_literal = True

            def generic(self, args, kws):
                return None if kws else result(*args)

        infer_global(function)(Template)
        for shape in shapes or ((types.VarArg(types.Any),),):
            lower_builtin(function, *shape)(lambda context, builder, sig, args: emit(builder, sig, args))
        return function

    return teach


def _splat(builder, scalar, n):
    """The LLVM idiom for one value in all lanes."""
    empty = ir.Constant(ir.VectorType(scalar.type, n), ir.Undefined)
    zeros = ir.Constant(ir.VectorType(I32, n), [0] * n)
    return builder.shuffle_vector(builder.insert_element(empty, scalar, I32(0)), empty, zeros)


def _spread(builder, sig, args):
    """Arguments as vectors of one length."""
    n = next(kind.n for kind in sig.args if isinstance(kind, Lanes | Mask))
    pairs = zip(sig.args, args, strict=True)
    return [arg if isinstance(kind, Lanes | Mask) else _splat(builder, arg, n) for kind, arg in pairs]


def _intrinsic(builder, name, result, args):
    shape = ir.FunctionType(result, [arg.type for arg in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, shape, name), args)


def _vector_call(name):
    """An LLVM intrinsic named after its vector type, scalars spread."""

    def emit(builder, sig, args):
        vectors = _spread(builder, sig, args)
        kind = vectors[0].type
        return _intrinsic(builder, f"{name}.v{kind.count}{_SUFFIX[str(kind.element)]}", kind, vectors)

    return emit


def _like_lanes(result=lambda lanes: lanes):
    """Typing of an operation on lanes and scalars: scalars take the element type of the lanes."""

    def typing(*args):
        lanes = [arg for arg in args if isinstance(arg, Lanes)]
        others = [arg for arg in args if not isinstance(arg, Lanes)]
        if not lanes or any(arg != lanes[0] for arg in lanes) or not all(isinstance(o, types.Number) for o in others):
            return None
        return signature(result(lanes[0]), *(arg if isinstance(arg, Lanes) else lanes[0].elem for arg in args))

    return typing


def _masks(*args):
    return signature(args[0], *args) if all(isinstance(arg, Mask) and arg == args[0] for arg in args) else None


def _arithmetic(real, integer):
    def emit(builder, sig, args):
        name = real if isinstance(sig.return_type.elem, types.Float) else integer
        return getattr(builder, name)(*_spread(builder, sig, args))

    return emit


def _comparison(predicate):
    def emit(builder, sig, args):
        vectors = _spread(builder, sig, args)
        kind = next(arg.elem for arg in sig.args if isinstance(arg, Lanes))
        if isinstance(kind, types.Float):  # as in IEEE 754, only != holds for NaN
            return (builder.fcmp_unordered if predicate == "!=" else builder.fcmp_ordered)(predicate, *vectors)
        return (builder.icmp_signed if kind.signed else builder.icmp_unsigned)(predicate, *vectors)

    return emit


_PAIRS = (Lanes, Lanes), (Lanes, types.Number), (types.Number, Lanes)


for _op, _real, _integer in (
    (operator.add, "fadd", "add"),
    (operator.sub, "fsub", "sub"),
    (operator.mul, "fmul", "mul"),
    (operator.truediv, "fdiv", None),
    (operator.xor, None, "xor"),
    (operator.or_, None, "or_"),
    (operator.rshift, None, "lshr"),
    (operator.floordiv, None, "udiv"),
    (operator.mod, None, "urem"),
):
    _taught(_like_lanes(), _arithmetic(_real, _integer), *_PAIRS)(_op)


for _op, _predicate in zip(
    (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne),
    ("<", "<=", ">", ">=", "==", "!="),
    strict=True,
):
    _taught(_like_lanes(lambda lanes: Mask(lanes.n)), _comparison(_predicate), *_PAIRS)(_op)


_taught(_like_lanes(), lambda b, sig, args: b.fneg(*args), (Lanes,))(operator.neg)


_taught(_masks, lambda b, sig, args: b.and_(*args), (Mask, Mask))(operator.and_)


_taught(_masks, lambda b, sig, args: b.or_(*args), (Mask, Mask))(operator.or_)


_taught(_masks, lambda b, sig, args: b.not_(*args), (Mask,))(operator.invert)


_taught(
    lambda x, k: signature(x.elem, x, types.int64) if isinstance(x, Lanes) else None,
    lambda b, sig, args: b.extract_element(*args),
    (Lanes, types.Integer),
)(operator.getitem)


def _count(like):
    return like.literal_value if isinstance(like, types.IntegerLiteral) else like.n


def _pointer(builder, sig, args):
    """Address of element ``args[1]`` of the flat array ``args[0]``, and the element's type; the index may be lanes."""
    element = _IR[sig.args[0].dtype]
    data = builder.extract_value(args[0], 4)  # member `data` of Numba's array record
    at = builder.gep(data, [args[1]], source_etype=element)
    lanes = isinstance(args[1].type, ir.VectorType)
    at.type = ir.VectorType(ir.PointerType(), args[1].type.count) if lanes else ir.PointerType()
    return at, element, element.width // 8 if isinstance(element, ir.IntType) else sig.args[0].dtype.bitwidth // 8


def _load_type(a, i, like):
    n = _count(like)
    return signature(Mask(n) if a.dtype == types.boolean else Lanes(a.dtype, n), a, types.int64, like)


def _emit_load(builder, sig, args):
    at, element, size = _pointer(builder, sig, args)
    values = builder.load(at, align=size, typ=ir.VectorType(element, sig.return_type.n))
    return builder.trunc(values, _vector(sig.return_type)) if isinstance(sig.return_type, Mask) else values


def _emit_store(builder, sig, args):
    at, element, size = _pointer(builder, sig, args)
    values = args[2]
    if isinstance(sig.args[2], Mask):
        values = builder.zext(values, ir.VectorType(element, sig.args[2].n))
    builder.store(values, at, align=size)


def _emit_gather(builder, sig, args):
    at, element, size = _pointer(builder, sig, args)
    n = sig.return_type.n
    everywhere = ir.Constant(ir.VectorType(ir.IntType(1), n), [1] * n)
    kind = ir.VectorType(element, n)
    operands = [at, I32(size), everywhere, ir.Constant(kind, ir.Undefined)]
    return _intrinsic(builder, f"llvm.masked.gather.v{n}{_SUFFIX[str(element)]}.v{n}p0", kind, operands)


def _emit_compress(builder, sig, args):
    at, element, _ = _pointer(builder, sig, args)
    name = f"llvm.masked.compressstore.v{sig.args[3].n}{_SUFFIX[str(element)]}"
    _intrinsic(builder, name, ir.VoidType(), [args[3], at, args[2]])


_taught(
    lambda a: signature(types.int64, a),
    lambda builder, sig, args: I64(BITS // sig.args[0].dtype.bitwidth),
)(lanes.packet_width)


_taught(
    lambda a: signature(a.dtype, a),
    lambda builder, sig, args: ir.Constant(
        _IR[sig.return_type], 2.0 ** (-23 if sig.return_type.bitwidth == 32 else -52)
    ),
)(lanes.machine_epsilon)


def _emit_peek(builder, sig, args):
    at, element, size = _pointer(builder, sig, args)
    return builder.load(at, align=size, typ=element)


def _emit_poke(builder, sig, args):
    at, _, size = _pointer(builder, sig, args)
    builder.store(args[2], at, align=size)


_taught(lambda a, i: signature(a.dtype, a, types.int64), _emit_peek)(lanes.peek)


_taught(lambda a, i, x: signature(types.none, a, types.int64, a.dtype), _emit_poke)(lanes.poke)


def _emit_prefetch(builder, sig, args):
    at, _, _ = _pointer(builder, sig, args)
    read, keep, data = I32(0), I32(3), I32(1)
    _intrinsic(builder, "llvm.prefetch.p0", ir.VoidType(), [at, read, keep, data])


_taught(lambda a, i: signature(types.none, a, types.int64), _emit_prefetch)(lanes.prefetch)


_taught(_load_type, _emit_load)(lanes.load)


_taught(
    lambda a: signature(Lanes(a.dtype, BITS // a.dtype.bitwidth), a),
    lambda b, sig, args: ir.Constant(_vector(sig.return_type), 0.0),
)(lanes.packet)


_taught(lambda a, i, x: signature(types.none, a, types.int64, x), _emit_store)(lanes.store)


_taught(lambda a, index: signature(Lanes(a.dtype, index.n), a, index), _emit_gather)(lanes.gather)


_taught(lambda a, i, mask, x: signature(types.none, a, types.int64, mask, x), _emit_compress)(lanes.compress)


def _emit_splat(builder, sig, args):
    return _splat(builder, args[0], sig.return_type.n)


def _emit_power_of_two(builder, sig, args):
    lanes = sig.return_type
    integer, mask = (I32, 0x7F800000) if lanes.elem == types.float32 else (I64, 0x7FF0000000000000)
    kind = ir.VectorType(integer, lanes.n)
    exponent = builder.and_(builder.bitcast(args[0], kind), ir.Constant(kind, [mask] * lanes.n))
    return builder.bitcast(exponent, _vector(lanes))


def _emit_bits(builder, sig, args):
    return builder.zext(builder.bitcast(args[0], ir.IntType(sig.args[0].n)), I64)


def _emit_reduce(name):
    def emit(builder, sig, args):
        kind = args[0].type
        name_of = f"llvm.vector.reduce.{name}.v{kind.count}{_SUFFIX[str(kind.element)]}"
        shape = ir.FunctionType(kind.element, [kind])
        return builder.call(cgutils.get_or_insert_function(builder.module, shape, name_of), args, fastmath=("nnan",))

    return emit


_taught(lambda x, like: signature(Lanes(like.elem, like.n), like.elem, like), _emit_splat)(lanes.splat)


_taught(lambda x, like: signature(Lanes(types.int32, _count(like)), types.int32, like), _emit_splat)(lanes.splat_int)


_taught(
    lambda like: signature(Lanes(types.int32, like.n), like),
    lambda b, sig, args: ir.Constant(_vector(sig.return_type), list(range(sig.return_type.n))),
)(lanes.lane_numbers)


_taught(
    lambda x, like: signature(Lanes(like.elem, like.n), x, like),
    lambda b, sig, args: b.sitofp(args[0], _vector(sig.return_type)),
)(lanes.to_real)


_taught(_like_lanes(), _vector_call("llvm.fma"))(lanes.fma)


_taught(_like_lanes(), _vector_call("llvm.sqrt"))(lanes.sqrt)


_taught(_like_lanes(), _vector_call("llvm.fabs"))(lanes.absolute)


_taught(_like_lanes(), _vector_call("llvm.bitreverse"))(lanes.reverse_bits)


def _choice(compare):
    def emit(builder, sig, args):
        a, b = _spread(builder, sig, args)
        return builder.select(builder.fcmp_ordered(compare, a, b), a, b)

    return emit


_taught(_like_lanes(), _choice("<"))(lanes.minimum)


_taught(_like_lanes(), _choice(">"))(lanes.maximum)


def _select_type(mask, a, b):
    pair = _like_lanes()(a, b)
    return pair and signature(pair.return_type, mask, *pair.args)


_taught(_select_type, lambda builder, sig, args: builder.select(*_spread(builder, sig, args)))(lanes.select)


_taught(_like_lanes(), _emit_power_of_two)(lanes.power_of_two)


_taught(lambda mask: signature(types.int64, mask), _emit_bits)(lanes.bits)


_taught(lambda x: signature(x.elem, x), _emit_reduce("fmin"))(lanes.lane_min)


_taught(lambda x: signature(x.elem, x), _emit_reduce("fmax"))(lanes.lane_max)


_taught(
    lambda x: signature(types.int64, types.int64),
    lambda b, sig, args: _intrinsic(b, "llvm.cttz.i64", I64, [args[0], ir.IntType(1)(1)]),
)(lanes.first_bit)


_taught(
    lambda mask: signature(types.int64, mask),
    lambda b, sig, args: _intrinsic(b, "llvm.ctpop.i64", I64, [_emit_bits(b, sig, args)]),
)(lanes.count)
