"""The person at the terminal: a notice and a bar while a picture is drawn, Ctrl-C and a closed terminal."""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, NoReturn, Self

from raytrace.files import unfinished
from raytrace.rendering.progress import Progress, speed

BAR_AFTER = 0.5  # s: a picture that is done sooner needs no bar, nor the import of one
ECHO = 0.05  # seconds: sooner nobody presses Ctrl-C again
INTERRUPTED = 130  # exit code: 128 + SIGINT, as shells have it
ENDING = "SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"  # signals that ask a process to end; the last is of Windows alone
SHOW_CURSOR = b"\x1b[?25h"  # the bar hides it   [ECMA-48 private mode 25]


def at_terminal() -> bool:
    """Whether messages reach a person at a terminal that can redraw a line."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


class Reporter:
    """Shows the progress of a render: call it with every event, and use it as a context manager.

    Parameters
    ----------
    say : callable
        Shows one line of text.
    bar : bool
        Draw a bar on stderr once the render has run for `BAR_AFTER`.
    """

    def __init__(self, say: Callable[[str], None], *, bar: bool) -> None:
        self.last: Progress | None = None  # the newest event of the rendering stage
        self._say = say
        self._wants_bar = bar
        self._compiling = False
        self._bar: Any = None  # rich.progress.Progress, once it is shown
        self._shown = ""  # the stage that it shows
        self._task: Any = None  # of it

    def __call__(self, event: Progress) -> None:
        """Take in one event."""
        if event.stage == "compiling" and not self._compiling:
            self._compiling = True
            self._say("compiling kernels (first run only)")
        if event.stage == "rendering":
            self.last = event
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

    return progress.Progress(  # rich itself obeys NO_COLOR
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TextColumn("{task.fields[speed]}"),
        progress.TimeRemainingColumn(),
        progress.TextColumn("left"),
        console=Console(stderr=True),
        transient=True,
    )


class Signals:
    """The signals to end that came.

    Parameters
    ----------
    echo : float, seconds
        A second signal that comes sooner after the first is the same once more: ``timeout`` sends each of them twice.

    Attributes
    ----------
    came : bool
        Whether one came.
    """

    def __init__(self, echo: float) -> None:
        self.came = self._holding = False
        self._echo = echo

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Let what is done within be finished: the first signal is noted, but raises nothing."""
        self._holding = True
        try:
            yield
        finally:
            self._holding = False

    def first(self, numbers: Iterable[int]) -> None:
        """Take the first signal."""
        self.came, self._when = True, time.monotonic()
        for number in numbers:
            signal.signal(number, self._second)
        if not self._holding:
            raise KeyboardInterrupt

    def _second(self, *_: object) -> None:
        if time.monotonic() - self._when >= self._echo:
            _end()


def _end() -> NoReturn:
    """End the process at once; what is on the disk stays, but for files that are written just now."""
    if at_terminal():
        with contextlib.suppress(OSError):
            os.write(sys.stderr.fileno(), SHOW_CURSOR)
    for path in list(unfinished):
        with contextlib.suppress(OSError):
            path.unlink()
    os._exit(INTERRUPTED)


@contextlib.contextmanager
def signals_interrupt(echo: float = 0.0) -> Iterator[Signals]:
    """Let the first signal to end raise KeyboardInterrupt, as Ctrl-C always does, and the second end the process.

    Such are Ctrl-C, SIGTERM (``kill``, a batch system out of time) and SIGHUP (a closed terminal), which ``nohup`` has
    ignored; on Windows Ctrl-Break, which is also what a closed console sends. After the first of them the handlers stay
    until the process ends: so the second, however soon it comes, never finds those of before. What comes within
    ``echo`` seconds of the first is not the second.
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
