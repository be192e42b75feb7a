"""How Numba translates a kernel or callee to LLVM code: with the passes that such functions need, and no others.

The usual pipeline has 24 passes and checks the whole function after each of them. Kernels need half of the passes: they
have no closures, generators, ``with`` blocks, calls that are inlined by Numba, loops over tuples of different types, or
expressions of arrays.
"""

from types import CodeType
from typing import Any

from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import compiler, typed_passes, untyped_passes
from numba.core.compiler_machinery import PassManager
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]

from raytrace.native.library import KernelLibrary

PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,  # `x is None`
    untyped_passes.GenericRewrites,  # constant indices
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.IRLegalization,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)


class _Passes(PassManager):
    """Runs passes without checks between them, and without a record of their times."""

    def _runPass(self, _index: int, pass_: Any, state: Any) -> None:
        pass_.analysis = self._analysis
        pass_.run_pass(state)


def _make_passes() -> _Passes:
    passes = _Passes("kernel")
    for each in PASSES:
        passes.add_pass(each, each.__name__)
    passes.finalize()
    return passes


class _Pipeline(compiler.CompilerBase):
    """The pipeline of kernels."""

    _passes = _make_passes()

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes, which hold no state."""
        return [self._passes]


class FunctionCompiler(_FunctionCompiler):
    """Compiles a kernel or callee to LLVM code, and not to machine code."""

    def _compile_core(self, args: tuple[Any, ...], return_type: Any) -> Any:
        target = self.targetdescr
        flags: Any = compiler.Flags()
        target.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = True
        plain = not any(isinstance(const, CodeType) for const in self.py_func.__code__.co_consts)
        library = KernelLibrary(target.target_context.codegen(), self.py_func.__qualname__)
        compiled = compiler.compile_extra(
            target.typing_context,
            target.target_context,
            self.py_func,
            args,
            return_type,
            flags,
            self.locals,
            library,
            _Pipeline if plain else self.pipeline_class,
        )
        name = compiled.fndesc.qualname.rpartition(".")[2]
        module = compiled.fndesc.lookup_module()
        entry = _dynfunc.make_function(module, name, "", 0, compiled.environment, (library,))
        target.target_context.insert_user_function(entry, compiled.fndesc, [library])
        return compiled._replace(entry_point=entry)
