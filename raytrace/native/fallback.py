"""What happens where a private part of Numba or llvmlite is missing or works otherwise: the one place that decides.

Kernels are compiled and linked by parts of both that may change in any release. Whatever Python raises where such a
part is used becomes ``Unavailable``; the kernel is then compiled by plain ``numba.njit`` in every process, for the same
results, and one warning says so.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

MISSING = ImportError, AttributeError, TypeError, KeyError, IndexError, AssertionError, RuntimeError
_warned: list[str] = []


class Unavailable(Exception):
    """Machine code can't be made, or can't be linked, by the parts of Numba and llvmlite that are installed."""


@contextmanager
def private_parts() -> Iterator[None]:
    """Run a block that uses private parts of Numba and llvmlite; raise `Unavailable` where one is missing."""
    try:
        yield
    except NotImplementedError:  # what kernels may not do is refused
        raise
    except MISSING as error:
        raise Unavailable(f"{type(error).__name__}: {error}") from error


def plain(function: Callable[..., Any], kinds: tuple[Any, ...], args: tuple[Any, ...], why: Unavailable) -> Any:
    """Return the entry of a kernel compiled by ``numba.njit``, for arguments of these kinds only; warn once."""
    from raytrace.native.plain import compile_plain
    from raytrace.native.signatures import kind_of

    compiled = compile_plain(function, args)  # raises what is wrong with the kernel or its arguments, if that is it
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
