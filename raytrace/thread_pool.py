"""Threads of this process that wait for work: to wake one takes 10 to 20 microseconds, to start one 50 to 200."""

import atexit
import contextlib
import itertools
import os
import sys
import threading
from collections.abc import Callable, Iterable
from functools import cache
from queue import Empty, SimpleQueue
from typing import NamedTuple, cast

KEPT = 4 * (os.cpu_count() or 1)  # threads that wait for work; others end

Work = Callable[[], object]  # raises nothing

_idle: list["Worker"] = []  # each has one user at a time, who takes it from here
_unfinished: set[threading.Lock] = set()  # work that the process waits for when it ends
_numbers = itertools.count()


class Worker:
    """A thread that runs one job after the other. It ends with the process, before a fork, or where too many wait."""

    def __init__(self) -> None:
        self.tasks = SimpleQueue[tuple[Work, "Job"] | None]()
        self._affinity = _affinity()
        self.thread = threading.Thread(target=self._serve, name=f"raytrace-{next(_numbers)}", daemon=True)
        self.thread.start()

    def place(self, cores: set[int]) -> None:
        """Let the thread use these CPU cores."""
        if cores and cores != self._affinity and self.thread.native_id:
            with contextlib.suppress(OSError):
                os.sched_setaffinity(self.thread.native_id, cores)
            self._affinity = cores

    def _serve(self) -> None:
        while task := self.tasks.get():
            work, job = task
            if not job.claim.acquire(blocking=False):
                del work, task
                continue
            try:
                work()
                del work, task  # and the memory that they refer to
                _unfinished.discard(job.done)
                if kept := len(_idle) < KEPT:
                    _idle.append(self)
            finally:
                job.done.release()
            if not kept:
                return


class Job(NamedTuple):
    """Work that a thread was given."""

    worker: Worker
    claim: threading.Lock  # held once the thread has begun, or the work was taken back
    done: threading.Lock  # released by the thread when it is done

    def cancel(self) -> bool:
        """Take back the work unless the thread has begun with it; return whether that is so."""
        if not self.claim.acquire(blocking=False):
            return False
        with contextlib.suppress(Empty):  # the thread is waking up, and finds that it has nothing to do
            self.worker.tasks.get_nowait()
        _unfinished.discard(self.done)
        _idle.append(self.worker)
        return True


def start(work: Work, count: int, busy: bool) -> list[Job]:
    """Call ``work`` in so many threads, or in as many as there can be; return what they were given.

    The threads share out the CPU cores that the caller may use. A caller that is ``busy``, because it goes on working,
    keeps its own. Left to itself, Linux often wakes a thread on the core of the one that woke it, and leaves it there
    for many milliseconds, although another core has nothing to do; and threads that take turns in Python wake each
    other all the time.
    """
    jobs: list[Job] = []
    if count < 1 or sys.is_finalizing():  # a thread would wait forever then
        return jobs
    allowed, daemon = _affinity(), threading.current_thread().daemon
    cores = sorted(allowed - _core() if busy else allowed) or sorted(allowed)
    while len(jobs) < count and not sys.is_finalizing():
        try:
            worker = _idle.pop() if _idle else Worker()
        except IndexError:  # another thread took the last one
            continue
        except RuntimeError:
            break
        worker.place(set(cores[len(jobs) % max(len(cores), 1) :: count]))
        job = Job(worker, threading.Lock(), threading.Lock())
        job.done.acquire()
        if not daemon:
            _unfinished.add(job.done)
        worker.tasks.put((work, job))
        jobs.append(job)
    return jobs


def join(jobs: Iterable[Job]) -> None:
    """Wait for threads that have begun with their work, and take it back from the others."""
    for job in jobs:
        if not job.cancel():
            job.done.acquire()


def _affinity() -> set[int]:
    """Return the CPU cores that this thread may use; none where the system does not say."""
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def _core() -> set[int]:
    """Return the CPU core on which this thread runs; none where the system does not say."""
    core = _core_number()
    return {core()} if core else set()


@cache
def _core_number() -> Callable[[], int] | None:
    from ctypes import CDLL  # compiled kernels have imported it

    try:
        return cast("Callable[[], int]", CDLL(None).sched_getcpu)
    except (AttributeError, OSError, TypeError):  # only Linux has it
        return None


def _dismiss() -> None:
    """End the threads that wait for work."""
    workers = []
    with contextlib.suppress(IndexError):
        while True:
            workers.append(_idle.pop())
    for worker in workers:
        worker.tasks.put(None)
    for worker in workers:
        worker.thread.join()


@atexit.register
def _finish() -> None:
    """Wait for work that an exception left alone, as the interpreter waits for threads that are not daemons."""
    for done in list(_unfinished):
        done.acquire()


def _forget() -> None:
    """A forked process has none of these threads."""
    _idle.clear()
    _unfinished.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_dismiss, after_in_child=_forget)
