"""LLVM code of a kernel and its callees: collected unoptimised, then optimised together, once.

Numba optimises each function with all that it calls before it is inlined elsewhere, and makes machine code of it, which
nobody calls. In a chain of ten callees the innermost one is optimised ten times. Here only the kernel is optimised,
from the innermost callee outwards, as LLVM does in one module anyway.
"""

from collections.abc import Iterable
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary


class KernelLibrary(JITCodeLibrary):
    """Code of a kernel or of one of its callees, in a form that Numba's libraries can link."""

    def finalize(self) -> None:
        """Do nothing: a callee is optimised within its kernels."""
        self._finalized = True

    def machine_code(self, entries: Iterable[str]) -> tuple[Any, bytes]:
        """Return the optimised module, and object code, of a kernel with these entries."""
        module = self._linked(entries)
        inlining = {"loop_vectorize": False, "slp_vectorize": False, "opt": 0, "cost": "cheap"}
        for options in (inlining, {}):
            manager, builder = self._codegen._module_pass_manager(**options)
            manager.run(module, builder)
        module.verify()
        return module, self._codegen._tm.emit_object(module)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Omit the optimisation of single functions; only set the layout of data."""
        ll_module.data_layout = self._codegen._data_layout

    def _get_module_for_linking(self) -> Any:
        """Return a module with all callees, for a library of Numba."""
        if self._shared_module is None:
            self._shared_module = self._linked(())
        return self._shared_module

    def _linked(self, entries: Iterable[str]) -> Any:
        """Return a new module of this code and all callees; only these entries are kept where nothing calls them."""
        module, kept = self._final_module.clone(), set(entries)
        others = [library for library in self._callees() if library is not self]
        for library in others:  # as external functions: LLVM drops others that no function calls yet
            if isinstance(library, KernelLibrary):
                module.link_in(library._final_module, preserve=True)
        for library in others:
            if not isinstance(library, KernelLibrary):
                module.link_in(library._get_module_for_linking(), preserve=True)
        for function in module.functions:
            external = not function.is_declaration and function.linkage == llvm.Linkage.external
            if external and function.name not in kept:
                function.linkage = "linkonce_odr"
        return module

    def _callees(self) -> Iterable[Any]:
        """Return the libraries of all callees, direct and indirect, each once."""
        seen, left = dict[Any, None](), list[Any](self._linking_libraries)
        while left:
            library = left.pop()
            if library not in seen:
                seen[library] = None
                left += library._linking_libraries if isinstance(library, KernelLibrary) else []
        return seen
