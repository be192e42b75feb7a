"""From object code to a function that Python calls, by LLVM's linker alone."""

import ctypes
import pickle
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, NoReturn

import llvmlite.binding as llvm

from raytrace.native.fallback import Unavailable
from raytrace.native.symbols import unknown

SYMBOL = "raytrace_entry"
METH_FASTCALL = 0x80  # Python's calling convention: self, array of arguments, their number


class Code(NamedTuple):
    """Object code of a kernel for arguments of certain kinds."""

    outside: tuple[str, ...]  # functions of Python's that it calls
    data: bytes  # an object file of this machine

    @property
    def foreign(self) -> list[str]:
        """Functions that Python does not have: LLVM would end the process that links a call of one."""
        return [name for name in self.outside if not hasattr(ctypes.pythonapi, name)]


def _raise(pickled: bytes) -> NoReturn:
    """Raise what a kernel raised, as Numba describes it: exception class, arguments, place."""
    error, arguments, _ = pickle.loads(pickled)
    raise error(*arguments)


class _Method(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = [("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p)]


_prototype = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.POINTER(_Method), ctypes.py_object)
_new_function = _prototype(("PyCFunction_New", ctypes.pythonapi))
_kept: list[Any] = []  # machine code stays loaded as long as the process lives


def _engine() -> llvm.ExecutionEngine:
    """An empty linker, for code as Numba asks LLVM to make it."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(codemodel="jitdefault", jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


def link(code: Code) -> int:
    """Address of the entry of object code, linked into this process.

    Raises
    ------
    Unavailable
        It calls what this process lacks, or is no object file.

    Notes
    -----
    Each piece of code has a linker of its own, which takes a millisecond: a shared one would take a fifth of that, but
    bind calls across pieces where two have a function of the same name.
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
    _kept.append(engine)
    return engine.get_function_address(SYMBOL)


def bind(name: str, address: int, types: Iterable[type]) -> Callable[..., Any]:
    """The function that machine code is to Python, for objects of these types; others are told NotImplemented."""
    method = _Method(name.encode(), address, METH_FASTCALL, None)
    _kept.append(method)
    return _new_function(ctypes.byref(method), (NotImplemented, None, _raise, *types))
