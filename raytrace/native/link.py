"""Link object code into this process, and make a Python function of it: with LLVM, without Numba."""

import ctypes
import pickle
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, NoReturn

import llvmlite.binding as llvm

from raytrace.native.fallback import Unavailable
from raytrace.native.symbols import unknown

SYMBOL, C_SYMBOL = "raytrace_entry", "raytrace_c_entry"
METH_FASTCALL = 0x80  # Python's calling convention: self, array of arguments, their number


class Code(NamedTuple):
    """Object code of a kernel for arguments of certain kinds."""

    outside: tuple[str, ...]  # names of the functions of Python that it calls
    data: bytes  # an object file of this machine

    @property
    def foreign(self) -> list[str]:
        """Functions that Python does not have: LLVM would end the process if it linked a call of one."""
        return [name for name in self.outside if not hasattr(ctypes.pythonapi, name)]


def _raise(pickled: bytes) -> NoReturn:
    """Raise the exception of a kernel from Numba's description: class, arguments, place."""
    error, arguments, _ = pickle.loads(pickled)
    raise error(*arguments)


class _Method(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = [("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p)]


_prototype = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.POINTER(_Method), ctypes.py_object)
_new_function = _prototype(("PyCFunction_New", ctypes.pythonapi))
_kept: list[Any] = []  # what is bound lives as long as the process
_engines: dict[int, llvm.ExecutionEngine] = {}  # by the address of the entry: machine code stays loaded as well


def _engine() -> llvm.ExecutionEngine:
    """Return an empty linker for the kind of code that Numba makes."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(codemodel="jitdefault", jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


def link(code: Code) -> int:
    """Link object code into this process; return the address of its entry.

    Raises
    ------
    Unavailable
        It calls functions that this process lacks, or it is not an object file.

    Notes
    -----
    Each piece of code has its own linker, which takes a millisecond. A shared linker would take a fifth of that, but
    where two pieces have a function of the same name, it would link calls to the wrong one.
    """
    try:
        lacking = unknown(code.data)
    except ValueError as error:
        raise Unavailable(str(error)) from None
    if lacking:
        raise Unavailable(f"machine code calls {', '.join(lacking)}, which this process lacks")
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(code.data))
    engine.finalize_object()
    address = engine.get_function_address(SYMBOL)
    _engines[address] = engine
    return address


def c_address(address: int) -> int:
    """Return the address of the C entry of machine code that has one, from that of its entry."""
    return _engines[address].get_function_address(C_SYMBOL)


def bind(name: str, address: int, types: Iterable[type]) -> Callable[..., Any]:
    """Return a Python function of machine code; it returns NotImplemented unless its arguments have these types."""
    method = _Method(name.encode(), address, METH_FASTCALL, None)
    _kept.append(method)
    return _new_function(ctypes.byref(method), (NotImplemented, None, _raise, *types))
