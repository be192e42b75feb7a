"""What a render would do: image, samples, rays and memory, without rendering it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from raytrace import parallel
from raytrace.limits import LIGHT_LAYERS
from raytrace.memory import Allowance, check_render
from raytrace.memory import size as bytes_of
from raytrace.records import Scene, Settings, Window
from raytrace.rendering import adaptive
from raytrace.rendering.compiled_scene import trees_of
from raytrace.rendering.job import Job
from raytrace.rendering.rendering import (
    layers_of,
    light_of,
    memory_of,
    override,
    seconds_of,
    target_of,
    window_of,
)
from raytrace.scene.other_camera import in_view
from raytrace.scene.plan import Plan, make_plan

LAYERS_ROW = "layers (AOVs)"  # of what a plan leaves out


class Forecast(NamedTuple):
    """What a render of a scene would do; as text, if it is converted to one."""

    plan: Plan  # with these options
    rows: tuple[tuple[str, str], ...]  # name and text

    def __str__(self) -> str:
        width = max(len(name) for name, _ in self.rows)
        return "\n".join([str(self.plan), "render", *(f"  {name:<{width}}  {text}" for name, text in self.rows)])


def forecast(
    scene: Scene,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    precision: str | None = None,
    sampler: str | None = None,
    *,
    integrator: str | None = None,
    threads: int | None = None,
    aov: Sequence[str] = (),
    crop: tuple[int, int, int, int] | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    max_memory: int | None = None,
) -> Forecast:
    """Say what ``render`` would do with these options.

    Parameters
    ----------
    scene : Scene
        The other parameters are those of ``render``.

    Returns
    -------
    Forecast

    Raises
    ------
    SceneError, OptionError
        As ``render`` does, also where there is not enough memory.

    Examples
    --------
    >>> import raytrace as rt
    >>> found = forecast(rt.load("scenes/cornell-box.json"), spp=4, size=(64, 48), crop=(0, 0, 8, 8), threads=1)
    >>> dict(found.rows)["samples"]
    '4 per pixel (sobol, seed 0): 256 in all'
    """
    target = target_of(target_error)
    most = adaptive.CAP if spp is None and target is not None else spp
    settings = override(scene.settings, most, size, seed, precision, sampler, integrator=integrator)
    window, limit, count = window_of(settings.size, crop), seconds_of(time_limit), parallel.thread_count(threads)
    layers = layers_of(aov)
    light = light_of(layers, settings.integrator)
    scene = replace(in_view(scene, settings.size), settings=settings)
    plan = _plan(scene, precision, layers)
    first = settings.spp if target is None else min(adaptive.FIRST, settings.spp)
    job = Job(scene, plan, settings, window, plan.precision.name, target, first, light)
    need = memory_of(job, layers, count)
    trees = trees_of(scene, plan, job.precision, plan.paths)
    check_render(need, trees, max_memory)
    rows = [("image", _image(settings, window)), ("samples", _samples(job)), ("rays", _rays(job))]
    if limit < math.inf:
        rows.append(("ends", f"after {limit:g} s, with the samples so far"))
    if asked := ", ".join(name for name in layers if name not in LIGHT_LAYERS):
        rows.append(("layers", f"{asked}: along one ray through the centre of each pixel"))
    if light:
        rows.append(("light", "the samples' emission, direct and indirect light, each kept by itself"))
    rows.append(("threads", f"{count}"))
    left = max(Allowance(max_memory).left, 0.0)
    rows.append(("memory", f"about {bytes_of(need.total(trees))}; {bytes_of(left)} may be used"))
    return Forecast(plan, tuple(rows))


def _plan(scene: Scene, asked: str | None, layers: Sequence[str]) -> Plan:
    """Return the plan of a scene, in a precision that the user asked for or that of the scene, and with layers."""
    plan = make_plan(scene)
    if asked not in (None, "auto"):
        plan = replace(plan, precision=plan.precision._replace(why="as asked"))
    if layers:
        plan = replace(plan, left_out=tuple(row for row in plan.left_out if row[0] != LAYERS_ROW))
    return plan


def _image(settings: Settings, window: Window) -> str:
    width, height = settings.size
    if (window.width, window.height) == (width, height):
        return f"{width} x {height} pixels"
    place = f"from column {window.x} and row {window.y}"
    return f"{window.width} x {window.height} pixels of {width} x {height}, {place}"


def _samples(job: Job) -> str:
    """Samples per pixel, and in all."""
    settings, pixels = job.settings, job.window.width * job.window.height
    how = f"({settings.sampler}, seed {settings.seed})"
    if job.target is None:
        return f"{settings.spp:,} per pixel {how}: {pixels * settings.spp:,} in all"
    until = f"until the estimated RMSE (sRGB) is at most {job.target:g}"
    return f"{job.first_spp} per pixel {how}, then more where the error is, up to {settings.spp:,}, {until}"


def _rays(job: Job) -> str:
    """Bounds on the rays of all kinds."""
    scene, plan, settings = job.scene, job.plan, job.settings
    samples = job.window.width * job.window.height * settings.spp
    if plan.paths:
        from raytrace.scene.path_costs import most_rays

        most = most_rays(scene)
        kinds = {"camera": 1.0, "onward": most.closest - 1, "shadow": most.shadow}
        on_average = " on average"
    else:
        kinds = {"camera": 1.0, "refraction": float(settings.max_depth * plan.refraction), "shadow": float(plan.lights)}
        on_average = ""
    parts = [f"{_short(number * samples)} {kind}" for kind, number in kinds.items() if number > 0]
    return f"at most {_short(sum(kinds.values()) * samples)}{on_average}: {', '.join(parts)}"


def _short(number: float) -> str:
    """A number of rays, with three digits.

    >>> _short(4718592.0), _short(900.0)
    ('4.72 M', '900')
    """
    for factor, letter in ((1e12, " T"), (1e9, " G"), (1e6, " M"), (1e3, " k")):
        if number >= factor:
            return f"{number / factor:.3g}{letter}"
    return f"{number:.0f}"
