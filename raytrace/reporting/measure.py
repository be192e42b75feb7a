"""Measure configurations of the renderer: many interleaved renders within a time budget."""

import time
import tracemalloc
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import srgb8
from raytrace.limits import MAX_SEED
from raytrace.records import Scene
from raytrace.reporting.analysis import curves_of
from raytrace.reporting.configurations import Configuration, ConfiguredScene, renders_of, steps_of, weight_of
from raytrace.reporting.crops import equal_time, step_for, time_of
from raytrace.reporting.measurements import EqualTime, First, Inset, Measured, Shown
from raytrace.reporting.precision_floor import PrecisionPairs
from raytrace.reporting.reference import Reference
from raytrace.reporting.spectrum import radial_power, spectrum_of
from raytrace.reporting.task import Task, Truth

MIN_ERROR = 3.0  # times the error of the reference; smaller errors would be overestimated by 5 %, sqrt(1 + 1/9)
FIRST_SPP = 8  # samples per pixel of the first image: batches are full, so memory does not grow with more samples
SHOWN_SPP = 1, 16, 256  # samples per pixel of the images on the page
SPECTRUM_SPP = 4  # samples per pixel of the error images whose spectra are measured: a point of many renders
GROWTH = 4.0  # estimated ratio of times for the next target error: errors shrink as 1 / sqrt(time)


class Sweep:
    """Measure configurations of the renderer on a scene against a reference.

    Parameters
    ----------
    scene : Scene
    size : (width, height), pixels
    reference : Reference
    seconds : float
        Time budget, without compilation.
    progress : callable
        Called with the completed share and the number of rays traced.
    make : callable
        Returns the object that renders the scene in a configuration, with the methods of ``ConfiguredScene``.
    """

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int],
        reference: Reference,
        seconds: float,
        progress: Callable[[float, int], None],
        make: Callable[[Scene, Configuration, tuple[int, int]], Any] = ConfiguredScene,
    ) -> None:
        self.scene, self.size, self.reference, self.progress, self.make = scene, size, reference, progress, make
        self.truth = Truth(reference.rgb)
        self.end = time.perf_counter() + seconds
        self.tasks: list[Task] = []
        self.firsts: list[First] = []
        self.shown: list[Shown] = []
        self.left_out: dict[str, tuple[list[str], str]] = {}
        self.pairs = PrecisionPairs()
        self._spectra: dict[str, list[tuple[NDArray[np.float64], float]]] = {}
        self._rays, self._done, self._total = 0, 0.0, 1.0

    def run(self, configurations: Sequence[Configuration]) -> Measured:
        """Measure all configurations, as far as the time allows."""
        interrupted, equal = False, None
        self._total = sum(_work(way, step) for way in configurations for step in steps_of(way))
        try:
            scenes = [configured for configuration in configurations if (configured := self._first(configuration))]
            self._first_renders(scenes)
            for number in range(1, max((task.renders for task in self.tasks), default=0)):
                for task in self.tasks:
                    if number < task.renders:
                        self._observe(task, number, *self._render(task, number))
            equal = self._equal_time(scenes)
        except KeyboardInterrupt:
            interrupted = True
        measured = sorted(self.tasks, key=lambda task: configurations.index(task.scene.configuration))
        left_out = tuple((f"{name}: {', '.join(steps)}", why) for name, (steps, why) in self.left_out.items())
        points = tuple(task.point() for task in measured)
        spectra = tuple(spectrum_of(name, found) for name, found in self._spectra.items())
        return Measured(points, tuple(self.firsts), tuple(self.shown), self.pairs.gaps, left_out, interrupted,
                        self.pairs.floor, spectra, equal)  # fmt: skip

    # --- renders ------------------------------------------------------------------------------------------------------

    def _first(self, configuration: Configuration) -> Any:
        """Render the first image of a configuration: measures compilation and memory, and estimates the speed."""
        steps = steps_of(configuration)
        if time.perf_counter() > self.end:
            self._leave_out(configuration, steps, self._late())
            return None
        began, own = time.perf_counter(), configuration.renderer == "raytrace"
        configured = self.make(self.scene, configuration, self.size)
        step = FIRST_SPP if own and not configuration.adaptive else steps[0]
        compiling = float(_whole(configured.render(step, self._seed(0))).stats["compile_seconds"])
        warm, peak = time.perf_counter(), 0
        self.end += compiling
        if configuration.adaptive and renders_of(configuration, step) * (warm - began - compiling) > self.end - warm:
            self._leave_out(configuration, steps, self._late())
            return None
        if own:  # the memory of others is not allocated by Python, or tracing it would take very long
            tracemalloc.start()
        try:
            _whole(configured.render(step, self._seed(0)))
            peak = tracemalloc.get_traced_memory()[1] + configured.table_bytes if own else 0
        finally:
            tracemalloc.stop()
        again = (time.perf_counter() - warm) * (1 if configuration.adaptive else FIRST_SPP / step)
        self.firsts.append(First(configuration, warm - began, compiling, again, peak))
        self._report()
        return configured

    def _first_renders(self, scenes: Sequence[Any]) -> None:
        """Render each point once, by increasing samples, as long as there is time for all its renders."""
        firsts = {first.configuration: first for first in self.firsts}
        order = [
            (weight_of(s.configuration, step), i) for i, s in enumerate(scenes) for step in steps_of(s.configuration)
        ]
        steps = {s.configuration: iter(steps_of(s.configuration)) for s in scenes}
        stopped: dict[Configuration, str] = {}
        last: dict[Configuration, Task] = {}
        for _, i in sorted(order):  # all configurations with the same number of samples, one after the other
            configuration = scenes[i].configuration
            step = next(steps[configuration])
            task, before = Task(scenes[i], step, firsts[configuration].peak_bytes), last.get(configuration)
            if configuration not in stopped and self._too_long(task, before, firsts[configuration]):
                stopped[configuration] = self._late()
            if configuration not in stopped:
                image, codes = self._render(task, 0)
                if np.sqrt(task.squares[0]) < MIN_ERROR * self.reference.error:
                    stopped[configuration] = self._below_reference()
                    self._done -= weight_of(configuration, step)
            if configuration in stopped:
                self._leave_out(configuration, [step], stopped[configuration])
                continue
            last[configuration] = task
            if before and configuration.adaptive and before.comparison == task.comparison:
                self._forget(before)
            self.tasks.append(task)
            self._observe(task, 0, image, codes)

    def _too_long(self, task: Task, before: Task | None, first: First) -> bool:
        """Whether all renders of a task would end too late."""
        if before:
            grown = GROWTH if task.scene.configuration.adaptive else task.step / before.step
            forecast = grown * before.times[0] + before.judging
        else:
            forecast = first.again * (1 if task.scene.configuration.adaptive else task.step / FIRST_SPP)
        remaining = sum(other.remaining for other in self.tasks)
        return time.perf_counter() + remaining + task.renders * forecast > self.end

    def _render(self, task: Task, number: int) -> tuple[Any, NDArray[np.float64]]:
        """Render a point once; return the image and its error in sRGB codes."""
        began = time.perf_counter()
        image = _whole(task.scene.render(task.step, self._seed(number)))
        compiling = float(image.stats["compile_seconds"])  # of a kernel that no first image needed
        self.end += compiling
        codes = task.add(image, time.perf_counter() - began - compiling, self.truth)
        self._rays += task.rays
        self._done += weight_of(task.scene.configuration, task.step)
        self._report()
        return image, codes

    def _observe(self, task: Task, number: int, image: Any, codes: NDArray[np.float64]) -> None:
        """Keep what the page shows of a render: an image, its spectrum, the difference of the precisions."""
        way = task.scene.configuration
        if number == 0 and (way.adaptive or task.step in SHOWN_SPP):
            self.shown.append(Shown(task.name, srgb8(image.rgb), np.abs(codes).max(axis=2).astype(np.float32)))
        if way.adaptive or not way.standard:
            return
        if task.step == SPECTRUM_SPP and way.precision == self.tasks[0].scene.configuration.precision:
            if (
                number % 2 and task.error is not None
            ):  # the difference of two renders: what all have in common is no noise
                self._spectra.setdefault(task.name, []).append(radial_power(codes - task.error))
            task.error = codes
        if way.sampler == "sobol" and way.selectable:
            self.pairs.add(way.precision, int(task.step), number, codes + self.truth.codes)

    def _equal_time(self, scenes: Sequence[Any]) -> EqualTime | None:
        """Render an image of each sampler in the same time; None if there is no time left for it."""
        curves = curves_of(tuple(task.point() for task in self.tasks))
        seconds = time_of(next(iter(curves.values()), []))
        usual = [scene for scene in scenes if scene.configuration.standard and scene.configuration in curves]
        usual = [scene for scene in usual if scene.configuration.precision == usual[0].configuration.precision]
        if not usual or time.perf_counter() + len(usual) * seconds > self.end:
            if usual:
                self.left_out["images at equal time"] = ([f"{seconds:g} s"], self._late())
            return None
        black = np.zeros(self.truth.rgb.shape[:2], np.float32)
        insets = [Inset("reference", self.reference.spp, np.nan, 0.0, srgb8(self.truth.rgb), black)]
        for scene in usual:
            step = step_for(curves[scene.configuration], seconds)
            if step is not None:
                task, way = Task(scene, step, 0), scene.configuration
                image, codes = self._render(task, 0)
                self._done -= weight_of(scene.configuration, step)
                error = np.abs(codes).max(axis=2).astype(np.float32)
                found = task.point()
                insets.append(
                    Inset(
                        task.name if way.adaptive else way.name,
                        found.spp,
                        found.seconds,
                        found.rmse_srgb,
                        srgb8(image.rgb),
                        error,
                    )
                )
        return equal_time(seconds, insets) if len(insets) > 1 else None

    # --- time ---------------------------------------------------------------------------------------------------------

    def _forget(self, task: Task) -> None:
        """Remove a target error if the next smaller one gave the same image: both are reached with it."""
        self.tasks.remove(task)
        self.shown = [shown for shown in self.shown if shown.name != task.name]
        self._done += _work(task.scene.configuration, task.step) - weight_of(task.scene.configuration, task.step)

    def _seed(self, number: int) -> int:
        """Seed of a render: the same for all configurations, so that equal samples give equal noise."""
        return (self.scene.settings.seed + number) % (MAX_SEED + 1)

    def _report(self) -> None:
        self.progress(min(self._done / self._total, 1.0), self._rays)

    def _leave_out(self, configuration: Configuration, steps: Sequence[float], why: str) -> None:
        unit = "target error " if configuration.adaptive else ""
        texts = [f"{unit}{step:g}{'' if configuration.adaptive else ' spp'}" for step in steps]
        self.left_out.setdefault(configuration.name, ([], why))[0].extend(texts)
        self._done += sum(_work(configuration, step) for step in steps)

    def _late(self) -> str:
        return "no time left; use a larger budget"

    def _below_reference(self) -> str:
        off = f"{self.reference.error:.1e}"
        return f"error too close to that of the reference, {off}; a larger budget gives a better reference"


def _work(configuration: Configuration, step: float) -> float:
    return renders_of(configuration, step) * weight_of(configuration, step)


def _whole(image: Any) -> Any:
    if image.interrupted:
        raise KeyboardInterrupt
    return image
