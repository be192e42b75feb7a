"""Functions that machine code calls outside itself: LLVM ends the process if it links a call that it cannot find.

This module reads the symbol tables of object files in the two formats that LLVM writes for this process: ELF, which
Numba requests on Windows too, and Mach-O on macOS   [System V ABI, chapter 4; mach-o/nlist.h].
"""

import contextlib
import ctypes
import struct
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any

import llvmlite.binding as llvm

ELF, MACH_O = b"\x7fELF\x02\x01", b"\xcf\xfa\xed\xfe"  # 64 bits, little endian
SYMBOL_TABLE, MACH_O_TABLE = 2, 2  # type of a section, of a load command
TYPE, DEBUG = 0x0E, 0xE0  # bits of the type of a Mach-O symbol
LIBRARIES = {"win32": ("ntdll", "ucrtbase"), "linux": ("libm.so.6",)}  # where LLVM may not search
_lacking: set[str] = set()  # names for which LLVM got a placeholder


def undefined(data: bytes) -> list[str]:
    """Return the undefined names of an object file, which must be found elsewhere.

    Raises
    ------
    ValueError
        It is not an object file of a known format.
    """
    try:
        if data.startswith(ELF):
            return [name for name in _elf(data) if name]
        if data.startswith(MACH_O):
            return [name.removeprefix("_") for name in _mach_o(data) if name]
    except (struct.error, ValueError):
        raise ValueError("a corrupt object file") from None
    raise ValueError("an object file of an unknown format")


def _name(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode()


def _elf(data: bytes) -> Iterator[str]:
    (headers,), (size, count) = struct.unpack_from("<Q", data, 40), struct.unpack_from("<HH", data, 58)
    sections = [struct.unpack_from("<IIQQQQI", data, headers + size * k) for k in range(count)]
    for _, kind, _, _, start, length, link in sections:
        if kind == SYMBOL_TABLE:
            for place in range(start, start + length, 24):
                name, section = struct.unpack_from("<I2xH", data, place)
                if section == 0:
                    yield _name(data, sections[link][4] + name)


def _mach_o(data: bytes) -> Iterator[str]:
    (commands,), place = struct.unpack_from("<I", data, 16), 32
    for _ in range(commands):
        kind, size = struct.unpack_from("<II", data, place)
        if kind == MACH_O_TABLE:
            symbols, count, names = struct.unpack_from("<III", data, place + 8)
            for k in range(count):
                name, flags, _, _, value = struct.unpack_from("<IBBHQ", data, symbols + 16 * k)
                if not flags & (TYPE | DEBUG) and value == 0:
                    yield _name(data, names + name)
        place += size


def unknown(data: bytes) -> list[str]:
    """Return the undefined names that this process lacks; register those of Python with LLVM."""
    return [name for name in undefined(data) if not _found(name)]


def stand_in(names: Iterable[str]) -> None:
    """Register a placeholder for names with LLVM, so that it does not end the process; callers of them must not run."""
    address = ctypes.cast(ctypes.pythonapi.Py_IsInitialized, ctypes.c_void_p).value
    for name in names:
        llvm.add_symbol(name, address)
        _lacking.add(name)


def _found(name: str) -> bool:
    if name in _lacking:
        return False
    if _added(ctypes.pythonapi, name) or llvm.address_of_symbol(name) is not None:
        return True
    return any(_added(_library(library), name) for library in LIBRARIES.get(sys.platform, ()))


def _added(library: Any, name: str) -> bool:
    """Register a function of a library with LLVM, if the library has it; return whether it has."""
    function = getattr(library, name, None)
    if function is not None:
        llvm.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)
    return function is not None


@cache
def _library(name: str) -> Any:
    with contextlib.suppress(OSError):
        return ctypes.CDLL(name)
    return None
