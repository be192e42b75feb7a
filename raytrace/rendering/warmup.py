"""``warmup``: compile all kernels before the first render."""

import time
from collections.abc import Callable
from itertools import product

from raytrace.errors import FileError, RaytraceError
from raytrace.jit import PLAIN
from raytrace.rendering.kernels import Traits, compile_ahead
from raytrace.rendering.progress import Progress

PRECISIONS, SAMPLERS = ("float32", "float64"), ("sobol", "stratified", "independent")


def warmup(progress: Callable[[Progress], None] | None = None) -> None:
    """Compile the kernels of every kind of render: all precisions, samplers, normals, materials, layers and errors.

    Parameters
    ----------
    progress : callable, optional
        Called with a ``Progress`` from time to time.

    Raises
    ------
    FileError
        There is no folder to keep them in, or its disk is full.
    RaytraceError
        This release of Numba can't compile them in advance.

    Examples
    --------
    >>> from raytrace.rendering.warmup import warmup
    >>> warmup()  # doctest: +SKIP
    """
    if PLAIN:
        return
    from raytrace.native import store
    from raytrace.native.fallback import Unavailable

    began = time.perf_counter()
    renders = [
        Traits(precision, sampler, smooth, refractive=True, large=True, layers=True, adaptive=True)
        for precision, sampler, smooth in product(PRECISIONS, SAMPLERS, (False, True))
    ]

    def report(done: int, total: int) -> None:
        if progress:
            progress(Progress("compiling", done, total, 0, time.perf_counter() - began))

    tasks = compile_ahead(renders, report)
    if tasks and not store.can_keep():
        raise FileError(f"{store.cache_folder()}: can't be written to; set RAYTRACE_CACHE to another folder")
    for done, (kernel, kinds) in enumerate(tasks, 1):
        if kernel.stored(kinds) is None:  # no other process compiled it
            report(done - 1, len(tasks))
            try:
                kernel.compile(kinds)
            except Unavailable as reason:
                raise RaytraceError(f"kernels can't be compiled in advance, only in each process: {reason}") from None
    lost = sum(kernel.unkept(kinds) is not None for kernel, kinds in tasks)
    if lost:
        raise FileError(f"{store.cache_folder()}: {lost} of {len(tasks)} kernels could not be written")
