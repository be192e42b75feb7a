"""Kernels compiled by other processes: they arrive in the store, and nothing is lost where they don't."""

import errno
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from raytrace import jit, parallel
from raytrace.accel.reorder import give_back
from raytrace.native import private_files, store, workers
from raytrace.native.signatures import kind_of
from raytrace.passes.film import accumulate
from raytrace.passes.light import background
from raytrace.records import Hits

ROOT = Path(__file__).parent.parent
pytestmark = pytest.mark.skipif(jit.PLAIN, reason="kernels are plain functions")


def calls(dtype):
    real, whole = np.zeros(16, dtype), np.zeros(16, np.int32)
    return [
        (background, (Hits(real, whole, real, real), np.zeros(48, dtype), np.zeros(3, dtype))),
        (accumulate, (np.zeros(48, dtype), 0, 1, np.zeros((12, 16)), 0, 16)),
        (give_back, (real, 16, whole, real)),
    ]


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """An empty store, and two cores."""
    monkeypatch.setenv("RAYTRACE_CACHE", str(tmp_path))
    monkeypatch.setattr(parallel, "thread_count", lambda threads: threads or 2)
    store.cache_folder.cache_clear()
    yield store.cache_folder()
    monkeypatch.undo()
    store.cache_folder.cache_clear()


def test_what_is_missing_is_compiled_once_and_reported(folder):
    wanted = [call for dtype in ("f4", "f8", "f4") for call in calls(dtype)]
    tasks, reports = workers.missing(wanted), []
    assert len(tasks) == len(set(tasks)) == 6
    workers.compile_all(tasks, lambda *numbers: reports.append(numbers))
    assert reports == [(k, 6) for k in range(7)]  # files and precisions
    assert all(kernel.stored(kinds) for kernel, kinds in tasks)
    assert workers.missing(wanted) == []
    assert len(list(folder.iterdir())) == 6


def test_what_they_compiled_is_what_is_compiled_here(folder):
    (kernel, args), *_ = calls("f4")
    kinds = tuple(map(kind_of, args))
    workers.compile_all(workers.missing(calls("f4")))
    theirs = kernel.stored(kinds)
    ours = kernel.compile(kinds)
    assert theirs.outside == ours.outside
    assert len(theirs.data) == pytest.approx(len(ours.data), rel=0.1)  # but for names that count compilations


@pytest.mark.parametrize(
    "program",
    ["import os; os._exit(1)", "import sys; sys.stdin.readline(); raise SystemExit", "no Python", "print('noise\\n')"],
)
def test_a_process_that_dies_leaves_its_work_to_this_one(folder, monkeypatch, program):
    monkeypatch.setattr(workers, "PROGRAM", program)
    workers.compile_all(workers.missing(calls("f4")))
    assert len(workers.missing(calls("f4"))) == 3


@pytest.mark.parametrize("executable", ["/no/such/python", "/usr/bin/maya", "", None])
def test_where_no_process_can_be_started_none_is(folder, monkeypatch, executable):
    monkeypatch.setattr(sys, "executable", executable)
    workers.compile_all(workers.missing(calls("f4")))
    assert len(workers.missing(calls("f4"))) == 3


def test_they_keep_kernels_where_this_process_looks_even_after_it_changed_its_folder(folder, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RAYTRACE_CACHE", "relative")
    store.cache_folder.cache_clear()
    here = store.cache_folder()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    workers.compile_all(workers.missing(calls("f4")))
    assert len(list(here.glob(f"*{store.SUFFIX}"))) == 3


def test_what_they_could_not_keep_comes_back_and_is_not_compiled_twice(folder, monkeypatch, caplog):
    full = "import raytrace.native.store as s, errno; p = s.private_files; p.write = lambda *_: (_ for _ in ()).throw("
    full += "OSError(errno.ENOSPC, 'No space left on device')); "
    monkeypatch.setattr(workers, "PROGRAM", full + workers.PROGRAM)

    def no_room(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    tasks = workers.missing(calls("f4"))
    with monkeypatch.context() as patch:
        patch.setattr(private_files, "write", no_room)  # the probe found room, but now the disk is full
        workers.compile_all(tasks)
    assert len(caplog.messages) == 1
    assert "No space left on device" in caplog.text
    assert workers.missing(calls("f4")) == []
    assert all(kernel.unkept(kinds).data for kernel, kinds in tasks)
    assert not list(folder.glob(f"*{store.SUFFIX}"))
    for kernel, _ in tasks:
        kernel._unkept.clear()


@pytest.mark.parametrize("flags", [["-I"], ["-X", "dev"], ["-W", "ignore::FutureWarning"], ["-P"], ["-E", "-s", "-OO"]])
def test_they_run_python_as_this_process_does(flags, tmp_path):
    """What flags mean is seen in ``sys``, in this process and in one that it starts."""
    state = "(sys.flags, sys.warnoptions, sorted(sys._xoptions))"
    program = f"""
import sys; sys.path.insert(0, {str(ROOT)!r})
from raytrace.native import workers
workers.PROGRAM = "import sys; print({state}, {{path!r}} == sys.path or sys.stdin.read())"
worker = workers._start()
print(worker.communicate()[0].decode().startswith(str({state})))
"""
    done = subprocess.run(
        [sys.executable, *flags, "-c", program], capture_output=True, text=True, timeout=60, cwd=tmp_path
    )
    assert done.stdout == "True\n", done.stderr


def test_where_nothing_can_be_kept_none_is_started(folder, monkeypatch):
    monkeypatch.setattr(workers, "_start", None)
    monkeypatch.setattr(store, "can_keep", lambda: False)
    workers.compile_all(workers.missing(calls("f4")))


def test_one_core_or_one_share_needs_no_other_process(folder, monkeypatch):
    monkeypatch.setattr(workers, "_start", None)
    workers.compile_all(workers.missing(calls("f4"))[:1])
    monkeypatch.setattr(parallel, "thread_count", lambda threads: threads or 1)
    workers.compile_all(workers.missing(calls("f4")))


def test_ctrl_c_ends_them_at_once(folder, monkeypatch):
    monkeypatch.setattr(workers, "PROGRAM", "import time; time.sleep(10**6)")
    started = []
    start = workers._start
    monkeypatch.setattr(workers, "_start", lambda: started.append(start()) or started[-1])

    def interrupt(*_):
        while not started:
            time.sleep(0.001)
        raise KeyboardInterrupt

    monkeypatch.setattr(parallel, "_follow", interrupt)
    with pytest.raises(KeyboardInterrupt):
        workers.compile_all(workers.missing(calls("f4")))  # would wait for days
    assert started
    assert all(process.poll() is not None for process in started)
