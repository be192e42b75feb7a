"""``warmup``: have all kernels compiled before the first picture is wanted."""

import time
from collections.abc import Callable
from itertools import product

from raytrace.errors import FileError, RaytraceError
from raytrace.jit import PLAIN
from raytrace.rendering.kernels import Picture, compile_ahead
from raytrace.rendering.progress import Progress

PRECISIONS, SAMPLERS = ("float32", "float64"), ("sobol", "stratified", "independent")


def warmup(progress: Callable[[Progress], None] | None = None) -> None:
    """Compile what pictures need: both precisions, all samplers, flat and smooth, refractive, large, layers, error.

    Parameters
    ----------
    progress : callable, optional
        Is called with a ``Progress`` now and then.

    Raises
    ------
    FileError
        There is no folder to keep them in, or it has no room for them.
    RaytraceError
        This release of Numba can't compile them ahead.

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
    pictures = [
        Picture(precision, sampler, smooth, refractive=True, large=True, layers=True, aimed=True)
        for precision, sampler, smooth in product(PRECISIONS, SAMPLERS, (False, True))
    ]

    def report(done: int, total: int) -> None:
        if progress:
            progress(Progress("compiling", done, total, 0, time.perf_counter() - began))

    tasks = compile_ahead(pictures, report)
    if tasks and not store.can_keep():
        raise FileError(f"{store.cache_folder()}: can't be written to; set RAYTRACE_CACHE to another folder")
    for done, (kernel, kinds) in enumerate(tasks, 1):
        if kernel.stored(kinds) is None:  # there were no other processes
            report(done - 1, len(tasks))
            try:
                kernel.compile(kinds)
            except Unavailable as reason:
                raise RaytraceError(f"kernels can't be compiled ahead, only in each process: {reason}") from None
    lost = sum(kernel.unkept(kinds) is not None for kernel, kinds in tasks)
    if lost:
        raise FileError(f"{store.cache_folder()}: {lost} of {len(tasks)} kernels could not be written")
