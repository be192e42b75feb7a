"""A second entry of a kernel: a C function, which other machine code calls through its address.

``int entry(const int64_t *words)`` reads the arguments of the kernel from a block of words, in order: address and
length of each array, one word for each integer; records are their fields, one after the other. It needs no Python
object and not the global interpreter lock.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.np.arrayobj import populate_array

from raytrace.native.entry import I32, I64, POINTER, numba_type
from raytrace.native.signatures import Array, Kind, Record


def flat(kinds: Iterable[Kind]) -> bool:
    """Return whether a C entry can pass arguments of these kinds: all arrays are flat and contiguous."""
    return all(
        flat(kind.fields) if isinstance(kind, Record) else not isinstance(kind, Array) or kind[1:3] == (1, "C")
        for kind in kinds
    )


class CEntry:
    """Writer of the entry of one kernel; its parameters are those of ``Entry``."""

    def __init__(self, context: Any, module: ir.Module, name: str) -> None:
        self._function = ir.Function(module, ir.FunctionType(I32, [POINTER]), name)
        self._builder = ir.IRBuilder(self._function.append_basic_block("entry"))
        self._context = context
        self._read = 0  # words read so far

    def write(self, fndesc: Any, kinds: tuple[Kind, ...]) -> None:
        """Write code that reads arguments of these kinds, calls the kernel, and returns 0, or 1 if it failed."""
        values = [self._argument(kind) for kind in kinds]
        builder = self._builder
        kernel = self._context.declare_function(builder.module, fndesc)
        call = self._context.call_conv.call_function
        status, _ = call(builder, kernel, fndesc.restype, fndesc.argtypes, values, attrs=("noinline",))
        builder.ret(builder.zext(status.is_error, I32))

    def _word(self) -> ir.Value:
        address = self._builder.gep(self._function.args[0], [I64(self._read)], source_etype=I64)
        address.type = POINTER
        self._read += 1
        return self._builder.load(address, typ=I64)

    def _argument(self, kind: Kind) -> ir.Value:
        """Return the native value of an argument of that kind."""
        if isinstance(kind, Record):
            fields = [self._argument(field) for field in kind.fields]
            return self._context.make_tuple(self._builder, numba_type(kind), fields)
        if isinstance(kind, Array):
            return self._array(kind)
        if kind is None:
            return self._context.get_dummy_value()
        return self._builder.trunc(self._word(), self._context.get_value_type(numba_type(kind)))

    def _array(self, kind: Array) -> ir.Value:
        array = self._context.make_array(numba_type(kind))(self._context, self._builder)
        data, length = self._builder.inttoptr(self._word(), array.data.type), self._word()
        size = np.dtype(kind.dtype).itemsize
        populate_array(array, data, [length], [I64(size)], size, None)
        return array._getvalue()
