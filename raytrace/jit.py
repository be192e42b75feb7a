"""The kernel decorator, and the decorators of the functions that kernels call.

A kernel is an ordinary Python function until it is called. The kinds of its arguments choose its machine code, which
is found in memory, else loaded from disk, else compiled by Numba and stored. So a process whose kernels were compiled
before never imports Numba, which takes a third of a second. Machine code releases the GIL, so tiles run in parallel in
plain threads: there is no threading layer to abort, and Ctrl-C works.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import update_wrapper
from typing import Any, Self

import numpy as np

PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")  # kernels stay plain Python functions

callees: list[tuple[Callable[..., Any], dict[str, bool]]] = []  # functions to register with Numba, and options
forms: list[tuple[Callable[..., Any], Callable[..., Any]]] = []  # functions to register, and their overloads

_lock = threading.RLock()  # held while machine code is searched for, compiled or loaded
if hasattr(os, "register_at_fork"):  # a child process must not start while it is held
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


class Kernel:
    """A function that Python calls and that runs as machine code, compiled once for each kind of arguments.

    Attributes
    ----------
    function : callable
        The Python function.
    code : dict
        Address of the machine code for each kind of arguments so far.
    c_entry : bool
        Whether machine code can also be called by other machine code; see ``native/c_entry.py``.
    """

    def __init__(self, function: Callable[..., Any], c_entry: bool = False) -> None:
        update_wrapper(self, function)
        self.function, self.code, self.c_entry = function, dict[Any, int](), c_entry
        self._unkept = dict[Any, Any]()  # object code that could not be stored
        self._bound = dict[Any, Callable[..., Any]]()
        self._entries: tuple[Callable[..., Any], ...] = ()  # replaced, never changed, so calls need no lock

    def __call__(self, *args: Any) -> Any:
        """Call the machine code for such arguments."""
        for entry in self._entries:
            result = entry(*args)
            if result is not NotImplemented:
                return result
        result = self.load(args)(*args)
        if result is NotImplemented:
            raise TypeError(
                f"{self.function.__name__}: its machine code rejects arguments of the kinds that it was compiled for"
            )
        return result

    def __reduce__(self) -> str:
        return self.function.__qualname__  # pickled by name

    def load(self, args: tuple[Any, ...]) -> Callable[..., Any]:
        """Load or compile machine code for such arguments; return its entry."""
        from raytrace.native.signatures import kind_of, types_of

        kinds, types = tuple(map(kind_of, args)), tuple(kind for arg in args for kind in types_of(arg))
        with _lock:
            if (kinds, types) not in self._bound:
                self._bound[kinds, types] = self._entry(kinds, types, args)
                self._entries = tuple(self._bound.values())
            return self._bound[kinds, types]

    def c_address(self, args: tuple[Any, ...]) -> int:
        """Load or compile machine code for such arguments; return the address of its C entry.

        Raises
        ------
        RuntimeError
            It has none, because the installed Numba or llvmlite cannot compile or link it in the usual way.
        """
        from raytrace.native.link import c_address
        from raytrace.native.signatures import kind_of

        self.load(args)
        address = self.code.get(tuple(map(kind_of, args)))
        if address is None or not self.c_entry:
            raise RuntimeError(f"{self.function.__name__} has no machine code that other machine code can call")
        return c_address(address)

    def _entry(self, kinds: tuple[Any, ...], types: tuple[type, ...], args: tuple[Any, ...]) -> Callable[..., Any]:
        """Return the entry of machine code for arguments of these kinds, which is loaded or compiled."""
        from raytrace.native.fallback import Unavailable, plain, private_parts

        try:
            code = None if kinds in self.code else self.stored(kinds) or self._made(kinds)
            with private_parts():
                from raytrace.native.link import bind, link

                if code:
                    self.code[kinds] = link(code)
                return bind(self.function.__name__, self.code[kinds], types)
        except Unavailable as reason:
            return plain(self.function, kinds, args, reason)

    def stored(self, kinds: tuple[Any, ...]) -> Any:
        """Return object code for arguments of these kinds if it was compiled before."""
        from raytrace.native.fallback import private_parts

        with private_parts():
            from raytrace.native import store

            return self._unkept.get(kinds) or store.find(*self._title(kinds))

    def compile(self, kinds: tuple[Any, ...]) -> Any:
        """Compile and store object code for arguments of these kinds; return it."""
        from raytrace.native.fallback import private_parts

        with private_parts():
            from raytrace.native.compiler import compile_kernel

            code = compile_kernel(self.function, kinds, self.c_entry)
        self.keep(kinds, code)
        return code

    def keep(self, kinds: tuple[Any, ...], code: Any) -> None:
        """Store object code; if that fails, keep it for this process."""
        from raytrace.native import store

        if not store.keep(*self._title(kinds), code):
            self._unkept[kinds] = code

    def unkept(self, kinds: tuple[Any, ...]) -> Any:
        """Return object code for arguments of these kinds that could not be stored."""
        return self._unkept.get(kinds)

    def _made(self, kinds: tuple[Any, ...]) -> Any:
        """Return object code that was not in the store; a listener may compile it in a worker process first."""
        with _compiling():
            return self.stored(kinds) or self.compile(kinds)

    def _title(self, kinds: tuple[Any, ...]) -> tuple[str, str]:
        from raytrace.native.signatures import describe

        return f"{self.__module__}.{self.function.__qualname__}", ", ".join(map(describe, kinds))


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a function that Python calls; it is compiled when it is called, and its machine code is stored."""
    if PLAIN:
        return np.errstate(all="ignore")(function)  # 1 / 0 is inf, as in machine code
    return Kernel(function)


def c_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a kernel that other machine code can call too."""
    return kernel(function) if PLAIN else Kernel(function, c_entry=True)


def load_all(calls: Iterable[tuple[Any, tuple[Any, ...]]]) -> None:
    """Load or compile the machine code of kernels, each given with its arguments."""
    for kernel, args in calls:
        if isinstance(kernel, Kernel):
            kernel.load(args)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a small function that only kernels call; it is inlined."""
    callees.append((function, {"forceinline": True}))
    return function


def subroutine(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a large function that only kernels call; it is compiled once and not inlined."""
    callees.append((function, {}))
    return function


def specialised(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare the compiled form of a function, chosen by the types of its arguments at no cost at run time."""

    def declare(choose: Callable[..., Any]) -> Callable[..., Any]:
        forms.append((function, choose))
        return choose

    return declare


def interpreted(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return the plain Python function of a kernel: it gives the same results without compilation."""
    return getattr(kernel, "function", kernel)


class on_compile:
    """Context manager that calls ``started()`` at the first compilation, and sums the seconds of all."""

    def __init__(self, started: Callable[[], None] = lambda: None) -> None:
        self.seconds, self.count, self._started = 0.0, 0, started

    def __enter__(self) -> Self:
        _listening.append(self)
        return self

    def __exit__(self, *exception: object) -> None:
        _listening.remove(self)


_listening: list[on_compile] = []


@contextmanager
def _compiling() -> Iterator[None]:
    """Notify listeners of a compilation, which happens within this context."""
    listening, began = list(_listening), time.perf_counter()
    for listener in listening:
        listener.count += 1
        if listener.count == 1:
            listener._started()
    yield
    for listener in listening:
        listener.seconds += time.perf_counter() - began
