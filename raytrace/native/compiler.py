"""Compile a kernel to object code. Only this module and those that it imports use Numba, and only if code is missing.

Every kernel is compiled with

* ``error_model="numpy"``: 1 / 0 is inf, as the slab test expects, and not an exception that stops vectorisation;
* no reference counts (``_nrt``): kernels allocate nothing, their callers give them scratch memory. Counting took three
  quarters of the time of the traversal, and would make the code depend on Numba's runtime;
* no ``fastmath``: a miss is inf, NaN means a miss, and the watertight edge functions must not be rearranged.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.typing.templates import infer, infer_global, make_overload_template

from raytrace import jit
from raytrace.accel import lanes_block_jit, lanes_jit, lanes_pool_jit  # noqa: F401  (they register lanes with Numba)
from raytrace.native import processor
from raytrace.native.c_entry import CEntry, flat
from raytrace.native.entry import Entry, check_layout, numba_type
from raytrace.native.fallback import Unavailable
from raytrace.native.link import C_SYMBOL, SYMBOL, Code
from raytrace.native.pipeline import FunctionCompiler
from raytrace.native.signatures import Kind
from raytrace.native.symbols import stand_in, unknown

OPTIONS = {"error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
if processor.narrowed():
    numba.config.CPU_FEATURES = processor.cpu_features()  # Numba reads it at its first compilation
_callees: dict[Callable[..., Any], Dispatcher] = {}  # Numba itself only keeps weak references


def _callee(function: Callable[..., Any], options: dict[str, bool]) -> Dispatcher:
    """Compile a callee once for the types of its arguments, and not again for each constant argument."""
    compiled = numba.njit(**OPTIONS, **options)(function)
    old = compiled._compiler
    compiled._compiler = FunctionCompiler(function, old.targetdescr, old.targetoptions, {}, old.pipeline_class)
    template = compiled.get_call_template
    compiled.get_call_template = lambda args, kws: template([types.unliteral(arg) for arg in args], kws)
    return compiled


def teach() -> None:
    """Register with Numba all callees that were declared since the last call."""
    while jit.callees:
        function, options = jit.callees[0]
        _callees[function] = _callee(function, options)
        cpu_target.typing_context.insert_global(function, types.Dispatcher(_callees[function]))
        jit.callees.pop(0)  # only after it is registered
    while jit.forms:
        function, choose = jit.forms[0]
        _register_forms(function, choose)
        jit.forms.pop(0)


def _register_forms(function: Callable[..., Any], choose: Callable[..., Any]) -> None:
    """Register the compiled forms of a function with Numba: callees that are inlined, chosen by types of arguments."""
    options = {"strict": True, "inline": "never"}
    template = make_overload_template(function, choose, {"forceinline": True}, **options)
    template._get_jit_decorator = lambda _self: lambda **options: lambda form: _callee(form, options)
    infer(template)
    infer_global(function, types.Function(template))


@contextmanager
def _uncollected() -> Iterator[None]:
    """Pause Python's garbage collector, which takes a sixth of the compile time and finds nothing."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def checked() -> Iterator[list[str]]:
    """Check machine code before Numba links it; yield the names that it calls and this process lacks."""
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
def compile_kernel(function: Callable[..., Any], kinds: tuple[Kind, ...], c_entry: bool = False) -> Code:
    """Object code of a kernel for arguments of these kinds, with a C entry beside the usual one if asked for.

    Raises
    ------
    NotImplementedError
        It calls functions of Numba's runtime, so it could not run in a process without Numba.
    Unavailable
        It calls a function that LLVM cannot find in this process.
    """
    check_layout()
    with _uncollected(), checked() as lacking:
        teach()
        context = cpu_target.target_context
        compiler = FunctionCompiler(
            function, cpu_target, OPTIONS | {"nopython": True}, {}, numba.core.compiler.Compiler
        )
        compiled = compiler.compile(tuple(map(numba_type, kinds)), None)
        library = compiled.library
        module = library.create_ir_module(SYMBOL)
        Entry(context, module, SYMBOL).write(compiled.fndesc, kinds)
        if c_entry and flat(kinds):
            CEntry(context, module, C_SYMBOL).write(compiled.fndesc, kinds)
        library.add_ir_module(module)
        final, data = library.machine_code((SYMBOL, C_SYMBOL))
        outside = tuple(f.name for f in final.functions if f.is_declaration and not f.name.startswith("llvm."))
    code = Code(outside, data)
    if code.foreign:
        raise NotImplementedError(f"{function.__name__} calls {', '.join(code.foreign)}: kernels call only each other")
    try:
        lacking.extend(unknown(data))
    except ValueError as error:
        raise Unavailable(str(error)) from None
    if lacking:
        raise Unavailable(f"machine code calls {', '.join(lacking)}, which this process lacks")
    return code
