"""Work on several threads: kernels let go of the interpreter's lock, so plain threads are all that is needed."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
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
    items, count, done = iter(items), thread_count(threads), 0
    with ThreadPoolExecutor(count, thread_name_prefix="raytrace") as pool:
        pending: set[Future[object]] = set()
        try:
            while True:
                ahead = [] if stop() else list(islice(items, 2 * count - len(pending)))
                pending |= {pool.submit(task, item) for item in ahead}
                if not pending:
                    return next(items, None) is None
                finished, pending = wait(pending, POLL, FIRST_COMPLETED)
                for future in finished:
                    future.result()
                done += len(finished)
                report(done)
        except BaseException:
            cancel()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
