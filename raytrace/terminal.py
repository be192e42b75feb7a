"""The person at the terminal: a notice and a bar while a picture is drawn, Ctrl-C and a closed terminal."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, NoReturn, Protocol, Self

BAR_AFTER = 0.5  # s: a picture that is done sooner needs no bar, nor the import of one
INTERRUPTED = 130  # exit code: 128 + SIGINT, as shells have it
ENDING = "SIGINT", "SIGTERM", "SIGHUP"  # signals that ask a process to end; Windows lacks the last
SHOW_CURSOR = b"\x1b[?25h"  # the bar hides it   [ECMA-48 private mode 25]


class Event(Protocol):
    """One message from a running render; the ``Progress`` record of `raytrace.rendering` is one."""

    @property
    def stage(self) -> str:
        """What is going on: "compiling", "building" or "rendering"."""

    @property
    def done(self) -> int:
        """Finished parts."""

    @property
    def total(self) -> int:
        """All parts."""

    @property
    def rays(self) -> int:
        """Rays traced so far, of all kinds."""

    @property
    def seconds(self) -> float:
        """Seconds since the stage began."""


def at_terminal() -> bool:
    """Whether messages reach a person at a terminal that can redraw a line."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def speed(event: Event) -> str:
    """Rays per second, for people."""
    return f"{event.rays / max(event.seconds, 1e-9) / 1e6:.1f} M rays/s"


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
        self.last: Event | None = None  # the newest event of the rendering stage
        self._say = say
        self._wants_bar = bar
        self._compiling = False
        self._bar: Any = None  # rich.progress.Progress, once it is shown
        self._shown = ""  # the stage that it shows
        self._task: Any = None  # of it

    def __call__(self, event: Event) -> None:
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

    def _draw(self, event: Event) -> None:
        try:
            self._update(event)
        except OSError:  # the terminal is closed
            self._wants_bar, self._bar = False, None

    def _update(self, event: Event) -> None:
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


@contextlib.contextmanager
def signals_interrupt() -> Iterator[None]:
    """Let the first signal to end raise KeyboardInterrupt, as Ctrl-C ever does, and the second end the process at once.

    Such are Ctrl-C, SIGTERM (``kill``, a batch system out of time) and SIGHUP (a closed terminal), which ``nohup`` has
    ignored.
    """

    def second(*_: object) -> NoReturn:
        if at_terminal():
            with contextlib.suppress(OSError):
                os.write(sys.stderr.fileno(), SHOW_CURSOR)
        os._exit(INTERRUPTED)

    def first(*_: object) -> NoReturn:
        for number in before:
            signal.signal(number, second)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # only the main thread may set handlers
        yield
        return
    numbers = [getattr(signal, name) for name in ENDING if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: handler for number, handler in before.items() if not _is_nohup(number, handler)}
    for number in before:
        signal.signal(number, first)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_nohup(number: int, handler: Any) -> bool:
    return number != signal.SIGINT and handler is signal.SIG_IGN
