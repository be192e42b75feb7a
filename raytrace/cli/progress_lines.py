"""Progress as lines of text, for output that is no terminal."""

from collections.abc import Callable

from raytrace.rendering.progress import Progress, speed

LONG = 10.0  # seconds: a shorter stage needs no line
AFTER = 2.0  # seconds after which the time of a stage can be estimated
TENTHS = 10


class ProgressLines:
    """Says one line per tenth of every stage that takes long; call it with every event.

    Parameters
    ----------
    say : callable
        Shows one line of text.

    Notes
    -----
    The times are those of the events, which count from the start of a stage: the lines depend on no other clock.

    Examples
    --------
    >>> lines = ProgressLines(print)
    >>> for done in range(0, 1001):
    ...     lines(Progress("rendering", done, 1000, rays=done * 10**6, seconds=done * 0.025))
    rendering: 10 %, 40.0 M rays/s, about 22 s left
    rendering: 20 %, 40.0 M rays/s, about 20 s left
    rendering: 30 %, 40.0 M rays/s, about 18 s left
    rendering: 40 %, 40.0 M rays/s, about 15 s left
    rendering: 50 %, 40.0 M rays/s, about 12 s left
    rendering: 60 %, 40.0 M rays/s, about 10 s left
    rendering: 70 %, 40.0 M rays/s, about 8 s left
    rendering: 80 %, 40.0 M rays/s, about 5 s left
    rendering: 90 %, 40.0 M rays/s, about 2 s left
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._part = ("", 0)  # stage and number of work items; adaptive sampling adds items
        self._tenth = 0  # the last one that was said, or passed in silence

    def __call__(self, event: Progress) -> None:
        """Receive a progress update."""
        tenth = TENTHS * event.done // max(event.total, 1)
        if (event.stage, event.total) != self._part:
            self._part, self._tenth = (event.stage, event.total), tenth
        if tenth <= self._tenth or tenth >= TENTHS or event.seconds < AFTER:
            return
        self._tenth = tenth
        whole = event.seconds * event.total / event.done
        if whole >= LONG:
            rays = f"{speed(event)}, " if event.rays else ""
            left = whole - event.seconds
            self._say(f"{event.stage}: {TENTHS * tenth} %, {rays}about {left:.0f} s left")
