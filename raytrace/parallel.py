"""Work on several threads: kernels let go of the interpreter's lock, so plain threads are all that is needed."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, SimpleQueue
from typing import Any

from raytrace.errors import OptionError

POLL = 0.1  # seconds between two looks at the keyboard


def thread_count(threads: int | None) -> int:
    """Threads to use: as asked, or as many as the process may use cores."""
    if threads is not None:
        if threads < 1:
            raise OptionError(f"threads: expected a number of at least 1, got {threads}")
        return threads
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    An error in a task, or Ctrl-C, ends the handing out; tasks under way are waited for, and it is raised here.
    """
    items, count = iter(items), thread_count(threads)
    turn, halt, news = threading.Lock(), threading.Event(), SimpleQueue[bool]()

    def work() -> None:
        try:
            while not halt.is_set() and not stop():
                with turn:
                    item = next(items, news)
                if item is news:  # no item is left
                    return
                task(item)
                news.put(True)
        except BaseException:
            halt.set()
            raise
        finally:
            news.put(False)

    with ThreadPoolExecutor(count, thread_name_prefix="raytrace") as pool:
        workers = [pool.submit(work) for _ in range(count)]
        try:
            _follow(news, count, report)
            for worker in workers:
                worker.result()
        except BaseException:
            halt.set()
            cancel()
            raise
    return next(items, news) is news


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
