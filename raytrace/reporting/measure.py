"""Measuring configurations of drawing: several rounds, interleaved, within a time."""

import time
import tracemalloc
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.image.files import srgb8
from raytrace.image.metrics import Comparison, compare, screen
from raytrace.limits import MAX_SEED
from raytrace.records import Scene
from raytrace.rendering.result import Render
from raytrace.reporting.configurations import Configuration, ConfiguredScene, steps_of, weight_of
from raytrace.reporting.reference import Reference

ROUNDS = 3  # pictures of each point, each with a seed of its own, one after the other in rounds over all points
JUDGED = 3.0  # times the reference's own error: smaller ones would be overstated by more than sqrt(1 + 1/9), 5 %
FIRST_SPP = 8  # of the first picture in a configuration: from here on batches are full, and memory grows no more
SHOWN_SPP = 1, 16, 256  # samples per pixel of the pictures that are kept to be looked at
GROWTH = 4.0  # how much longer adaptive sampling may take to the next target: errors that shrink as 1 / sqrt(time)


class Point(NamedTuple):
    """One configuration at one number of samples; errors are means over the rounds."""

    configuration: Configuration
    step: float  # samples per pixel, or the error that adaptive sampling aimed at
    spp: float  # samples per pixel, mean over the film
    times: tuple[float, ...]  # s, of each round
    rays: int  # of all kinds, of one picture
    peak_bytes: int  # most memory allocated while drawing, with the tree
    rmse: float  # as in `Comparison`, root of the mean of the squares
    rmse_srgb: float
    relative_mse: float
    bias: tuple[float, float, float]
    worst_tile: float  # the worst of all rounds
    ssim: float

    @property
    def seconds(self) -> float:
        """Time of a picture: the least of all rounds, for what else runs on the machine can only add to it."""
        return min(self.times)

    @property
    def rays_per_second(self) -> float:
        """Rays of all kinds, per second."""
        return self.rays / self.seconds

    @property
    def efficiency(self) -> float:
        """1 / (MSE x seconds), with the MSE on a screen: what a second is worth."""
        return 1.0 / (self.rmse_srgb**2 * self.seconds) if self.rmse_srgb else float("inf")


class First(NamedTuple):
    """The first picture in a configuration: with compilation or its cache, and the tree."""

    configuration: Configuration
    seconds: float
    compile_seconds: float
    again: float  # s: the same picture once more
    peak_bytes: int  # most memory allocated by then, with the tree


class Shown(NamedTuple):
    """A picture to be looked at."""

    name: str
    rgb8: NDArray[np.uint8]  # (h, w, 3) sRGB
    error: NDArray[np.float32] | None  # (h, w): largest difference of a channel, on a screen; None: the reference


class Measured(NamedTuple):
    """What was found."""

    points: tuple[Point, ...]
    firsts: tuple[First, ...]
    shown: tuple[Shown, ...]
    gaps: dict[int, float]  # spp -> RMSE on a screen between the two precisions, of the same samples
    left_out: tuple[tuple[str, str], ...]  # what, and why
    interrupted: bool


class _Task:
    """One point while it is measured."""

    def __init__(self, subject: ConfiguredScene, step: float, peak: int) -> None:
        self.subject, self.step, self.peak = subject, step, peak
        self.times: list[float] = []
        self.whole: list[float] = []  # s: with the comparison
        self.errors: list[Comparison] = []
        self.rays, self.spp = 0, 0.0

    def point(self) -> Point:
        """Put the rounds together."""
        squares = np.mean([[e.rmse**2, e.rmse_srgb**2] for e in self.errors], axis=0)
        bias = np.mean([e.bias for e in self.errors], axis=0)
        return Point(
            configuration=self.subject.configuration,
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
        )


class Sweep:
    """Measures configurations of drawing a scene against a reference.

    Parameters
    ----------
    scene : Scene
    size : (width, height), pixels
    reference : Reference
    seconds : float
        To measure in; compilation doesn't count.
    progress : callable
        Is told the share that is done and the rays traced.
    make : callable
        Gives what draws the scene in a configuration, with the methods of ``ConfiguredScene``.
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
        self._twins: dict[int, NDArray[np.float32]] = {}
        self._rays, self._done, self._total = 0, 0.0, 1.0

    def run(self, configurations: Sequence[Configuration]) -> Measured:
        """Measure what there is time for."""
        interrupted = False
        self._total = ROUNDS * sum(
            weight_of(configuration, step) for configuration in configurations for step in steps_of(configuration)
        )
        try:
            subjects = [subject for configuration in configurations if (subject := self._first(configuration))]
            self._first_round(subjects)
            for number in range(1, ROUNDS):
                for task in self.tasks:
                    self._draw(task, number)
        except KeyboardInterrupt:
            interrupted = True
        measured = sorted(
            (task for task in self.tasks if task.errors),
            key=lambda task: configurations.index(task.subject.configuration),
        )
        points = tuple(task.point() for task in measured)
        left_out = tuple((f"{name}: {', '.join(steps)}", why) for name, (steps, why) in self.left_out.items())
        return Measured(points, tuple(self.firsts), tuple(self.shown), self.gaps, left_out, interrupted)

    # --- parts --------------------------------------------------------------------------------------------------------

    def _first(self, configuration: Configuration) -> ConfiguredScene | None:
        """Draw a configuration's first picture: what it compiles and allocates is seen here, and its speed guessed."""
        if time.perf_counter() > self.end:
            self._leave_out(configuration, steps_of(configuration), self._late())
            return None
        began = time.perf_counter()
        subject: ConfiguredScene = self.make(self.scene, configuration, self.size)
        step = steps_of(configuration)[0] if configuration.adaptive else FIRST_SPP
        compiling = float(_whole(subject.draw(step, self._seed(0))).stats["compile_seconds"])
        warm = time.perf_counter()
        self.end += compiling
        tracemalloc.start()
        try:
            _whole(subject.draw(step, self._seed(0)))
            peak = tracemalloc.get_traced_memory()[1] + subject.table_bytes
        finally:
            tracemalloc.stop()
        self.firsts.append(First(configuration, warm - began, compiling, time.perf_counter() - warm, peak))
        self._tell()
        return subject

    def _first_round(self, subjects: Sequence[ConfiguredScene]) -> None:
        """Draw each point once, from few samples to many, as long as there is time for all its rounds."""
        peaks = {first.configuration: first.peak_bytes for first in self.firsts}
        rates = {first.configuration: first.again / FIRST_SPP for first in self.firsts}
        order = [
            (weight_of(s.configuration, step), i) for i, s in enumerate(subjects) for step in steps_of(s.configuration)
        ]
        steps = {s.configuration: iter(steps_of(s.configuration)) for s in subjects}
        closed: dict[Configuration, str] = {}
        last: dict[Configuration, _Task] = {}
        for _, i in sorted(order):  # the same number of samples in all configurations one after the other
            subject, configuration = subjects[i], subjects[i].configuration
            step = next(steps[configuration])
            if configuration in last:
                grown = GROWTH if configuration.adaptive else step / last[configuration].step
                forecast = (
                    grown * last[configuration].times[0] + last[configuration].whole[0] - last[configuration].times[0]
                )
            else:
                forecast = rates[configuration] * (FIRST_SPP if configuration.adaptive else step)
            if configuration not in closed and time.perf_counter() + self._owed() + ROUNDS * forecast > self.end:
                closed[configuration] = self._late()
            if configuration in closed:
                self._leave_out(configuration, [step], closed[configuration])
                continue
            before = last.get(configuration)
            last[configuration] = task = _Task(subject, step, peaks[configuration])
            self._draw(task, 0)
            if task.errors[0].rmse_srgb < JUDGED * self.reference.error:
                closed[configuration] = self._unjudged()
                self._done -= weight_of(configuration, step)
                self._leave_out(configuration, [step], closed[configuration])
                continue
            if configuration.adaptive and before and before.errors == task.errors:
                self._forget(before)
            self.tasks.append(task)

    def _draw(self, task: _Task, number: int) -> None:
        began = time.perf_counter()
        image = _whole(task.subject.draw(task.step, self._seed(number)))
        compiling = float(image.stats["compile_seconds"])  # of a kernel that no first picture needed
        self.end += compiling
        task.times.append(time.perf_counter() - began - compiling)
        task.errors.append(compare(image, self.reference.rgb))
        task.rays = sum(image.stats["rays"].values())
        task.spp = image.stats["samples"] / image.stderr.size
        if number == 0:
            self._show(task, image)
            self._pair(task, image)
        task.whole.append(time.perf_counter() - began - compiling)
        self._rays += task.rays
        self._done += weight_of(task.subject.configuration, task.step)
        self._tell()

    def _show(self, task: _Task, image: Render) -> None:
        configuration = task.subject.configuration
        if configuration.adaptive or task.step in SHOWN_SPP:
            error = np.abs(screen(image.rgb) - screen(self.reference.rgb)).max(axis=2)
            self.shown.append(Shown(_name(task), srgb8(image.rgb), error.astype(np.float32)))

    def _forget(self, task: _Task) -> None:
        """Drop an error that was aimed at where a smaller one gave the same picture: both are met at once."""
        self.tasks.remove(task)
        self.shown = [shown for shown in self.shown if shown.name != _name(task)]
        self._done += (ROUNDS - 1) * weight_of(task.subject.configuration, task.step)

    def _pair(self, task: _Task, image: Render) -> None:
        """Compare both precisions where they drew the same samples."""
        configuration, spp = task.subject.configuration, int(task.step)
        if configuration.sampler == "sobol" and configuration.usual and not configuration.adaptive:
            twin = self._twins.pop(spp, None)
            if twin is None:
                self._twins[spp] = image.rgb
            else:
                self.gaps[spp] = float(np.sqrt(np.mean((screen(twin) - screen(image.rgb)) ** 2)))

    # --- time ---------------------------------------------------------------------------------------------------------

    def _owed(self) -> float:
        """Seconds that the later rounds of what was begun will take."""
        return sum((ROUNDS - 1) * task.whole[0] for task in self.tasks)

    def _seed(self, number: int) -> int:
        return (self.scene.settings.seed + number) % (MAX_SEED + 1)

    def _tell(self) -> None:
        self.progress(self._done / self._total, self._rays)

    def _leave_out(self, configuration: Configuration, steps: Sequence[float], why: str) -> None:
        unit = "error " if configuration.adaptive else ""
        texts = [f"{unit}{step:g}{'' if configuration.adaptive else ' spp'}" for step in steps]
        self.left_out.setdefault(configuration.name, ([], why))[0].extend(texts)
        self._done += ROUNDS * sum(weight_of(configuration, step) for step in steps)

    def _late(self) -> str:
        return "no time was left for it; a larger budget has some"

    def _unjudged(self) -> str:
        off = f"{self.reference.error:.1e}"
        return f"too accurate for a reference that is itself off by {off}; a larger budget makes a better one"


def _name(task: _Task) -> str:
    configuration = task.subject.configuration
    return f"{configuration.name}, " + (f"error {task.step:g}" if configuration.adaptive else f"{task.step:g} spp")


def _whole(image: Render) -> Render:
    if image.interrupted:
        raise KeyboardInterrupt
    return image
