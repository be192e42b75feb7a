"""Compile kernels in several processes: Numba holds the GIL, so threads would only take turns.

The processes write object code into the store, where this process finds it. So it need not import Numba, and reacts to
Ctrl-C at once. If no process can be started, or one dies, this process compiles the missing kernels itself.
"""

import base64
import contextlib
import os
import pickle
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from raytrace import parallel
from raytrace.native import store
from raytrace.native.signatures import Kind, describe, kind_of

MAX_PROCESSES = 4  # each takes half a second and 150 MB to start, and two kernels take most of the total time
PROGRAM = "import sys; sys.path[:] = {path!r}; from raytrace.native.workers import work; work()"
DONE, CODE = b"done", b"code "  # answers: everything is in the store; or the code that could not be stored

Task = tuple[Any, tuple[Kind, ...]]  # a kernel, and kinds of arguments


def missing(calls: Iterable[tuple[Any, tuple[Any, ...]]]) -> list[Task]:
    """Return the kernels that the store lacks, of those given with their arguments."""
    tasks = dict.fromkeys((kernel, tuple(map(kind_of, args))) for kernel, args in calls)
    return [(kernel, kinds) for kernel, kinds in tasks if kernel.stored(kinds) is None]


def _shares(tasks: Iterable[Task]) -> list[list[Task]]:
    """Group kernels by file and precision: they share callees, which a process compiles only once."""
    shares = defaultdict(list)
    for kernel, kinds in tasks:
        shares[kernel.__module__, "float32" in ", ".join(map(describe, kinds))].append((kernel, kinds))
    return list(shares.values())


def compile_all(tasks: Iterable[Task], report: Callable[[int, int], None] = lambda _done, _total: None) -> None:
    """Compile kernels into the store, as far as possible.

    Parameters
    ----------
    tasks : iterable of (Kernel, kinds)
        Those that take longest should come first.
    report : callable
        Called in this thread with the number of finished groups and the number of groups.
    """
    shares = _shares(tasks)
    count = min(parallel.thread_count(None), MAX_PROCESSES, len(shares))
    python = Path(sys.executable or "").stem.startswith("python")  # not a program that embeds Python
    if count < 2 or not python or not store.can_keep():
        return
    mine, workers, stopping = threading.local(), list[subprocess.Popen[bytes]](), threading.Event()

    def compile_share(share: list[Task]) -> None:
        if not hasattr(mine, "worker"):
            mine.worker = _start()
            workers.append(mine.worker)
            if stopping.is_set():  # `stop` was called before the worker was in the list
                mine.worker.kill()
        with contextlib.suppress(OSError):  # the worker has died
            mine.worker.stdin.write(base64.b64encode(pickle.dumps(share)) + b"\n")
            mine.worker.stdin.flush()
            _take(share, mine.worker.stdout.readline())

    def stop() -> None:
        stopping.set()
        for worker in workers:
            worker.kill()

    report(0, len(shares))
    try:
        parallel.run(compile_share, shares, count, report=lambda done: report(done, len(shares)), cancel=stop)
    except OSError:  # no process could be started; do not try again
        stop()
    finally:
        for worker in workers:
            worker.communicate()  # closes its input, so it exits


def _take(share: list[Task], answer: bytes) -> None:
    """Keep the code that a process compiled but could not store, for example on a full disk."""
    if answer.startswith(CODE):
        for (kernel, kinds), code in zip(share, pickle.loads(base64.b64decode(answer[len(CODE) :])), strict=True):
            if code is not None:
                kernel.keep(kinds, code)


def _start() -> "subprocess.Popen[bytes]":
    flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # -I, -X dev, -W and the like
    return subprocess.Popen(
        [sys.executable, *flags, "-c", PROGRAM.format(path=sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"RAYTRACE_CACHE": str(store.cache_folder().parent)},  # the current folder may have changed
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def work() -> None:
    """Main function of such a process: compile the kernels that it reads, until its input ends."""
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # printed text must not mix with answers
    sys.modules.setdefault("scipy", None)  # type: ignore[arg-type]  # Numba imports it for linear algebra, slowly
    for line in sys.stdin.buffer:
        share = pickle.loads(base64.b64decode(line))
        for kernel, kinds in share:
            kernel.compile(kinds)
        unkept = [kernel.unkept(kinds) for kernel, kinds in share]
        answers.write((CODE + base64.b64encode(pickle.dumps(unkept)) if any(unkept) else DONE) + b"\n")
