"""Work on several threads: kernels let go of the interpreter's lock, so plain threads are all that is needed."""

import operator
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from queue import Empty, SimpleQueue
from typing import Any

from raytrace import cores
from raytrace.errors import OptionError
from raytrace.jit import PLAIN

POLL = 0.1  # seconds between two looks at the keyboard
GRAIN = 1024  # rows: what is shared out in ranges is cut at multiples of this
LEAST, MOST = 1 << 14, 1 << 17  # rows of a range, if they are quick
PIECE = 0.1  # seconds: about what a range takes at most, so that Ctrl-C is soon noticed
WORTH = 0.001  # seconds of work for which a thread is started, which takes a tenth of that, and on a busy machine all


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
        Is called with an item; releases the interpreter's lock while it works.
    items : iterable
    threads : int or None
        As ``thread_count`` takes it.
    stop : callable
        Says that no more items are to be begun.
    report : callable
        Is called here, in the caller's thread, with the number of items done.
    cancel : callable
        Is called when an error or Ctrl-C ends the work early: tasks under way may heed it.

    Returns
    -------
    bool
        Whether all items were done.

    Notes
    -----
    An error in a task, or Ctrl-C, ends the handing out; tasks under way are waited for, and it is raised here. Where
    the system gives no thread (the interpreter is ending, or there are too many), the caller's does the work; so
    it does where one thread is asked for and kernels are plain Python, for that is where a debugger looks.
    """
    queue, count = _Queue(task, items), thread_count(threads)
    if PLAIN and count == 1:
        count = 0
    news = SimpleQueue[bool]()

    def work() -> None:
        queue.work(stop, lambda: news.put(True))
        news.put(False)

    workers = [threading.Thread(target=work, name=f"raytrace-{k}") for k in range(count)]
    try:
        started = _start(workers)
        if started == 0:
            work()
        _follow(news, max(started, 1), report)
        queue.check()
    except BaseException:
        queue.halted = True
        cancel()
        raise
    finally:
        _join(workers)
    return queue.take() is queue.empty


def together(task: Callable[[Any], object], items: Iterable[Any], threads: int | None) -> None:
    """Call ``task`` with every item, here and on other threads, so that none waits; raise here what any raises."""
    queue = _Queue(task, items)
    workers = [threading.Thread(target=queue.work, name=f"raytrace-{k}") for k in range(1, thread_count(threads))]
    try:
        _start(workers)
        queue.work()
    finally:
        queue.halted = True
        _join(workers)
    queue.check()


class _Queue:
    """Items that threads take one after the other, until one of them meets an error."""

    empty = object()

    def __init__(self, task: Callable[[Any], object], items: Iterable[Any]) -> None:
        self._task, self._items, self._turn = task, iter(items), threading.Lock()
        self.halted = False
        self._errors: list[BaseException] = []

    def take(self) -> Any:
        """The next item, or ``empty``."""
        with self._turn:
            return next(self._items, self.empty)

    def work(self, stop: Callable[[], bool] = lambda: False, tell: Callable[[], None] = lambda: None) -> None:
        """Do item after item; ``tell`` of each that is done."""
        try:
            while not self.halted and not stop():
                item = self.take()
                if item is self.empty:
                    return
                self._task(item)
                tell()
        except BaseException as error:  # noqa: BLE001  (raised in the caller's thread)
            self.halted = True
            self._errors.append(error)

    def check(self) -> None:
        """Raise the first error."""
        if self._errors:
            raise self._errors[0]


def _join(workers: Iterable[threading.Thread]) -> None:
    """Wait for threads that were started."""
    for worker in workers:
        if worker.ident is not None:
            worker.join()


def _start(workers: Iterable[threading.Thread]) -> int:
    """Start threads while the system gives any; how many."""
    started = 0
    for worker in workers:
        if sys.is_finalizing():  # a new thread would wait for ever
            break
        try:
            worker.start()
        except RuntimeError:
            break
        started += 1
    return started


def _follow(news: SimpleQueue[bool], working: int, report: Callable[[int], None]) -> None:
    """Report finished items until all threads have left."""
    done = 0
    while working:
        try:
            finished = news.get(timeout=POLL)
        except Empty:
            continue
        if finished:
            done += 1
            report(done)
        else:
            working -= 1


def share_out(task: Callable[[int, int], object], n: int, threads: int | None) -> None:
    """Call ``task`` with ranges (begin, end) that make up 0 .. n, here or on several threads, whichever is sooner.

    Parameters
    ----------
    task : callable
        Works on the rows of a range; releases the interpreter's lock while it does.
    n : int
        Rows.
    threads : int or None
        As ``thread_count`` takes it.

    Notes
    -----
    The first rows are done here. How long they take tells whether the others are worth threads, and how many to hand
    out at a time: few enough for Ctrl-C to be noticed soon, and fewer towards the end, so that threads end together.
    """
    count, pace = thread_count(threads), 0.0

    def timed(part: tuple[int, int]) -> None:
        nonlocal pace
        began = time.perf_counter()
        task(*part)
        pace = (time.perf_counter() - began) / (part[1] - part[0])

    def parts(begin: int) -> Iterator[tuple[int, int]]:
        while begin < n:
            rows = min(MOST, PIECE / max(pace, 1e-12), max(LEAST, (n - begin) / max(count, 1)))
            end = min(n, begin + max(int(rows) // GRAIN, 1) * GRAIN)
            yield begin, end
            begin = end

    if n > 0:
        timed((0, min(n, GRAIN)))
    count = min(count, int((n - GRAIN) * pace / WORTH))
    if count > 1:
        together(timed, parts(GRAIN), count)
    else:
        for part in parts(GRAIN):
            timed(part)
