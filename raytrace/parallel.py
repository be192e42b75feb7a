"""Work on several threads: kernels release the GIL, so plain threads are enough."""

import operator
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from queue import Empty, SimpleQueue
from typing import Any

from raytrace import cores, thread_pool
from raytrace.errors import OptionError
from raytrace.jit import PLAIN
from raytrace.thread_pool import Job

POLL = 0.1  # seconds between two checks for Ctrl-C
GRAIN = 1024  # rows: ranges begin at multiples of this by default
MIN_RANGE, MAX_RANGE = 1 << 14, 1 << 17  # rows of a range, if they are fast
PIECE = 0.1  # seconds: longest time of a range, approximately, so that Ctrl-C takes effect soon
WORTH = 0.0001  # seconds of work that justify a thread: to wake one takes a fifth of that


def thread_count(threads: int | None) -> int:
    """Return the number of threads to use: as asked, or one per core that the process may use."""
    if threads is None:
        return cores.usable()
    try:
        count = operator.index(threads)
    except TypeError:
        raise OptionError(f"threads: expected a whole number, got {threads!r}") from None
    if count < 1:
        raise OptionError(f"threads: expected a number of at least 1, got {count}")
    return count


def run(
    task: Callable[[Any], object],
    items: Iterable[Any],
    threads: int | None,
    stop: Callable[[], bool] = lambda: False,
    report: Callable[[int], None] = lambda _done: None,
    cancel: Callable[[], None] = lambda: None,
) -> bool:
    """Call ``task`` with every item, on several threads.

    Parameters
    ----------
    task : callable
        Called with an item; releases the GIL while it works.
    items : iterable
    threads : int or None
        Argument of ``thread_count``.
    stop : callable
        Returns True when no more items should be started.
    report : callable
        Called in the caller's thread with the number of finished items.
    cancel : callable
        Called when an error or Ctrl-C ends the work early, so that running tasks can stop.

    Returns
    -------
    bool
        Whether all items were finished.

    Notes
    -----
    After an error in a task, or Ctrl-C, no more items are started; running tasks are waited for, and the exception is
    raised here. If no thread can be started (the interpreter is shutting down, or there are too many), the caller's
    thread does the work. It also does so with ``threads=1`` where kernels are plain Python, so that a debugger works.
    """
    queue, count = _Queue(task, items), thread_count(threads)
    if PLAIN and count == 1:
        count = 0
    news = SimpleQueue[bool]()

    def work() -> None:
        queue.work(stop, lambda: news.put(True))
        news.put(False)

    jobs: list[Job] = []
    try:
        jobs += thread_pool.start(work, count)
        if not jobs:
            work()
        _follow(news, jobs, report)
        queue.check()
    except BaseException:
        queue.halted = True
        cancel()
        raise
    finally:
        thread_pool.join(jobs)
    return queue.take() is queue.empty


def together(task: Callable[[Any], object], items: Iterable[Any], threads: int | None) -> None:
    """Call ``task`` with every item, in this thread and on others; raise the first error of any here."""
    queue = _Queue(task, items)
    jobs = thread_pool.start(queue.work, thread_count(threads) - 1)
    try:
        queue.work()
    finally:
        queue.halted = True
        thread_pool.join(jobs)
    queue.check()


class _Queue:
    """Items that threads take one after the other, until one of them fails."""

    empty = object()

    def __init__(self, task: Callable[[Any], object], items: Iterable[Any]) -> None:
        self._task, self._items, self._turn = task, iter(items), threading.Lock()
        self.halted = False
        self._errors: list[BaseException] = []

    def take(self) -> Any:
        """Return the next item, or ``empty``."""
        with self._turn:
            return next(self._items, self.empty)

    def work(self, stop: Callable[[], bool] = lambda: False, report: Callable[[], None] = lambda: None) -> None:
        """Process item after item; call ``report`` after each."""
        try:
            while not self.halted and not stop():
                item = self.take()
                if item is self.empty:
                    return
                self._task(item)
                report()
        except BaseException as error:  # noqa: BLE001  (raised in the caller's thread)
            self.halted = True
            self._errors.append(error)

    def check(self) -> None:
        """Raise the first error."""
        if self._errors:
            raise self._errors[0]


def _follow(news: SimpleQueue[bool], jobs: list[Job], report: Callable[[int], None]) -> None:
    """Report finished items until all threads that have begun have ended, or the caller's thread without any."""
    done, working = 0, max(len(jobs), 1)
    while working:
        try:
            finished = news.get(timeout=POLL)
        except Empty:
            continue
        if finished:
            done += 1
            report(done)
        else:  # no more items are started
            begun = [job for job in jobs if not job.cancel()]
            working -= 1 + len(jobs) - len(begun)
            jobs[:] = begun


def share_out(task: Callable[[int, int], object], n: int, threads: int | None, grain: int = GRAIN) -> None:
    """Call ``task`` with ranges (begin, end) that cover 0 .. n, in this thread or on several, whichever is faster.

    Parameters
    ----------
    task : callable
        Processes the rows of a range; releases the GIL while it works.
    n : int
        Rows.
    threads : int or None
        Argument of ``thread_count``.
    grain : int
        Ranges begin at multiples of so many rows; at most ``MAX_RANGE``.

    Notes
    -----
    The first rows are processed in this thread. Their time decides whether threads pay for the others, and how many
    rows a range has: few enough for Ctrl-C to take effect soon, fewer towards the end, so that threads end together.
    """
    count, pace = thread_count(threads), 0.0

    def timed(part: tuple[int, int]) -> None:
        nonlocal pace
        began = time.perf_counter()
        task(*part)
        pace = (time.perf_counter() - began) / (part[1] - part[0])

    def parts(begin: int) -> Iterator[tuple[int, int]]:
        while begin < n:
            rows = min(MAX_RANGE, PIECE / max(pace, 1e-12), max(MIN_RANGE, (n - begin) / max(count, 1)))
            end = min(n, begin + max(int(rows) // grain, 1) * grain)
            yield begin, end
            begin = end

    if n > 0:
        timed((0, min(n, grain)))
    count = min(count, int((n - grain) * pace / WORTH))
    if count > 1:
        together(timed, parts(grain), count)
    else:
        for part in parts(grain):
            timed(part)
