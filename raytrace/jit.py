"""The one kernel decorator, and the one place that keeps compiled kernels.

Every kernel is compiled with

* ``nogil``: tiles run side by side in plain Python threads, so there is no threading layer to abort and Ctrl-C works;
* ``error_model="numpy"``: 1 / 0 is inf, as the slab test expects, and not an exception that stops vectorisation;
* no reference counts (``_nrt``): kernels allocate nothing, they are handed their scratch memory; counting cost the
  traversal three quarters of its time;
* no ``fastmath``: a miss is inf, NaN means miss, and the watertight edge functions may not be rearranged.

Numba's own cache does not see an edit in a callee that lives in another file. Compiled kernels therefore lie in a
folder whose name is a hash of all kernel sources, so that any edit starts an empty one. Where no folder is writable
nothing is cached, and everything still works.
"""

import hashlib
import os
import time
from functools import cache, partial
from pathlib import Path
from types import FunctionType

import numba
import numpy as np
from numba.core import caching, event, types
from numba.core.dispatcher import Dispatcher
from numba.extending import overload
from platformdirs import user_cache_dir

from raytrace.accel import lanes_jit  # noqa: F401  (teaches Numba the SIMD lanes)

PACKAGE = Path(__file__).parent
KERNEL_SOURCES = ("jit.py", "records.py", "accel/*.py", "passes/*.py")


@cache
def cache_folder() -> Path:
    """Folder of this version's compiled kernels: ``RAYTRACE_CACHE`` or the user's cache, then a hash of the sources."""
    sources = sorted(path for pattern in KERNEL_SOURCES for path in PACKAGE.glob(pattern))
    content = hashlib.sha256(b"".join(path.read_bytes() for path in sources))
    content.update(f"numba {numba.__version__} boundscheck {numba.config.BOUNDSCHECK}".encode())
    root = os.environ.get("RAYTRACE_CACHE") or user_cache_dir("raytrace", appauthor=False)
    return Path(root) / content.hexdigest()[:16]


class _SourceHashLocator(caching._CacheLocator):
    """Where Numba keeps one kernel: the folder carries the stamp, so the files in it never go stale."""

    def __init__(self, py_func, py_file):
        self._function = py_func

    def get_cache_path(self):
        return str(cache_folder())

    def get_source_stamp(self):
        return cache_folder().name

    def get_disambiguator(self):
        return str(self._function.__code__.co_firstlineno)

    @classmethod
    def from_function(cls, py_func, py_file):
        locator = cls(py_func, py_file)
        try:
            locator.ensure_cache_path()
        except OSError:
            return None
        return locator


class _KernelCacheImpl(caching.CompileResultCacheImpl):
    _locator_classes = [_SourceHashLocator]


class _KernelCache(caching.FunctionCache):
    _impl_class = _KernelCacheImpl


_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_CALLED_BY_KERNELS = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # a third of their compile time


def kernel(function):
    """Compile a function that Python calls; the machine code is kept between processes."""
    if numba.config.DISABLE_JIT:
        return np.errstate(all="ignore")(function)  # 1 / 0 is inf there too
    compiled = numba.njit(**_OPTIONS)(function)
    try:
        compiled._cache = _KernelCache(function)
    except RuntimeError:  # no folder to write to: "no locator available"
        return compiled
    return compiled


def _one_variant(compiled):
    """Compile a callee for the types of its arguments, and not once more for each constant that it is called with."""
    if not numba.config.DISABLE_JIT:
        template = compiled.get_call_template
        compiled.get_call_template = lambda args, kws: template([types.unliteral(arg) for arg in args], kws)
    return compiled


def inlined(function):
    """Compile a small function that only kernels call; its body is put into theirs."""
    return _one_variant(numba.njit(forceinline=True, **_CALLED_BY_KERNELS)(function))


def subroutine(function):
    """Compile a large function that only kernels call, once, beside them."""
    return _one_variant(numba.njit(**_CALLED_BY_KERNELS)(function))


# Gives a plain function its compiled form, chosen by the types of its arguments, which leaves no trace in the code.
specialised = partial(overload, inline="always")


@cache
def interpreted(compiled):
    """The plain Python function behind a kernel, its callees plain too: the same results, with nothing to compile."""
    if numba.config.DISABLE_JIT:
        return compiled
    function = compiled.py_func
    known = function.__globals__
    callees = [name for name in function.__code__.co_names if isinstance(known.get(name), Dispatcher)]
    scope = known | {name: interpreted(known[name]) for name in callees}
    return FunctionType(function.__code__, scope, function.__name__, function.__defaults__)


class on_compile(event.Listener):
    """Call ``started()`` when Numba begins to compile, and sum the seconds; use as a context manager."""

    def __init__(self, started=None):
        self.seconds, self.count, self._started, self._depth, self._since = 0.0, 0, started, 0, 0.0

    def on_start(self, event):
        if self._depth == 0:
            self._since = time.perf_counter()
            if self._started and self.count == 0:
                self._started()
        self._depth += 1
        self.count += 1

    def on_end(self, event):
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._since

    def __enter__(self):
        event.register("numba:compile", self)
        return self

    def __exit__(self, *exception):
        event.unregister("numba:compile", self)
