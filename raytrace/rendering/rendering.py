"""``render``: checks the caller's options, and starts a run."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from raytrace import parallel
from raytrace.errors import OptionError
from raytrace.limits import LAYERS, LIGHT_LAYERS, MAX_PIXELS, MAX_SEED, MAX_SIDE, MAX_SPP
from raytrace.memory import RenderSize, check_render, keep_freed
from raytrace.passes.film import BINS
from raytrace.records import Camera, Scene, Settings, Window
from raytrace.rendering import adaptive
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.compiled_scene import plan_of, trees_of
from raytrace.rendering.job import Job, Tiling
from raytrace.rendering.progress import Progress, listener_of
from raytrace.rendering.result import Render
from raytrace.rendering.run import Run
from raytrace.rendering.wavefront import BATCH
from raytrace.scene.load import load
from raytrace.scene.other_camera import in_view, with_camera
from raytrace.scene.path_plan import needs_paths
from raytrace.scene.seen_backs import warn_of_backs
from raytrace.scene.sources import Source

if TYPE_CHECKING:
    from distributed import Client

    from raytrace.rendering.cluster import Cluster


def render(
    scene: Scene | Source,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    precision: str | None = None,
    sampler: str | None = None,
    *,
    integrator: str | None = None,
    camera: dict[str, Any] | Camera | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | Literal[False] | None = None,
    aov: Sequence[str] = (),
    crop: tuple[int, int, int, int] | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    max_memory: int | None = None,
    checkpoint: str | Path | Checkpoint | None = None,
    client: Client | None = None,
) -> Render:
    """Render a scene.

    Parameters
    ----------
    scene : Scene, str, Path, dict or mesh
        A loaded scene; or what ``load`` accepts: a scene file, its content, a mesh, or a mesh file.
    spp, size, seed, precision, sampler : optional
        Samples per pixel; image size (width, height) in pixels; random seed, 0 .. 2**32 - 1; "auto", "float32" or
        "float64"; "sobol", "stratified" or "independent". Default: the scene's settings.
    integrator : {"direct", "path"}, optional
        Light that comes straight from the lights, or all the light. Default: what the scene says.
    camera : dict or Camera, optional
        Another camera, as ``camera`` in a scene file, or one like ``scene.camera``: for turntables. A loaded scene
        keeps its trees from one camera to the next. ``fov`` is vertical: another ``size`` shows more or less at the
        sides.
    threads : int, optional
        Number of threads. Default: one per core that the process may use. The image is bit-identical for any number.
    progress : callable or False, optional
        Called with a ``Progress`` from time to time. Default: a notebook cell shows the image while it is rendered;
        elsewhere nothing is shown. False: nothing is shown.
    aov : sequence of str
        Layers to compute now, and to keep in files; ``Render.aov`` computes any of them later. "emission", "direct"
        and "indirect", parts of path-traced light, must be asked for here.
    crop : (x, y, width, height), pixels, optional
        Render only this part of the film. It is bit-identical to that part of the whole image.
    time_limit : float, seconds, optional
        Stop after about this time. The image then has the samples of the last complete round over all pixels.
    target_error : float, optional
        Adaptive sampling until the estimated RMSE of the image, in sRGB clipped to 0 .. 1, is at most this: 0.002 is
        half a step of 8 bits. No pixel gets more than ``spp`` samples, by default 4096.
    max_memory : int, bytes, optional
        The most memory that the process may use in all; an image that needs more is refused. Default: what is free.
    checkpoint : str or Path, optional
        File that keeps finished work items during the render. If it exists, the render resumes from it, and the image
        is bit-identical to that of an uninterrupted render. ``Render.save`` deletes it once the image is complete.
    client : distributed.Client, optional
        Render on the workers of this Dask cluster instead of threads of this process; the image is bit-identical.

    Returns
    -------
    Render
        With ``complete`` False after Ctrl-C or the time limit: the whole image, with fewer samples per pixel, as
        ``provenance["samples"]`` says; black with 0 samples if the first round was not complete.

    Raises
    ------
    SceneError, FileError
        As ``load`` does; SceneError for a wrong ``camera``; and FileError for a checkpoint of another image, or one
        that can't be written.
    OptionError
        An option has a value that is not allowed; the cluster is gone, or none of its workers can be used.

    Warns
    -----
    SceneWarning
        A refractive surface coincides with another surface, so that rays can miss one of them. Or a quarter of the
        image is black, because it shows the back of one-sided surfaces.

    Examples
    --------
    >>> import raytrace as rt
    >>> image = rt.render("scenes/cornell-box.json", spp=4, size=(32, 32))
    >>> image.rgb.shape, image.complete
    ((32, 32, 3), True)

    Two images of a turntable:

    >>> scene = rt.load("scenes/cornell-box.json")
    >>> for x in (-0.5, 0.5):
    ...     camera = {"position": [x, 1, 6.8], "look_at": [0, 1, 0], "fov": 19.5}
    ...     image = rt.render(scene, spp=1, size=(32, 32), camera=camera)
    """
    if not isinstance(scene, Scene):
        scene = load(scene, max_memory=max_memory)
    target = target_of(target_error)
    most = adaptive.CAP if spp is None and target is not None else spp
    settings = override(scene.settings, most, size, seed, precision, sampler, integrator=integrator)
    window = window_of(settings.size, crop)
    layers, limit, count = layers_of(aov), seconds_of(time_limit), parallel.thread_count(threads)
    if "uv" in layers:
        scene.corner_uv  # noqa: B018 - may read files: what is wrong with them is an error now, not after the render
    scene = in_view(scene, settings.size) if camera is None else with_camera(scene, camera)
    plan = plan_of(scene)
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    if plan.refraction:
        from raytrace.scene.coincident import warn_coincident

        warn_coincident(scene, precision, stacklevel=2)
    first_spp = settings.spp if target is None else min(adaptive.FIRST, settings.spp)
    light = light_of(layers, settings.integrator)
    job, listener = Job(scene, plan, settings, window, precision, target, first_spp, light), listener_of(progress)
    check_render(
        memory_of(job, layers, count),
        trees_of(scene, plan, precision, needs_paths(scene, settings.integrator)),
        max_memory,
    )
    keep_freed()
    pixels = window.width * window.height
    early = limit < np.inf or listener.early(pixels * job.first_spp)
    tiling = Tiling(first=1 if early else None)
    file = checkpoint if isinstance(checkpoint, Checkpoint | None) else Checkpoint(Path(checkpoint))
    cluster = None if client is None else _cluster_of(client, job, threads)
    if cluster:
        tiling = cluster.tiling(tiling, pixels)
    if file:
        tiling = file.begin(job) or tiling
    image = Run(job, tiling, file, cluster, listener).run(count, limit, layers)
    warn_of_backs(scene, image, stacklevel=2)
    return image


def memory_of(job: Job, layers: Sequence[str], threads: int) -> RenderSize:
    """Return what the memory of a render depends on."""
    pixels, spp = job.window.width * job.window.height, job.settings.spp
    batch = min(threads, -(-pixels * spp // BATCH)) * BATCH
    traced = bool(set(layers) - {"samples", *LIGHT_LAYERS})
    return RenderSize(pixels, traced, job.target is not None, min(spp, BINS), batch, job.light)


def _cluster_of(client: Client, job: Job, threads: int | None) -> Cluster:
    from raytrace.rendering.cluster import Cluster

    if threads is not None:
        raise OptionError("threads: cannot be combined with a cluster; its workers have their own threads")
    return Cluster(client, job)


# Options, checked -----------------------------------------------------------------------------------------------------


def _integer(name: str, value: Any) -> int:
    """Return a whole number of any type as an int."""
    if not isinstance(value, bool):
        try:
            return operator.index(value)
        except TypeError:
            pass
    raise OptionError(f"{name}: expected a whole number, got {value!r}")


def within(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number of any type as an int, if it is in the range from ``low`` to ``high``."""
    number = _integer(name, value)
    if not low <= number <= high:
        raise OptionError(f"{name}: expected a number from {low} to {high}, got {number}")
    return number


def size_of(value: Any) -> tuple[int, int]:
    """Return the size (width, height) of an image, if it is within the limits."""
    if not isinstance(value, Sequence | np.ndarray) or len(value) != 2:
        raise OptionError(f"size: expected (width, height), got {value!r}")
    width, height = _integer("size", value[0]), _integer("size", value[1])
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        limits = f"1x1 to {MAX_SIDE:,} pixels per side and {MAX_PIXELS:,} in all"
        raise OptionError(f"size: expected {limits}, got {width}x{height}")
    return width, height


CHOICES = {
    "precision": ("auto", "float32", "float64"),
    "sampler": ("sobol", "stratified", "independent"),
    "integrator": ("direct", "path"),
}


def override(
    settings: Settings, spp: Any, size: Any, seed: Any, precision: Any, sampler: Any, *, integrator: Any = None
) -> Settings:
    """Return the scene's settings, replaced by the caller's where these are not None, and checked."""
    given = {"spp": spp, "size": size, "seed": seed, "precision": precision, "sampler": sampler}
    given["integrator"] = integrator
    settings = settings._replace(**{name: value for name, value in given.items() if value is not None})
    for name, allowed in CHOICES.items():
        if getattr(settings, name) not in allowed:
            raise OptionError(f"{name}: expected one of {', '.join(allowed)}, got {getattr(settings, name)!r}")
    return settings._replace(
        spp=within("spp", settings.spp, 1, MAX_SPP),
        seed=within("seed", settings.seed, 0, MAX_SEED),
        size=size_of(settings.size),
    )


def window_of(size: tuple[int, int], crop: tuple[int, int, int, int] | None) -> Window:
    """Return the part of the film that is rendered: the crop, or all of it."""
    window = Window(*(_integer("crop", number) for number in crop or (0, 0, *size)))
    inside = (
        window.x >= 0 and window.y >= 0 and window.x + window.width <= size[0] and window.y + window.height <= size[1]
    )
    if not inside or window.width < 1 or window.height < 1:
        raise OptionError(f"crop: {','.join(map(str, window))} is not inside the film of {size[0]}x{size[1]} pixels")
    return window


def layers_of(aov: Sequence[str]) -> tuple[str, ...]:
    """Return names of layers, checked; a single one may be a plain string."""
    names = (aov,) if isinstance(aov, str) else tuple(aov)
    for name in names:
        if name not in LAYERS + LIGHT_LAYERS:
            raise OptionError(f"aov: {name!r}: expected any of {', '.join(LAYERS + LIGHT_LAYERS)}")
    return names


def light_of(layers: Sequence[str], integrator: str) -> bool:
    """Return whether any layer is a part of the samples' light; an error if the integrator does not tell them apart."""
    asked = [name for name in layers if name in LIGHT_LAYERS]
    if asked and integrator != "path":
        raise OptionError(f"aov: {asked[0]} needs the integrator path, not {integrator}; add --integrator path")
    return bool(asked)


def seconds_of(time_limit: float | None) -> float:
    """Return the seconds that a render may take; inf without a limit."""
    if time_limit is None:
        return float("inf")
    if not time_limit >= 0:
        raise OptionError(f"time_limit: expected seconds, at least 0, got {time_limit!r}")
    return time_limit


def target_of(target_error: float | None) -> float | None:
    """Return the target error, checked."""
    if target_error is not None and not 0 < target_error < 1:
        raise OptionError(f"target_error: expected an RMSE in sRGB, above 0 and below 1, got {target_error!r}")
    return target_error
