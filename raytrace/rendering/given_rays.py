"""``radiance``: light along given rays, by the passes of path tracing, without a camera."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace import parallel
from raytrace.accel.lanes import PACKET
from raytrace.errors import OptionError
from raytrace.jit import load_all
from raytrace.limits import MAX_DEPTH
from raytrace.memory import check_radiance
from raytrace.passes.camera import camera_rays, make_view
from raytrace.passes.estimate import errors
from raytrace.passes.film import accumulate, develop
from raytrace.passes.lens import lens_rays
from raytrace.passes.paths import begin_paths
from raytrace.passes.sampling import make_sampler
from raytrace.records import Columns, Scene
from raytrace.rendering.compiled_scene import compiled_of, path_scene_of, plan_of, trees_of
from raytrace.rendering.path_scene import PathScene
from raytrace.rendering.path_wavefront import PathWavefront
from raytrace.rendering.rendering import override, within
from raytrace.rendering.wavefront import BATCH
from raytrace.scene.load import load

F8 = NDArray[np.float64]
BATCHES = 16  # independent batches of samples per ray: their means give the standard error
MOST_RAYS = 2**31
UNUSED = camera_rays, lens_rays, accumulate, errors, develop  # kernels of a camera and its film


class Probe(NamedTuple):
    """What is measured: rays, and how they are sampled."""

    paths: PathScene
    view: Any  # of the scene's camera; only its precision counts
    sampler: Any
    origins: NDArray[np.floating]  # (n, 3)
    directions: NDArray[np.floating]  # (n, 3): unit
    batches: int  # of each ray
    samples: int  # of each batch


class RayWavefront(PathWavefront):
    """The passes of path tracing for rays that are given; a "pixel" is a batch of samples of one ray."""

    probe: Probe

    def add_rays(self, x: NDArray[np.uint32], y: NDArray[np.uint32], first: int, last: int) -> F8:
        """Trace samples ``first`` .. ``last - 1`` of batches y of rays x; return their sums, (3, m)."""
        m, count, rays = len(x), last - first, self.paths.rays
        for whole, part in ((self.probe.origins, rays.o), (self.probe.directions, rays.d)):
            columns = part.reshape(3, self._rows)[:, : count * m].reshape(3, count, m)
            columns[:] = whole[x].T[:, None, :]
        self._clock = 0.0
        begin_paths(self.sampler.seed, x, y, np.array([first, last]), self.paths, self.radiance)
        self._trace(self.n)
        light = self.radiance.reshape(3, self._rows)[:, : count * m].reshape(3, count, m)
        return light.sum(axis=1, dtype=np.float64)

    def _origins(self, here: Any) -> Columns:
        return self._columns(here.rays.o)


def radiance(
    scene: Scene | str | Path | dict[str, Any],
    origins: ArrayLike,
    directions: ArrayLike,
    spp: int | None = None,
    *,
    integrator: str | None = None,
    max_depth: int | None = None,
    seed: int | None = None,
    precision: str | None = None,
    sampler: str | None = None,
    threads: int | None = None,
) -> tuple[F8, F8]:
    """Return the radiance that arrives along rays, and its standard error.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        As for ``render``; its camera does not matter.
    origins, directions : (..., 3) array-like
        Where light is measured, world units, and the directions that are looked into, of any length but 0. The shapes
        broadcast without the last axis. Surfaces at an origin itself are not seen.
    spp : int, optional
        Samples per ray. Above 16 it is rounded up so that all batches have equally many. Default: what the scene says.
    integrator : {"direct", "path"}, optional
        Default: what the scene says.
    max_depth : int, optional
        The most surfaces at which a path scatters or passes. Default: what the scene says.
    seed, precision, sampler : optional
        As for ``render``. "auto" is the precision that the scene needs; origins are rounded to it.
    threads : int, optional
        Number of threads. Default: one per core. The result is bit-identical for any number.

    Returns
    -------
    radiance : (..., 3) float64 array
        W / (sr m2), as a pinhole camera at the origin would see it: an estimate without bias.
    stderr : (..., 3) float64 array
        Its standard error, from the means of at most 16 independent batches; NaN for one sample. Where all samples of
        a ray are equal it is 0.

    Raises
    ------
    SceneError, FileError
        As ``load`` does.
    OptionError
        An option has a value that is not allowed; shapes do not broadcast; a ray is not finite, or has no direction;
        there is not enough memory for the rays, which is known before any is traced.

    Notes
    -----
    Each batch has random numbers of its own, functions of the seed, the number of the ray (in C order) and that of the
    batch. So errors of rays and batches are independent. Divided by its standard error, an error follows
    Student's distribution with one degree of freedom less than there are batches, where batches are nearly normal.
    Error bars of single rays miss light that none of the samples found.

    Examples
    --------
    The irradiance under an even sky of radiance 0.5, from 400 directions in proportion to the cosine: 0.5 pi.

    >>> import numpy as np, raytrace as rt
    >>> sky = {"camera": {"position": [0, 0, 1], "look_at": [0, 0, 0], "fov": 40},
    ...        "lights": [{"type": "environment", "radiance": [0.5, 0.5, 0.5]}],
    ...        "materials": {"m": {"type": "diffuse", "albedo": [0.5, 0.5, 0.5]}},
    ...        "objects": [{"box": {}, "material": "m"}]}
    >>> u, v = np.random.default_rng(0).random((2, 400))
    >>> d = np.stack([u**0.5 * np.cos(2 * np.pi * v), u**0.5 * np.sin(2 * np.pi * v), (1 - u) ** 0.5], axis=1)
    >>> light, stderr = rt.radiance(sky, [0, 0, 2], d, spp=1, integrator="path")
    >>> light.shape, (np.pi * light.mean(axis=0)).round(6)
    ((400, 3), array([1.570796, 1.570796, 1.570796]))
    """
    if not isinstance(scene, Scene):
        scene = load(scene)
    settings = override(scene.settings, spp, None, seed, precision, sampler, integrator=integrator)
    shape, given = _shape_of(origins, directions)
    count = parallel.thread_count(threads)
    plan = plan_of(scene)
    kind = plan.precision.name if settings.precision == "auto" else settings.precision
    check_radiance(
        math.prod(shape[:-1]),
        _batch(math.prod(shape[:-1]), settings.spp, count),
        trees_of(scene, plan, kind, paths=True),
    )
    starts, ways = _rays_of(shape, given)
    paths = path_scene_of(scene, compiled_of(scene, plan, kind), settings.integrator)
    if max_depth is not None:
        paths = paths._replace(max_depth=within("max_depth", max_depth, 1, MAX_DEPTH))
    samples = -(-settings.spp // BATCHES)
    batches = -(-settings.spp // samples)
    dtype = np.dtype(kind)
    probe = Probe(
        paths,
        make_view(scene.camera, settings.size, dtype),
        make_sampler(settings.sampler, settings.seed, samples),
        _rounded(starts, dtype),
        _rounded(ways, dtype),
        batches,
        samples,
    )
    mean, stderr = _measure(probe, count)
    return mean.reshape(shape), stderr.reshape(shape)


def _shape_of(origins: ArrayLike, directions: ArrayLike) -> tuple[tuple[int, ...], list[F8]]:
    """Shape that origins and directions broadcast to, with the axis of 3, and both as arrays."""
    given = []
    for name, rows in (("origins", origins), ("directions", directions)):
        try:
            array = np.asarray(rows, np.float64)
        except (TypeError, ValueError) as error:
            raise OptionError(f"{name}: expected numbers: {error}") from None
        if array.ndim < 1 or array.shape[-1] != 3:
            raise OptionError(f"{name}: expected (..., 3), got shape {array.shape}")
        given.append(array)
    try:
        shape = np.broadcast_shapes(given[0].shape, given[1].shape)
    except ValueError:
        text = f"the shapes {given[0].shape} and {given[1].shape} do not broadcast"
        raise OptionError(f"origins, directions: {text}") from None
    if (rays := math.prod(shape[:-1])) >= MOST_RAYS:
        raise OptionError(f"origins: {rays:,} rays; at most {MOST_RAYS:,}: divide them")
    return shape if len(shape) > 1 else (1, *shape), given


def _rays_of(shape: tuple[int, ...], given: list[F8]) -> tuple[F8, F8]:
    """Origins and unit directions, (n, 3), checked."""
    o, d = (np.broadcast_to(array, shape).reshape(-1, 3) for array in given)
    size = np.abs(d).max(axis=1, initial=0)
    for name, good in (("origins", np.isfinite(o).all(axis=1)), ("directions", np.isfinite(size) & (size > 0))):
        if not good.all():
            row = int(np.argmin(good))
            wanted = "finite numbers" if name == "origins" else "finite numbers that are not all 0"
            raise OptionError(f"{name}: ray {row}: expected {wanted}, got {(o if name == 'origins' else d)[row]}")
    scaled = d / size[:, None]  # first by the largest component, so that no square leaves the range
    return o, scaled / np.linalg.norm(scaled, axis=1, keepdims=True)


def _batch(rays: int, spp: int, threads: int) -> int:
    """Samples in flight, on all threads."""
    return min(threads, -(-rays * spp // BATCH)) * BATCH


def _rounded(rows: F8, dtype: np.dtype) -> NDArray[np.floating]:
    """Rows in a precision that they fit into."""
    with np.errstate(over="ignore"):
        rounded = rows.astype(dtype)
    if not np.isfinite(rounded).all():
        raise OptionError(f"origins: {dtype} can't represent them; use precision='float64'")
    return rounded


def _measure(probe: Probe, threads: int) -> tuple[F8, F8]:
    """Radiance and standard error of all rays, group after group on threads."""
    n = len(probe.origins)
    mean, stderr = np.empty((2, n, 3))
    if n == 0:
        return mean, stderr
    from raytrace.rendering.kernels import tracing

    # in this thread, which can be interrupted
    load_all(call for call in tracing(_front(probe, PACKET)) if call[0] not in UNUSED)
    own = threading.local()
    size = max(1, BATCH // (probe.batches * probe.samples))

    def measure(first: int) -> None:
        front = getattr(own, "front", None)
        if front is None:
            front = own.front = _front(probe, BATCH)
        group = np.arange(first, min(first + size, n))
        means = _means(front, group)
        mean[group] = means.mean(axis=0)
        if probe.batches > 1:
            stderr[group] = np.sqrt(means.var(axis=0, ddof=1) / probe.batches)
        else:
            stderr[group] = np.nan

    parallel.run(measure, range(0, n, size), min(threads, -(-n // size)))
    return mean, stderr


def _front(probe: Probe, most: int) -> RayWavefront:
    front = RayWavefront(probe.paths, probe.view, probe.sampler, most)
    front.probe = probe
    return front


def _means(front: RayWavefront, group: NDArray[np.int64]) -> F8:
    """Means of the batches of rays, (batches, rays, 3)."""
    probe, m = front.probe, len(group)
    x = np.tile(group, probe.batches).astype(np.uint32)
    y = np.repeat(np.arange(probe.batches, dtype=np.uint32), m)
    pad = -len(x) % PACKET
    x, y = np.append(x, np.full(pad, x[-1])), np.append(y, np.full(pad, y[-1]))
    step = max(1, BATCH // len(x))
    sums = np.zeros((3, len(x)))
    for first in range(0, probe.samples, step):
        last = min(first + step, probe.samples)
        if front.n != (last - first) * len(x):
            front.resize((last - first) * len(x))
        sums += front.add_rays(x, y, first, last)
    return (sums[:, : m * probe.batches] / probe.samples).reshape(3, probe.batches, m).transpose(1, 2, 0)
