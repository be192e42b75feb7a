"""The calling side of ``c_entry``: compiled code of a user writes the arguments of a query to its stack, and calls it.

``words`` is an array of int64: the address of the machine code, the layout of what follows, the type of the leaves, the
bytes of scratch memory, then a block of all arguments with the values that are the same in every call. The code copies
the block, writes the other values, and calls the address. So it holds no machine code of a query and no address: it may
be cached, and used with any tree and any release that has the same layout.
"""

import zlib
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic as numba_intrinsic

from raytrace.records import Columns, Hits, Nodes, Rays, Tree, WatertightLeaves
from raytrace.work_records import Work

ADDRESS, LAYOUT, LEAF_TYPE, SCRATCH, BLOCK = range(5)  # places in ``words``
_FIELDS = [record._fields for record in (Tree, Nodes, WatertightLeaves, Rays, Columns, Hits, Work)]
LAYOUT_NUMBER = zlib.crc32(repr((1, _FIELDS)).encode())  # 1: raise it where a field gets another meaning
TREE = 2 * 5  # words: address and length of five arrays
COLUMN = 5  # words: address, length, start, row, axis
OUT = TREE + COLUMN * len(Rays._fields)  # place of the results in the block; then follow n and Work
ROW = 3  # place of ``row`` in a column
WORK = 2 * len(Work._fields)  # words; instead of addresses the block has offsets in scratch memory
LINE = 64  # bytes: the alignment of scratch memory
intrinsic: Any = numba_intrinsic  # calls of an intrinsic omit its first parameter, which its type does not say
I8, I32, I64 = ir.IntType(8), ir.IntType(32), ir.IntType(64)


class _Call:
    """Writer of code for one call; the first two arguments of its intrinsic are ``words`` and scratch memory."""

    def __init__(self, context: Any, builder: Any, signature: Any, args: Any) -> None:
        self.context, self.builder, self.kinds, self.args = context, builder, signature.args, args
        self._values = dict[int, ir.Value]()

    def set(self, place: int, value: ir.Value) -> None:
        """Set a word of the block: an integer or an address."""
        self._values[place] = self.builder.ptrtoint(value, I64) if value.type.is_pointer else value

    def data(self, kind: Any, array: ir.Value) -> ir.Value:
        """Return the address of the elements of an array."""
        return self.context.make_array(kind)(self.context, self.builder, array).data

    def several(self, k: int) -> list[tuple[Any, ir.Value]]:
        """Return types and values of the items of argument k, a tuple."""
        return list(zip(self.kinds[k], cgutils.unpack_tuple(self.builder, self.args[k]), strict=True))

    def run(self, out: int) -> ir.Value:
        """Write the call of a query with that many arrays of results; return its status."""
        builder, size = self.builder, OUT + 2 * out + 1 + WORK
        words, scratch = (self.data(self.kinds[k], self.args[k]) for k in range(2))
        block = builder.bitcast(cgutils.alloca_once(builder, ir.ArrayType(I64, size)), I64.as_pointer())
        cgutils.raw_memcpy(builder, block, builder.gep(words, [I64(BLOCK)]), I64(size), 8)
        base = builder.and_(builder.add(builder.ptrtoint(scratch, I64), I64(LINE - 1)), I64(-LINE))
        for place in range(size - WORK, size, 2):
            self.set(place, builder.add(base, builder.load(builder.gep(block, [I64(place)]))))
        for place, value in self._values.items():
            builder.store(value, builder.gep(block, [I64(place)]))
        address = builder.load(builder.gep(words, [I64(ADDRESS)]))
        function = builder.inttoptr(address, ir.FunctionType(I32, [I64.as_pointer()]).as_pointer())
        return builder.call(function, [block])


def _run_one(call: _Call, real: types.Float, outputs: list[ir.Value]) -> ir.Value:
    """Write the call for one ray, given as argument 2, with its results at these addresses; return its status."""
    builder, context = call.builder, call.context
    memory = cgutils.alloca_once(builder, ir.ArrayType(context.get_value_type(real), 8))
    for k, (kind, number) in enumerate(call.several(2)):
        builder.store(context.cast(builder, number, kind, real), builder.gep(memory, [I32(0), I32(k)]))
    for field, k in enumerate((0, 3, 6, 7)):
        call.set(TREE + COLUMN * field, builder.gep(memory, [I32(0), I32(k)]))
    for k, pointer in enumerate(outputs):
        call.set(OUT + 2 * k, pointer)
    return call.run(len(outputs))


@intrinsic
def closest_of_one(typing_context: Any, words: Any, scratch: Any, ray: Any, like: Any) -> Any:
    """Find the nearest hit of one ray: status, t, prim_id, u, v.

    ``ray`` has 8 numbers: origin, direction, tmin, tmax. ``like`` is an array of the tree's type.
    """
    kinds = [like.dtype, types.int32, like.dtype, like.dtype]
    result = types.Tuple((types.int32, *kinds))

    def code(context: Any, builder: Any, signature: Any, args: Any) -> ir.Value:
        outputs = [cgutils.alloca_once(builder, context.get_value_type(kind)) for kind in kinds]
        status = _run_one(_Call(context, builder, signature, args), like.dtype, outputs)
        return context.make_tuple(builder, result, [status, *map(builder.load, outputs)])

    return result(words, scratch, ray, like), code


@intrinsic
def any_of_one(typing_context: Any, words: Any, scratch: Any, ray: Any, like: Any) -> Any:
    """Find whether one ray hits anything: status, and 1 or 0."""
    result = types.UniTuple(types.int32, 2)

    def code(context: Any, builder: Any, signature: Any, args: Any) -> ir.Value:
        occluded = cgutils.alloca_once(builder, I8)
        status = _run_one(_Call(context, builder, signature, args), like.dtype, [occluded])
        return context.make_tuple(builder, result, [status, builder.zext(builder.load(occluded), I32)])

    return result(words, scratch, ray, like), code


@intrinsic
def of_many(typing_context: Any, words: Any, scratch: Any, fields: Any, numbers: Any, out: Any) -> Any:
    """Answer a query of n rays, and return its status.

    ``fields`` are flat arrays of the tree's type: origins, directions, tmin, tmax. ``numbers`` are the elements from
    one ray to the next in each, and n. ``out`` are the arrays of results.
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> ir.Value:
        call = _Call(context, builder, signature, args)
        *rows, n = cgutils.unpack_tuple(builder, args[3])
        for k, ((kind, array), row) in enumerate(zip(call.several(2), rows, strict=True)):
            call.set(TREE + COLUMN * k, call.data(kind, array))
            call.set(TREE + COLUMN * k + ROW, row)
        outputs = call.several(4)
        for k, (kind, array) in enumerate(outputs):
            call.set(OUT + 2 * k, call.data(kind, array))
        call.set(OUT + 2 * len(outputs), n)
        return call.run(len(outputs))

    return types.int32(words, scratch, fields, types.UniTuple(types.int64, len(fields) + 1), out), code
