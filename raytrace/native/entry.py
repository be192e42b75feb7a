"""The entry of a kernel's machine code: it converts Python objects to native values and back, like a C extension.

It is a function of Python's C interface, so a call takes a tenth of a microsecond plus a little for each array. Its
``self`` is a tuple: two objects to return and a function to call, then the expected type of each object, in the order
in which they are read. For objects of any other kind the entry returns NotImplemented before it does anything, and the
caller tries other machine code.
"""

import ctypes
from functools import reduce
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.np.arrayobj import populate_array

from raytrace.native.signatures import Array, Kind, Record

NOT_IMPLEMENTED, NONE, RAISE, FIRST = range(4)  # indices in ``self``: two objects, a function, the first type
POINTER, BYTE, I32, I64 = ir.PointerType(), ir.IntType(8), ir.IntType(32), ir.IntType(64)

# Offsets in memory. Objects begin with a header, which ends with their type. In an array the next fields are: data,
# number of axes, dimensions, strides, base, dtype, flags. In a dtype they are: type of the scalars, four letters, type
# number   [numpy/ndarraytypes.h: PyArrayObject_fields, PyArray_Descr: every compiled extension relies on them].
HEAD = object.__basicsize__
TYPE, DATA, NDIM, SHAPE, STRIDES, DTYPE, FLAGS = (HEAD + place for place in (-8, 0, 8, 16, 24, 40, 48))
BYTE_ORDER, NUMBER = HEAD + 10, HEAD + 12
C_CONTIGUOUS, F_CONTIGUOUS, ALIGNED, WRITEABLE = 0x1, 0x2, 0x100, 0x400
LAYOUTS = {"C": C_CONTIGUOUS, "F": F_CONTIGUOUS, "A": 0}


def check_layout() -> None:
    """Check on an array that NumPy uses the memory layout that the machine code reads.

    Raises
    ------
    RuntimeError
        It does not, so no kernel may be called.
    """
    array = np.zeros((2, 3), np.float32)

    def read(obj: object, offset: int, kind: Any) -> Any:
        return kind.from_address(id(obj) + offset).value

    word, integer = ctypes.c_ssize_t, ctypes.c_int
    found = [read(array, TYPE, word), read(array, DATA, word), read(array, NDIM, integer), read(array, DTYPE, word)]
    found += [word.from_address(read(array, place, word) + 8).value for place in (SHAPE, STRIDES)]
    found += [read(array.dtype, BYTE_ORDER, ctypes.c_char), read(array.dtype, NUMBER, integer)]
    found += [read(array, FLAGS, integer) & (C_CONTIGUOUS | F_CONTIGUOUS | ALIGNED | WRITEABLE)]
    expected = [id(np.ndarray), array.ctypes.data, 2, id(array.dtype), 3, 4, b"=", array.dtype.num]
    if found != [*expected, C_CONTIGUOUS | ALIGNED | WRITEABLE]:
        raise RuntimeError(f"this version of NumPy uses another memory layout of arrays: {found}")


class Entry:
    """Writer of the entry of one kernel.

    Parameters
    ----------
    context : numba.core.cpu.CPUContext
    module : llvmlite.ir.Module
    name : str
        Symbol of the entry.
    """

    def __init__(self, context: Any, module: ir.Module, name: str) -> None:
        shape = ir.FunctionType(POINTER, [POINTER, POINTER, I64])
        self._function = ir.Function(module, shape, name)
        self._builder = ir.IRBuilder(self._function.append_basic_block("entry"))
        self._declined = self._function.append_basic_block("declined")
        self._context, self._api = context, context.get_python_api(self._builder)
        self._met = FIRST

    def write(self, fndesc: Any, kinds: tuple[Kind, ...]) -> None:
        """Write code that converts arguments of these kinds, releases the GIL, calls the kernel, returns its result."""
        builder, call = self._builder, self._context.call_conv
        _, objects, count = self._function.args
        self._require(builder.icmp_signed("==", count, I64(len(kinds))))
        values = [self._unbox(self._read(objects, 8 * k, POINTER), kind) for k, kind in enumerate(kinds)]
        kernel = self._context.declare_function(builder.module, fndesc)
        thread = self._api.save_thread()
        status, result = call.call_function(
            builder, kernel, fndesc.restype, fndesc.argtypes, values, attrs=("noinline",)
        )
        self._api.restore_thread(thread)
        with builder.if_then(status.is_error, likely=False):
            self._raise(status)
        builder.ret(self._box(result, fndesc.restype))
        builder.position_at_end(self._declined)
        builder.ret(self._known(NOT_IMPLEMENTED))

    def _read(self, base: ir.Value, offset: int, kind: ir.Type) -> ir.Value:
        address = self._builder.gep(base, [I64(offset)], source_etype=BYTE)
        address.type = POINTER
        return self._builder.load(address, typ=kind)

    def _require(self, true: ir.Value) -> None:
        """Write code that declines the call unless a condition holds."""
        met = self._function.append_basic_block("met")
        self._builder.cbranch(true, met, self._declined)
        self._builder.position_at_end(met)

    def _expect_type(self, obj: ir.Value) -> None:
        """Write code that declines an object whose type is not the next one in ``self``."""
        expected = self._api.tuple_getitem(self._function.args[0], self._met)
        self._met += 1
        self._require(self._builder.icmp_unsigned("==", self._read(obj, TYPE, POINTER), expected))

    def _known(self, place: int) -> ir.Value:
        """Return a new reference to an object in ``self``."""
        known = self._api.tuple_getitem(self._function.args[0], place)
        self._api.incref(known)
        return known

    def _unbox(self, obj: ir.Value, kind: Kind) -> ir.Value:
        """Return the native value of an object of that kind."""
        self._expect_type(obj)
        if kind is None:
            return self._context.get_dummy_value()
        if isinstance(kind, Array):
            return self._unbox_array(obj, kind)
        if isinstance(kind, Record):
            size = I64(len(kind.fields))
            self._require(self._builder.icmp_signed("==", self._api.tuple_size(obj), size))
            fields = [self._unbox(self._api.tuple_getitem(obj, k), field) for k, field in enumerate(kind.fields)]
            return self._context.make_tuple(self._builder, numba_type(kind), fields)
        number = self._api.long_as_longlong(obj)
        with self._builder.if_then(self._builder.icmp_signed("==", number, I64(-1)), likely=False):
            failed = self._builder.icmp_unsigned("!=", self._api.err_occurred(), ir.Constant(POINTER, None))
            with self._builder.if_then(failed):
                self._builder.ret(ir.Constant(POINTER, None))
        return self._builder.trunc(number, self._context.get_value_type(numba_type(kind)))

    def _unbox_array(self, obj: ir.Value, kind: Array) -> ir.Value:
        builder = self._builder
        dtype, wanted = self._read(obj, DTYPE, POINTER), np.dtype(kind.dtype)
        number = self._read(dtype, NUMBER, I32)
        alike = [builder.icmp_signed("==", number, I32(each)) for each in numbers_of(kind.dtype)]
        self._require(reduce(builder.or_, alike))
        self._require(builder.icmp_signed("==", self._read(dtype, BYTE_ORDER, BYTE), BYTE(ord(wanted.byteorder))))
        self._require(builder.icmp_signed("==", self._read(obj, NDIM, I32), I32(kind.ndim)))
        mask = C_CONTIGUOUS | ALIGNED | WRITEABLE | (0 if kind.layout == "C" else F_CONTIGUOUS)  # few axes may be both
        flags = LAYOUTS[kind.layout] | ALIGNED | (WRITEABLE if kind.writeable else 0)
        self._require(builder.icmp_signed("==", builder.and_(self._read(obj, FLAGS, I32), I32(mask)), I32(flags)))
        shape, strides = (
            [self._read(self._read(obj, place, POINTER), 8 * k, I64) for k in range(kind.ndim)]
            for place in (SHAPE, STRIDES)
        )
        array = self._context.make_array(numba_type(kind))(self._context, builder)
        data = builder.bitcast(self._read(obj, DATA, POINTER), array.data.type)
        populate_array(array, data, shape, strides, wanted.itemsize, None)
        return array._getvalue()

    def _raise(self, status: Any) -> None:
        """Call the function in ``self`` that raises Numba's pickled exception."""
        what = self._builder.load(status.excinfoptr)
        data, size = (self._builder.extract_value(what, k) for k in range(2))
        pickled = self._api.bytes_from_string_and_size(data, self._builder.zext(size, I64))
        function = self._api.tuple_getitem(self._function.args[0], RAISE)
        result = self._api.call_function_objargs(function, (pickled,))
        self._api.decref(pickled)
        self._builder.ret(result)

    def _box(self, value: ir.Value, kind: types.Type) -> ir.Value:
        """Return a new Python object for the result of a kernel."""
        if isinstance(kind, types.NoneType):
            return self._known(NONE)
        if isinstance(kind, types.BaseTuple):
            made = self._api.tuple_new(len(kind))
            for k, item in enumerate(cgutils.unpack_tuple(self._builder, value)):
                self._api.tuple_setitem(made, k, self._box(item, kind[k]))
            return made
        if not isinstance(kind, types.Integer):
            raise NotImplementedError(f"a kernel may return integers, tuples of integers, or None, not {kind}")
        if kind.signed:
            return self._api.long_from_longlong(self._builder.sext(value, I64))
        return self._api.long_from_ulonglong(self._builder.zext(value, I64))


def numbers_of(dtype: str) -> list[int]:
    """NumPy's type numbers of a dtype: two C types can be the same (intc, long on Windows; long, longlong on Linux)."""
    return sorted({np.dtype(letter).num for letter in "?bhilqBHILQefdg" if np.dtype(letter).name == dtype})


def numba_type(kind: Kind) -> types.Type:
    """Numba's type of a kind of argument."""
    if isinstance(kind, Record):
        return types.BaseTuple.from_types(tuple(map(numba_type, kind.fields)), kind.type)
    if isinstance(kind, Array):
        return types.Array(getattr(types, kind.dtype), kind.ndim, kind.layout, readonly=not kind.writeable)
    return types.none if kind is None else getattr(types, kind.dtype)
