"""``warmup``: compile all kernels before the first render."""

import time
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from typing import TYPE_CHECKING

from raytrace.errors import FileError, RaytraceError
from raytrace.jit import PLAIN
from raytrace.records import Scene
from raytrace.rendering.compiled_scene import plan_of
from raytrace.rendering.kernels import Traits, compile_ahead, traits_of
from raytrace.rendering.progress import Progress

if TYPE_CHECKING:
    from raytrace.rendering.path_kernels import PathNeeds

PRECISIONS, SAMPLERS = ("float32", "float64"), ("sobol", "stratified", "independent")


def warmup(
    progress: Callable[[Progress], None] | None = None, *, integrator: str = "direct", scenes: Iterable[Scene] = ()
) -> None:
    """Compile kernels: those of every kind of render, with all precisions, samplers, normals and layers; or of scenes.

    Parameters
    ----------
    progress : callable, optional
        Called with a ``Progress`` from time to time.
    integrator : {"direct", "path"}
        "path": also the kernels of path tracing, with every kind of light and material. They take twice as long.
    scenes : iterable of Scene
        Compile the kernels that these scenes need, with their settings, and no others.

    Raises
    ------
    FileError
        There is no folder to keep them in, or its disk is full.
    RaytraceError
        This release of Numba can't compile them in advance.
    SceneError
        No precision can represent a scene.

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
    renders = [_traits_of(scene, integrator) for scene in scenes] or list(every_kind(integrator))

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


def every_kind(integrator: str = "direct") -> Iterator[Traits]:
    """Yield renders that together need every kernel; those of path tracing only with "path"."""
    kinds: list[PathNeeds | None] = [None]
    if integrator == "path":
        from raytrace.rendering.path_kernels import every_need

        kinds += every_need()
    for path, precision, sampler, smooth in product(kinds, PRECISIONS, SAMPLERS, (False, True)):
        yield Traits(precision, sampler, smooth, refractive=True, large=True, layers=True, adaptive=True, path=path)


def _traits_of(scene: Scene, integrator: str) -> Traits:
    """Return the traits of a render of a scene, with all that can be asked for; "path" overrides its integrator."""
    plan, settings = plan_of(scene), scene.settings
    if integrator == "path":
        settings = settings._replace(integrator="path")
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    return traits_of(scene, plan, precision, settings, layers=True, adaptive=True)
