"""The one kernel decorator, and those of the functions that kernels call.

A kernel is an ordinary function until it is called. What it is called with chooses its machine code: found in memory,
else on disk, else compiled by Numba and kept. So a process whose kernels were compiled by an earlier one never imports
Numba, which takes a third of a second. Machine code lets go of the interpreter's lock: tiles run side by side in plain
threads, so there is no threading layer to abort and Ctrl-C works.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import update_wrapper
from typing import Any, Self

import numpy as np

PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")  # kernels stay the functions that they look like

callees: list[tuple[Callable[..., Any], dict[str, bool]]] = []  # that Numba has yet to be told about
forms: list[tuple[Callable[..., Any], Callable[..., Any]]] = []  # the same: functions, and what chooses their form

_lock = threading.RLock()  # held while machine code is looked for, compiled or loaded
if hasattr(os, "register_at_fork"):  # no child may begin in the midst of that
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


class Kernel:
    """A function that Python calls and that runs as machine code, compiled once for each kind of arguments.

    Attributes
    ----------
    function : callable
        The Python function.
    code : dict
        Address of the machine code for each kind of arguments that it was called with.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.function, self.code = function, dict[Any, int]()
        self._unkept = dict[Any, Any]()  # object code that the store could not keep
        self._bound = dict[Any, Callable[..., Any]]()
        self._entries: tuple[Callable[..., Any], ...] = ()  # replaced, never changed: no call waits for a lock

    def __call__(self, *args: Any) -> Any:
        """Call the machine code for such arguments."""
        for entry in self._entries:
            result = entry(*args)
            if result is not NotImplemented:
                return result
        result = self.load(args)(*args)
        if result is NotImplemented:
            raise TypeError(f"{self.function.__name__}: its machine code declines arguments of its own kinds")
        return result

    def __reduce__(self) -> str:
        return self.function.__qualname__  # pickled by name

    def load(self, args: tuple[Any, ...]) -> Callable[..., Any]:
        """Have machine code for such arguments ready; its entry."""
        from raytrace.native.signatures import kind_of, types_of

        kinds, types = tuple(map(kind_of, args)), tuple(kind for arg in args for kind in types_of(arg))
        with _lock:
            if (kinds, types) not in self._bound:
                self._bound[kinds, types] = self._entry(kinds, types, args)
                self._entries = tuple(self._bound.values())
            return self._bound[kinds, types]

    def _entry(self, kinds: tuple[Any, ...], types: tuple[type, ...], args: tuple[Any, ...]) -> Callable[..., Any]:
        """Entry of machine code for arguments of these kinds: stored, or made now."""
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
        """Object code for arguments of these kinds, if the store has it, or could not keep it."""
        from raytrace.native.fallback import private_parts

        with private_parts():
            from raytrace.native import store

            return self._unkept.get(kinds) or store.find(*self._title(kinds))

    def compile(self, kinds: tuple[Any, ...]) -> Any:
        """Object code for arguments of these kinds, compiled now, and stored."""
        from raytrace.native.fallback import private_parts

        with private_parts():
            from raytrace.native.compiler import compile_kernel

            code = compile_kernel(self.function, kinds)
        self.keep(kinds, code)
        return code

    def keep(self, kinds: tuple[Any, ...], code: Any) -> None:
        """Store object code; what can't be stored is kept for this process."""
        from raytrace.native import store

        if not store.keep(*self._title(kinds), code):
            self._unkept[kinds] = code

    def unkept(self, kinds: tuple[Any, ...]) -> Any:
        """Object code for arguments of these kinds that the store could not keep."""
        return self._unkept.get(kinds)

    def _made(self, kinds: tuple[Any, ...]) -> Any:
        """Object code that was not in the store: whoever is told that it is wanted may have it compiled elsewhere."""
        with _compiling():
            return self.stored(kinds) or self.compile(kinds)

    def _title(self, kinds: tuple[Any, ...]) -> tuple[str, str]:
        from raytrace.native.signatures import describe

        return f"{self.__module__}.{self.function.__qualname__}", ", ".join(map(describe, kinds))


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that Python calls, when it is called; the machine code is kept between processes."""
    if PLAIN:
        return np.errstate(all="ignore")(function)  # 1 / 0 is inf there too
    return Kernel(function)


def load_all(calls: Iterable[tuple[Any, tuple[Any, ...]]]) -> None:
    """Have the machine code of kernels ready, each given with its arguments."""
    for kernel, args in calls:
        if isinstance(kernel, Kernel):
            kernel.load(args)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a small function that only kernels call; its body is put into theirs."""
    callees.append((function, {"forceinline": True}))
    return function


def subroutine(function: Callable[..., Any]) -> Callable[..., Any]:
    """Declare a large function that only kernels call; it is compiled once, beside them."""
    callees.append((function, {}))
    return function


def specialised(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a function its compiled form, chosen by the types of its arguments, which leaves no trace in the code."""

    def declare(choose: Callable[..., Any]) -> Callable[..., Any]:
        forms.append((function, choose))
        return choose

    return declare


def interpreted(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The plain Python function behind a kernel, its callees plain too: the same results, with nothing to compile."""
    return getattr(kernel, "function", kernel)


class on_compile:
    """Call ``started()`` when kernels begin to be compiled, and sum the seconds; use as a context manager."""

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
    """Tell who listens that a kernel is compiled within."""
    listening, began = list(_listening), time.perf_counter()
    for listener in listening:
        listener.count += 1
        if listener.count == 1:
            listener._started()
    yield
    for listener in listening:
        listener.seconds += time.perf_counter() - began
