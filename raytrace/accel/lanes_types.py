"""SIMD lanes as Numba types, their operators, and the registration of functions with Numba."""

import operator

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import models, register_model


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


ELEMENTS = {types.float32: ir.FloatType(), types.float64: ir.DoubleType(), types.boolean: ir.IntType(8)}


ELEMENTS |= {types.int32: I32, types.uint32: I32, types.int64: I64}


SUFFIXES = {"float": "f32", "double": "f64", "i8": "i8", "i32": "i32", "i64": "i64"}


def vector_of(kind):
    return ir.VectorType(ir.IntType(1) if isinstance(kind, Mask) else ELEMENTS[kind.elem], kind.n)


@register_model(Lanes)
@register_model(Mask)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, vector_of(kind))


def registered(result, emit, *shapes):
    """Return a decorator that registers a function with Numba.

    Its type is ``result(*types)``; ``emit(builder, sig, args)`` writes its instructions.
    """

    def register(function):
        class Template(AbstractTemplate):
            key = function
            prefer_literal = True

            def generic(self, args, kws):
                return None if kws else result(*args)

        infer_global(function)(Template)
        for shape in shapes or ((types.VarArg(types.Any),),):
            lower_builtin(function, *shape)(lambda context, builder, sig, args: emit(builder, sig, args))
        return function

    return register


def splatted(builder, scalar, n):
    """The LLVM idiom for one value in all lanes."""
    empty = ir.Constant(ir.VectorType(scalar.type, n), ir.Undefined)
    zeros = ir.Constant(ir.VectorType(I32, n), [0] * n)
    return builder.shuffle_vector(builder.insert_element(empty, scalar, I32(0)), empty, zeros)


def spread(builder, sig, args):
    """Arguments as vectors of one length; scalars are broadcast."""
    n = next(kind.n for kind in sig.args if isinstance(kind, Lanes | Mask))
    pairs = zip(sig.args, args, strict=True)
    return [arg if isinstance(kind, Lanes | Mask) else splatted(builder, arg, n) for kind, arg in pairs]


def intrinsic(builder, name, result, args):
    shape = ir.FunctionType(result, [arg.type for arg in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, shape, name), args)


def vector_call(name):
    """Emitter of an LLVM intrinsic named after its vector type; scalars are broadcast."""

    def emit(builder, sig, args):
        vectors = spread(builder, sig, args)
        kind = vectors[0].type
        return intrinsic(builder, f"{name}.v{kind.count}{SUFFIXES[str(kind.element)]}", kind, vectors)

    return emit


def like_lanes(result=lambda lanes: lanes):
    """Typing of an operation on lanes and scalars: scalars are converted to the element type of the lanes."""

    def typing(*args):
        lanes = [arg for arg in args if isinstance(arg, Lanes)]
        others = [arg for arg in args if not isinstance(arg, Lanes)]
        if not lanes or any(arg != lanes[0] for arg in lanes) or not all(isinstance(o, types.Number) for o in others):
            return None
        return signature(result(lanes[0]), *(arg if isinstance(arg, Lanes) else lanes[0].elem for arg in args))

    return typing


def all_masks(*args):
    return signature(args[0], *args) if all(isinstance(arg, Mask) and arg == args[0] for arg in args) else None


def _arithmetic(real, integer):
    def emit(builder, sig, args):
        name = real if isinstance(sig.return_type.elem, types.Float) else integer
        return getattr(builder, name)(*spread(builder, sig, args))

    return emit


def _comparison(predicate):
    def emit(builder, sig, args):
        vectors = spread(builder, sig, args)
        kind = next(arg.elem for arg in sig.args if isinstance(arg, Lanes))
        if isinstance(kind, types.Float):  # as in IEEE 754, only != is true for NaN
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
    (operator.and_, None, "and_"),
    (operator.lshift, None, "shl"),
    (operator.rshift, None, "lshr"),
    (operator.floordiv, None, "udiv"),
    (operator.mod, None, "urem"),
):
    registered(like_lanes(), _arithmetic(_real, _integer), *_PAIRS)(_op)


for _op, _predicate in zip(
    (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne),
    ("<", "<=", ">", ">=", "==", "!="),
    strict=True,
):
    registered(like_lanes(lambda lanes: Mask(lanes.n)), _comparison(_predicate), *_PAIRS)(_op)


registered(like_lanes(), lambda b, sig, args: b.fneg(*args), (Lanes,))(operator.neg)


registered(all_masks, lambda b, sig, args: b.and_(*args), (Mask, Mask))(operator.and_)


registered(all_masks, lambda b, sig, args: b.or_(*args), (Mask, Mask))(operator.or_)


registered(all_masks, lambda b, sig, args: b.not_(*args), (Mask,))(operator.invert)


registered(
    lambda x, k: signature(x.elem, x, types.int64) if isinstance(x, Lanes) else None,
    lambda b, sig, args: b.extract_element(*args),
    (Lanes, types.Integer),
)(operator.getitem)
