"""Measure configurations of the renderer: several interleaved repetitions within a time budget."""

import time
import tracemalloc
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.image import flip
from raytrace.image.files import srgb8
from raytrace.image.metrics import Comparison, compare, screen
from raytrace.limits import MAX_SEED
from raytrace.records import Scene
from raytrace.rendering.result import Render
from raytrace.reporting.configurations import Configuration, ConfiguredScene, steps_of, weight_of
from raytrace.reporting.measurements import First, Measured, Point, Shown
from raytrace.reporting.reference import Reference

REPETITIONS = 3  # repetitions of each point, each with its own seed; one repetition covers all points
MIN_ERROR = 3.0  # times the error of the reference; smaller errors would be overestimated by 5 %, sqrt(1 + 1/9)
FIRST_SPP = 8  # samples per pixel of the first image: batches are full, so memory does not grow with more samples
SHOWN_SPP = 1, 16, 256  # samples per pixel of the images on the page
GROWTH = 4.0  # estimated ratio of times for the next target error: errors shrink as 1 / sqrt(time)


class _Task:
    """One point during measurement."""

    def __init__(self, scene: ConfiguredScene, step: float, peak: int) -> None:
        self.scene, self.step, self.peak = scene, step, peak
        self.times: list[float] = []
        self.whole: list[float] = []  # s: including the comparison
        self.errors: list[Comparison] = []
        self.rays, self.spp = 0, 0.0
        self.flip: float | None = None

    def point(self) -> Point:
        """Combine the repetitions."""
        squares = np.mean([[e.rmse**2, e.rmse_srgb**2] for e in self.errors], axis=0)
        bias = np.mean([e.bias for e in self.errors], axis=0)
        return Point(
            configuration=self.scene.configuration,
            step=self.step,
            spp=self.spp,
            times=tuple(self.times),
            rays=self.rays,
            peak_bytes=self.peak,
            rmse=float(np.sqrt(squares[0])),
            rmse_srgb=float(np.sqrt(squares[1])),
            relative_mse=float(np.mean([e.relative_mse for e in self.errors])),
            bias=(float(bias[0]), float(bias[1]), float(bias[2])),
            worst_tile=max(e.worst_tile for e in self.errors),
            ssim=float(np.mean([e.ssim for e in self.errors])),
            mrse=float(np.mean([e.mrse for e in self.errors])),
            flip=self.flip,
        )


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
        self.end = time.perf_counter() + seconds
        self.tasks: list[_Task] = []
        self.firsts: list[First] = []
        self.shown: list[Shown] = []
        self.left_out: dict[str, tuple[list[str], str]] = {}
        self.gaps: dict[int, float] = {}
        self._unpaired: dict[int, NDArray[np.float32]] = {}
        self._rays, self._done, self._total = 0, 0.0, 1.0

    def run(self, configurations: Sequence[Configuration]) -> Measured:
        """Measure all configurations, as far as the time allows."""
        interrupted = False
        self._total = REPETITIONS * sum(
            weight_of(configuration, step) for configuration in configurations for step in steps_of(configuration)
        )
        try:
            scenes = [configured for configuration in configurations if (configured := self._first(configuration))]
            self._first_repetition(scenes)
            for number in range(1, REPETITIONS):
                for task in self.tasks:
                    self._render(task, number)
        except KeyboardInterrupt:
            interrupted = True
        measured = sorted(
            (task for task in self.tasks if task.errors),
            key=lambda task: configurations.index(task.scene.configuration),
        )
        points = tuple(task.point() for task in measured)
        left_out = tuple((f"{name}: {', '.join(steps)}", why) for name, (steps, why) in self.left_out.items())
        return Measured(points, tuple(self.firsts), tuple(self.shown), self.gaps, left_out, interrupted)

    # --- renders ------------------------------------------------------------------------------------------------------

    def _first(self, configuration: Configuration) -> ConfiguredScene | None:
        """Render the first image of a configuration: measures compilation and memory, and estimates the speed."""
        if time.perf_counter() > self.end:
            self._leave_out(configuration, steps_of(configuration), self._late())
            return None
        began = time.perf_counter()
        configured: ConfiguredScene = self.make(self.scene, configuration, self.size)
        step = steps_of(configuration)[0] if configuration.adaptive else FIRST_SPP
        compiling = float(_whole(configured.render(step, self._seed(0))).stats["compile_seconds"])
        warm = time.perf_counter()
        self.end += compiling
        tracemalloc.start()
        try:
            _whole(configured.render(step, self._seed(0)))
            peak = tracemalloc.get_traced_memory()[1] + configured.table_bytes
        finally:
            tracemalloc.stop()
        self.firsts.append(First(configuration, warm - began, compiling, time.perf_counter() - warm, peak))
        self._report()
        return configured

    def _first_repetition(self, scenes: Sequence[ConfiguredScene]) -> None:
        """Render each point once, by increasing samples, as long as there is time for all its repetitions."""
        peaks = {first.configuration: first.peak_bytes for first in self.firsts}
        rates = {first.configuration: first.again / FIRST_SPP for first in self.firsts}
        order = [
            (weight_of(s.configuration, step), i) for i, s in enumerate(scenes) for step in steps_of(s.configuration)
        ]
        steps = {s.configuration: iter(steps_of(s.configuration)) for s in scenes}
        stopped: dict[Configuration, str] = {}
        last: dict[Configuration, _Task] = {}
        for _, i in sorted(order):  # all configurations with the same number of samples, one after the other
            configured, configuration = scenes[i], scenes[i].configuration
            step = next(steps[configuration])
            if configuration in last:
                grown = GROWTH if configuration.adaptive else step / last[configuration].step
                forecast = (
                    grown * last[configuration].times[0] + last[configuration].whole[0] - last[configuration].times[0]
                )
            else:
                forecast = rates[configuration] * (FIRST_SPP if configuration.adaptive else step)
            if (
                configuration not in stopped
                and time.perf_counter() + self._remaining() + REPETITIONS * forecast > self.end
            ):
                stopped[configuration] = self._late()
            if configuration in stopped:
                self._leave_out(configuration, [step], stopped[configuration])
                continue
            before = last.get(configuration)
            last[configuration] = task = _Task(configured, step, peaks[configuration])
            self._render(task, 0)
            if task.errors[0].rmse_srgb < MIN_ERROR * self.reference.error:
                stopped[configuration] = self._below_reference()
                self._done -= weight_of(configuration, step)
                self._leave_out(configuration, [step], stopped[configuration])
                continue
            if configuration.adaptive and before and before.errors == task.errors:
                self._forget(before)
            self.tasks.append(task)

    def _render(self, task: _Task, number: int) -> None:
        began = time.perf_counter()
        image = _whole(task.scene.render(task.step, self._seed(number)))
        compiling = float(image.stats["compile_seconds"])  # of a kernel that no first image needed
        self.end += compiling
        task.times.append(time.perf_counter() - began - compiling)
        task.errors.append(compare(image, self.reference.rgb, flip=False))
        task.rays = sum(image.stats["rays"].values())
        task.spp = image.stats["samples"] / image.stderr.size
        if number == 0:
            task.flip = flip.flip(image.rgb, self.reference.rgb) if flip.available() else None
            self._show(task, image)
            self._pair(task, image)
        task.whole.append(time.perf_counter() - began - compiling)
        self._rays += task.rays
        self._done += weight_of(task.scene.configuration, task.step)
        self._report()

    def _show(self, task: _Task, image: Render) -> None:
        configuration = task.scene.configuration
        if configuration.adaptive or task.step in SHOWN_SPP:
            error = np.abs(screen(image.rgb) - screen(self.reference.rgb)).max(axis=2)
            self.shown.append(Shown(_name(task), srgb8(image.rgb), error.astype(np.float32)))

    def _forget(self, task: _Task) -> None:
        """Remove a target error if the next smaller one gave the same image: both are reached with it."""
        self.tasks.remove(task)
        self.shown = [shown for shown in self.shown if shown.name != _name(task)]
        self._done += (REPETITIONS - 1) * weight_of(task.scene.configuration, task.step)

    def _pair(self, task: _Task, image: Render) -> None:
        """Compare the two precisions where they have the same samples."""
        configuration, spp = task.scene.configuration, int(task.step)
        if configuration.sampler == "sobol" and configuration.selectable and not configuration.adaptive:
            other = self._unpaired.pop(spp, None)
            if other is None:
                self._unpaired[spp] = image.rgb
            else:
                self.gaps[spp] = float(np.sqrt(np.mean((screen(other) - screen(image.rgb)) ** 2)))

    # --- time ---------------------------------------------------------------------------------------------------------

    def _remaining(self) -> float:
        """Estimated seconds for the remaining repetitions of the points measured so far."""
        return sum((REPETITIONS - 1) * task.whole[0] for task in self.tasks)

    def _seed(self, number: int) -> int:
        return (self.scene.settings.seed + number) % (MAX_SEED + 1)

    def _report(self) -> None:
        self.progress(self._done / self._total, self._rays)

    def _leave_out(self, configuration: Configuration, steps: Sequence[float], why: str) -> None:
        unit = "target error " if configuration.adaptive else ""
        texts = [f"{unit}{step:g}{'' if configuration.adaptive else ' spp'}" for step in steps]
        self.left_out.setdefault(configuration.name, ([], why))[0].extend(texts)
        self._done += REPETITIONS * sum(weight_of(configuration, step) for step in steps)

    def _late(self) -> str:
        return "no time left; use a larger budget"

    def _below_reference(self) -> str:
        off = f"{self.reference.error:.1e}"
        return f"error too close to that of the reference, {off}; a larger budget gives a better reference"


def _name(task: _Task) -> str:
    configuration = task.scene.configuration
    return f"{configuration.name}, " + (
        f"target error {task.step:g}" if configuration.adaptive else f"{task.step:g} spp"
    )


def _whole(image: Render) -> Render:
    if image.interrupted:
        raise KeyboardInterrupt
    return image
