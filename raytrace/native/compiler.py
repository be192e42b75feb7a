"""From a kernel to object code. Numba is imported here and in what this imports, and only where there is no code yet.

Every kernel is compiled with

* ``error_model="numpy"``: 1 / 0 is inf, as the slab test expects, and not an exception that stops vectorisation;
* no reference counts (``_nrt``): kernels allocate nothing, they are handed their scratch memory; counting cost the
  traversal three quarters of its time, and would tie the code to Numba's runtime;
* no ``fastmath``: a miss is inf, NaN means miss, and the watertight edge functions may not be rearranged.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher, _FunctionCompiler
from numba.core.registry import cpu_target
from numba.extending import overload

from raytrace import jit
from raytrace.accel import lanes_jit  # noqa: F401  (teaches Numba the SIMD lanes)
from raytrace.native import processor
from raytrace.native.entry import Entry, check_layout, numba_type
from raytrace.native.fallback import Unavailable
from raytrace.native.link import SYMBOL, Code
from raytrace.native.signatures import Kind
from raytrace.native.symbols import stand_in, unknown

OPTIONS = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
if processor.narrowed():
    numba.config.CPU_FEATURES = processor.cpu_features()  # Numba reads it when it compiles something for the first time
_callees: dict[Callable[..., Any], Dispatcher] = {}  # Numba itself only keeps weak references


class _KernelCompiler(_FunctionCompiler):
    """Leaves the code of a kernel as it is before LLVM optimises it, so that its entry can be put beside it."""

    def _customize_flags(self, flags: Any) -> Any:
        flags.no_compile = True
        return flags


def _callee(function: Callable[..., Any], options: dict[str, bool]) -> Dispatcher:
    """Compile a callee for the types of its arguments, and not once more for each constant that it is called with."""
    compiled = numba.njit(**OPTIONS, **options)(function)
    template = compiled.get_call_template
    compiled.get_call_template = lambda args, kws: template([types.unliteral(arg) for arg in args], kws)
    return compiled


def teach() -> None:
    """Tell Numba about all callees that were declared since the last time."""
    while jit.callees:
        function, options = jit.callees[0]
        _callees[function] = _callee(function, options)
        cpu_target.typing_context.insert_global(function, types.Dispatcher(_callees[function]))
        jit.callees.pop(0)  # now that it is known
    while jit.forms:
        function, choose = jit.forms[0]
        overload(function, inline="always")(choose)
        jit.forms.pop(0)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Without Python's garbage collector, which takes a sixth of the time of compiling and finds nothing."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def checked() -> Iterator[list[str]]:
    """Look at machine code before Numba links it; give the names that it calls and this process lacks."""
    jit_engine = cpu_target.target_context.codegen()._engine
    engine, lacking = jit_engine._ee, []
    notify = engine._object_cache_notify

    def look(module: Any, data: bytes) -> None:
        names = [n for n in unknown(data) if not n.startswith(".numba.") and not jit_engine.is_symbol_defined(n)]
        stand_in(names)
        lacking.extend(names)
        notify(module, data)

    engine._object_cache_notify = look
    try:
        yield lacking
    finally:
        engine._object_cache_notify = notify


@global_compiler_lock
def compile_kernel(function: Callable[..., Any], kinds: tuple[Kind, ...]) -> Code:
    """Object code of a kernel for arguments of these kinds.

    Raises
    ------
    NotImplementedError
        It calls what only Numba's runtime has, so that no process without it could run it.
    Unavailable
        It calls what LLVM can't find in this process.
    """
    check_layout()
    with _uncollected(), checked() as lacking:
        teach()
        context = cpu_target.target_context
        compiler = _KernelCompiler(function, cpu_target, OPTIONS | {"nopython": True}, {}, numba.core.compiler.Compiler)
        compiled = compiler.compile(tuple(map(numba_type, kinds)), None)
        library = compiled.library
        module = library.create_ir_module(SYMBOL)
        Entry(context, module, SYMBOL).write(compiled.fndesc, kinds)
        library.add_ir_module(module)
        library.enable_object_caching()
        library.finalize()
        final = library._final_module
        outside = tuple(f.name for f in final.functions if f.is_declaration and not f.name.startswith("llvm."))
    code = Code(outside, library._get_compiled_object())
    if code.foreign:
        raise NotImplementedError(f"{function.__name__} calls {', '.join(code.foreign)}: kernels call only each other")
    if lacking:
        raise Unavailable(f"machine code calls {', '.join(lacking)}, which this process lacks")
    return code
