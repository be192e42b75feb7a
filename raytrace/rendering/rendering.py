"""``render``: what callers ask of it, checked; then a run."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from raytrace import parallel
from raytrace.errors import OptionError
from raytrace.memory import Drawing, check_drawing
from raytrace.passes.film import BINS
from raytrace.records import Scene
from raytrace.rendering import adaptive
from raytrace.rendering.checkpoint import Checkpoint
from raytrace.rendering.compiled_scenes import plan_of, trees_of
from raytrace.rendering.job import Job, Tiling
from raytrace.rendering.notebook import listener_of
from raytrace.rendering.options import deadline_after, error_wanted, layers_of, override, window_of
from raytrace.rendering.progress import Progress
from raytrace.rendering.result import Render
from raytrace.rendering.run import Run
from raytrace.rendering.wavefront import BATCH
from raytrace.scene.load import load

if TYPE_CHECKING:
    from distributed import Client

    from raytrace.rendering.cluster import Cluster


def render(
    scene: Scene | str | Path | dict[str, Any],
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    precision: str | None = None,
    sampler: str | None = None,
    *,
    integrator: str | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | Literal[False] | None = None,
    aov: Sequence[str] = (),
    crop: tuple[int, int, int, int] | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    max_memory: int | None = None,
    checkpoint: str | Path | Checkpoint | None = None,
    client: "Client | None" = None,
) -> Render:
    """Draw a scene.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        A loaded scene, a scene file, or its content.
    spp, size, seed, precision, sampler : optional
        Samples per pixel; film (width, height) in pixels; 0 .. 2**32 - 1; "auto", "float32" or "float64"; "sobol",
        "stratified" or "independent". Default: what the scene says.
    integrator : {"direct", "path"}, optional
        Light that comes straight from the lights, or all the light. Default: what the scene says.
    threads : int, optional
        Default: all cores of the process. The picture has the same bits for any number.
    progress : callable or False, optional
        Is called with a ``Progress`` now and then. Default: in a notebook, the picture is shown as it gets better;
        elsewhere, and where this is False, nothing is.
    aov : sequence of str
        Layers to compute and keep in files; all can be had from ``Render.aov`` later.
    crop : (x, y, width, height), pixels, optional
        Draw only this part of the film; it equals that part of the whole picture.
    time_limit : float, seconds, optional
        Stop after about so long. The image then has the samples of the last complete pass over all pixels.
    target_error : float, optional
        Sample where the error is until the estimated RMSE of the picture, in sRGB clipped to 0 .. 1, is at most this:
        0.002 is half a step of 8 bits. No pixel gets more than ``spp`` samples, 4096 where that isn't given.
    max_memory : int, bytes, optional
        What the process may take in all; a picture that takes more is refused. Default: what is free.
    checkpoint : str or Path, optional
        File that keeps finished parts while the picture is drawn. If it is there, it is gone on from, and the picture
        has the same bits as if nothing had happened. ``Render.save`` removes it once the whole picture is written.
    client : distributed.Client, optional
        Have the workers of this Dask cluster draw, instead of threads here; the same bits.

    Returns
    -------
    Render
        With ``complete`` False after Ctrl-C or the time limit: the whole image, with fewer samples per pixel, as
        ``provenance["samples"]`` says; black with 0 samples if the first pass was not complete.

    Raises
    ------
    SceneError, FileError
        As ``load`` does; and FileError for a checkpoint of another picture, or one that can't be written.
    OptionError
        An option that can't be met; the cluster has gone, or none of its workers may draw.

    Warns
    -----
    SceneWarning
        A refractive surface coincides with another surface, so that rays can miss one of them.

    Examples
    --------
    >>> import raytrace as rt
    >>> picture = rt.render("scenes/cornell-box.json", spp=4, size=(32, 32))
    >>> picture.rgb.shape, picture.complete
    ((32, 32, 3), True)
    """
    if not isinstance(scene, Scene):
        scene = load(scene, max_memory=max_memory)
    target = error_wanted(target_error)
    most = adaptive.CAP if spp is None and target is not None else spp
    settings = override(scene.settings, most, size, seed, precision, sampler, integrator=integrator)
    window = window_of(settings.size, crop)
    layers, limit, count = layers_of(aov), deadline_after(time_limit), parallel.thread_count(threads)
    plan = plan_of(scene)
    precision = plan.precision.name if settings.precision == "auto" else settings.precision
    if plan.refraction:
        from raytrace.scene.coincident import warn_coincident

        warn_coincident(scene, precision, stacklevel=2)
    job, watcher = Job(scene, settings, window, precision, target), listener_of(progress)
    check_drawing(_drawing(job, layers, count), trees_of(scene, plan, precision), max_memory)
    pixels = window.width * window.height
    early = limit < np.inf or watcher.early(pixels * job.first_spp)
    layout = Tiling(first=1 if early else None)
    keep = checkpoint if isinstance(checkpoint, Checkpoint | None) else Checkpoint(Path(checkpoint))
    cluster = None if client is None else _cluster_of(client, job, threads)
    if cluster:
        layout = cluster.layout(layout, pixels)
    if keep:
        layout = keep.begin(job) or layout
    run = Run(job, layout, keep, cluster, watcher)
    return run.run(count, limit, layers)


def _drawing(job: Job, layers: Sequence[str], threads: int) -> Drawing:
    """What the memory of a picture depends on."""
    pixels, spp = job.window.width * job.window.height, job.settings.spp
    batch = min(threads, -(-pixels * spp // BATCH)) * BATCH
    return Drawing(pixels, bool(set(layers) - {"samples"}), job.target is not None, min(spp, BINS), batch)


def _cluster_of(client: "Client", job: Job, threads: int | None) -> "Cluster":
    from raytrace.rendering.cluster import Cluster

    if threads is not None:
        raise OptionError("threads: the workers of a cluster have their own; leave it out")
    return Cluster(client, job)
