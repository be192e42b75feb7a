"""The terminal: a progress bar, a notice of compilation, Ctrl-C and a closed terminal."""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, NoReturn, Self

from raytrace.cli import streams
from raytrace.cli.progress_lines import ProgressLines
from raytrace.files import unfinished
from raytrace.rendering.progress import Progress, speed

BAR_AFTER = 0.5  # seconds: a shorter render needs no bar, and no import of one
ECHO = 0.05  # seconds: nobody presses Ctrl-C twice in a shorter time
INTERRUPTED = 130  # exit code: 128 + SIGINT, as in shells
ENDING = "SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"  # signals that ask a process to end; the last exists on Windows only
SHOW_CURSOR = b"\x1b[?25h"  # the bar hides it   [ECMA-48 private mode 25]


def at_terminal() -> bool:
    """Whether stderr is a terminal that can redraw a line."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


class Reporter:
    """Shows the progress of a render: call it with every event, and use it as a context manager.

    Parameters
    ----------
    say : callable
        Shows one line of text.
    bar : bool
        Show a progress bar on stderr after `BAR_AFTER` seconds.
    lines : bool
        Say a line per tenth of a long stage instead, for files and terminals that cannot redraw a line.
    """

    def __init__(self, say: Callable[[str], None], *, bar: bool, lines: bool = False) -> None:
        self.last: Progress | None = None  # the newest event of the rendering stage
        self._say = say
        self._wants_bar = bar
        self._lines = ProgressLines(say) if lines else None
        self._compiling = False
        self._bar: Any = None  # a rich.progress.Progress, once it is shown
        self._shown = ""  # the stage that the bar shows
        self._task: Any = None  # the bar's task

    def __call__(self, event: Progress) -> None:
        """Receive a progress update."""
        if event.stage == "compiling" and not self._compiling:
            self._compiling = True
            self._say("compiling kernels (first run only)")
        if event.stage == "rendering":
            self.last = event
        if self._lines:
            self._lines(event)
        if event.stage != "building" and self._wants_bar and (self._bar or event.seconds >= BAR_AFTER):
            self._draw(event)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar:
            with contextlib.suppress(OSError):
                self._bar.stop()
            self._bar = None

    def _draw(self, event: Progress) -> None:
        try:
            self._update(event)
        except OSError:  # the terminal is closed
            self._wants_bar, self._bar = False, None

    def _update(self, event: Progress) -> None:
        if self._bar is None:
            self._bar = _bar()
            self._bar.start()
        if event.stage != self._shown:
            if self._shown:
                self._bar.remove_task(self._task)
            self._shown, self._task = event.stage, self._bar.add_task(event.stage, total=event.total, speed="")
        self._bar.update(self._task, completed=event.done, speed=speed(event) if event.rays else "")


def _bar() -> Any:
    from rich import progress
    from rich.console import Console

    return progress.Progress(  # rich respects NO_COLOR
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TextColumn("{task.fields[speed]}"),
        progress.TimeRemainingColumn(),
        progress.TextColumn("left"),
        console=Console(stderr=True),
        transient=True,
    )


@contextlib.contextmanager
def counting(stage: str) -> Iterator[Callable[[str, int, int], None]]:
    """Show the progress of work that is counted; call the value of the context with a name, k, and n of k = 0 .. n."""
    began, bar = time.monotonic(), at_terminal()
    with Reporter(streams.say, bar=bar, lines=not bar) as reporter:
        yield lambda _name, k, n: reporter(Progress(stage, k, n, 0, time.monotonic() - began))


class Signals:
    """The signals to end that the process has received.

    Parameters
    ----------
    echo : float, seconds
        A signal within this time of the first one counts as the same one: ``timeout`` sends each signal twice.

    Attributes
    ----------
    came : bool
        Whether a signal was received.
    """

    def __init__(self, echo: float) -> None:
        self.came = self._holding = False
        self._echo = echo

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """In this context, the first signal is recorded but raises nothing, so that the work can finish."""
        self._holding = True
        try:
            yield
        finally:
            self._holding = False

    def first(self, numbers: Iterable[int]) -> None:
        """Handle the first signal."""
        self.came, self._when = True, time.monotonic()
        for number in numbers:
            signal.signal(number, self._second)
        if not self._holding:
            raise KeyboardInterrupt

    def _second(self, *_: object) -> None:
        if time.monotonic() - self._when >= self._echo:
            _end()


def _end() -> NoReturn:
    """End the process at once; only files that are not completely written are deleted."""
    if at_terminal():
        with contextlib.suppress(OSError):
            os.write(sys.stderr.fileno(), SHOW_CURSOR)
    for path in list(unfinished):
        with contextlib.suppress(OSError):
            path.unlink()
    os._exit(INTERRUPTED)


@contextlib.contextmanager
def signals_interrupt(echo: float = 0.0) -> Iterator[Signals]:
    """Make the first signal to end raise KeyboardInterrupt, as Ctrl-C always does, and the second end the process.

    These signals are Ctrl-C, SIGTERM (``kill``, the time limit of a batch system) and SIGHUP (a closed terminal;
    ``nohup`` ignores it), and on Windows Ctrl-Break (also sent by a closed console). After the first signal, the
    handlers stay until the process ends, so that a second one never meets the previous handlers. A signal within
    ``echo`` seconds of the first one is not counted as the second.
    """
    signals = Signals(echo)
    if threading.current_thread() is not threading.main_thread():  # only the main thread may set handlers
        yield signals
        return
    numbers = [getattr(signal, name) for name in ENDING if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: handler for number, handler in before.items() if not _is_nohup(number, handler)}
    for number in before:
        signal.signal(number, lambda *_: signals.first(before))
    try:
        yield signals
    finally:
        if not signals.came:
            for number, handler in before.items():
                signal.signal(number, handler)


def _is_nohup(number: int, handler: Any) -> bool:
    return number != signal.SIGINT and handler is signal.SIG_IGN
