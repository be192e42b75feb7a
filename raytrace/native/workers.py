"""Kernels compiled by processes of their own: Numba holds the interpreter's lock, so threads would only take turns.

They write what they make into the store, where this process finds it, and so never imports Numba itself. Where a
process can't be started, or dies, nothing is there, and this process compiles what it needs.
"""

import base64
import contextlib
import os
import pickle
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from raytrace import parallel
from raytrace.native.signatures import Kind, kind_of

MOST = 4  # processes; each takes half a second and 150 MB before it compiles, and one kernel takes half of all the time
PROGRAM = "import sys; sys.path[:] = {path!r}; from raytrace.native.workers import work; work()"
DONE = b"done\n"

Task = tuple[Any, tuple[Kind, ...]]  # a kernel, and kinds of arguments


def missing(calls: Iterable[tuple[Any, tuple[Any, ...]]]) -> list[Task]:
    """Kernels, from those with their arguments, that the store lacks; each for the same kinds of arguments once."""
    tasks = dict.fromkeys((kernel, tuple(map(kind_of, args))) for kernel, args in calls)
    return [(kernel, kinds) for kernel, kinds in tasks if kernel.stored(kinds) is None]


def compile_all(tasks: Sequence[Task], report: Callable[[int], None] = lambda _done: None) -> None:
    """Compile kernels into the store, as far as that can be done.

    Parameters
    ----------
    tasks : sequence of (Kernel, kinds)
        Those that take long come first.
    report : callable
        Is called here with the number of kernels done.
    """
    groups = defaultdict(list)
    for kernel, kinds in tasks:  # kernels of one file share callees, which a process compiles once
        groups[kernel.__module__, ].append((kernel, kinds))
    count = min(parallel.thread_count(None), MOST, len(groups))
    if count < 2 or not Path(sys.executable or "").stem.startswith("python"):  # another program has Python within
        return
    mine, workers = threading.local(), list[subprocess.Popen[bytes]]()

    def compile_some(tasks: list[Task]) -> None:
        if not hasattr(mine, "worker"):
            mine.worker = _start()
            workers.append(mine.worker)
        for task in tasks:
            with contextlib.suppress(OSError):  # it has died
                mine.worker.stdin.write(base64.b64encode(pickle.dumps(task)) + b"\n")
                mine.worker.stdin.flush()
                mine.worker.stdout.readline()

    def stop() -> None:
        for worker in workers:
            worker.kill()

    try:
        parallel.run(compile_some, groups.values(), count, report=report, cancel=stop)
    except OSError:  # no process could be started
        stop()
    finally:
        for worker in workers:
            worker.communicate()  # closes its input, at the end of which it leaves


def _start() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(path=sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def work() -> None:
    """What such a process does: compile what it reads, until its input ends."""
    import gc

    gc.disable()  # it would take a sixth of the time, and find nothing
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # whatever is printed is no answer
    for line in sys.stdin.buffer:
        kernel, kinds = pickle.loads(base64.b64decode(line))
        kernel.compile(kinds)
        answers.write(DONE)
