"""Fallback where a private part of Numba or llvmlite is missing or has changed: all decisions are made here.

Kernels are compiled and linked with private parts of both, which may change in any release. An exception of such a
part becomes ``Unavailable``. The kernel is then compiled by plain ``numba.njit`` in every process, with bit-identical
results, and one warning is given.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

MISSING = ImportError, AttributeError, TypeError, KeyError, IndexError, AssertionError, RuntimeError
_warned: list[str] = []


class Unavailable(Exception):
    """The installed Numba and llvmlite cannot compile or link machine code in the usual way."""


@contextmanager
def private_parts() -> Iterator[None]:
    """Run a block that uses private parts of Numba and llvmlite; raise `Unavailable` where one is missing."""
    try:
        yield
    except NotImplementedError:  # the kernel does what no kernel may do
        raise
    except MISSING as error:
        raise Unavailable(f"{type(error).__name__}: {error}") from error


def plain(function: Callable[..., Any], kinds: tuple[Any, ...], args: tuple[Any, ...], why: Unavailable) -> Any:
    """Return the entry of a kernel that ``numba.njit`` compiles, for arguments of these kinds only; warn once."""
    from raytrace.native.plain import compile_plain
    from raytrace.native.signatures import kind_of

    compiled = compile_plain(function, args)  # raises an error if the kernel or its arguments are wrong
    if not _warned:
        _warned.append(str(why))
        warnings.warn(
            f"plain numba.njit compiles kernels in every process, for the same results, because {why}; "
            "a release of Numba that raytrace was tested with avoids this",
            RuntimeWarning,
            stacklevel=5,
        )

    def entry(*args: Any) -> Any:
        return compiled(*args) if tuple(map(kind_of, args)) == kinds else NotImplemented

    return entry
