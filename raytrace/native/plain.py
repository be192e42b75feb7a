"""Kernels compiled with the public part of Numba only: nothing is stored, and references to arrays are counted."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numba
import numpy as np
from numba.extending import overload, register_jitable

from raytrace import jit
from raytrace.accel import lanes_block_jit, lanes_jit, lanes_pool_jit  # noqa: F401  (they register lanes with Numba)
from raytrace.native.fallback import Unavailable, private_parts

FLAGS: dict[str, Any] = {"error_model": "numpy"}  # as in `compiler`: 1 / 0 is inf; and no fastmath


def _teach() -> None:
    """Register callees with Numba as `compiler` does, if possible; else compile them together with their callers."""
    try:
        with private_parts():
            from raytrace.native.compiler import teach

            teach()
    except Unavailable:
        while jit.callees:
            function, options = jit.callees.pop(0)
            register_jitable(**FLAGS, **options)(function)
        while jit.forms:
            function, choose = jit.forms.pop(0)
            overload(function, inline="always")(choose)


def compile_plain(function: Callable[..., Any], args: tuple[Any, ...]) -> Callable[..., Any]:
    """Return a kernel compiled for such arguments, or an interpreted one if LLVM cannot find a function it calls."""
    _teach()
    compiled = numba.njit(nogil=True, **FLAGS)(function)
    with _checked() as lacking:
        compiled.compile(tuple(map(numba.typeof, args)))
    return np.errstate(all="ignore")(function) if lacking else compiled


def _checked() -> AbstractContextManager[list[str]]:
    """Check machine code before it is linked, if possible."""
    try:
        with private_parts():
            from raytrace.native.compiler import checked

            return checked()
    except Unavailable:
        return nullcontext([])
