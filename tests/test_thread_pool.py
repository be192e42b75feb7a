"""Threads that wait for work: used again, each by one caller at a time, and gone where the process forks."""

import os
import subprocess
import sys
import textwrap
import threading
import weakref
from pathlib import Path

import pytest

from raytrace import thread_pool
from raytrace.parallel import run, together

pytestmark = pytest.mark.nojit


@pytest.fixture(autouse=True)
def _no_threads_of_others(monkeypatch):
    monkeypatch.setattr(thread_pool, "_idle", [])
    yield
    thread_pool._dismiss()


def output_of(program):
    words = [sys.executable, "-c", textwrap.dedent(program)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, cwd=Path(__file__).parents[1])
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_threads_are_used_again():
    seen = set()
    for _ in range(20):
        meet = threading.Barrier(3, timeout=600)
        run(lambda _, meet=meet: [seen.add(threading.get_ident()), meet.wait()], range(3), 3)
    assert len(seen) == 3
    assert threading.get_ident() not in seen


def test_no_thread_is_started_where_the_callers_is_enough():
    before = threading.active_count()
    together(lambda _: None, range(5), 1)
    assert threading.active_count() == before


def test_calls_within_calls_and_from_several_threads_end():
    sums = []

    def inner(item):
        together(lambda k: sums.append(item * 4 + k), range(4), 3)

    callers = [threading.Thread(target=together, args=(inner, range(k, 40, 4), 3)) for k in range(4)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert sorted(sums) == list(range(160))


def test_after_an_error_the_thread_works_again():
    for _ in range(3):
        with pytest.raises(ZeroDivisionError):
            run(lambda item: 1 // (2 - item), range(5), 2)
        done = []
        assert run(done.append, range(5), 2)
        assert sorted(done) == list(range(5))


def test_work_that_no_thread_has_begun_is_taken_back(monkeypatch):
    monkeypatch.setattr(threading.Thread, "start", lambda thread: None)  # the cores are busy, for ever
    done = []
    together(done.append, range(9), 3)
    assert done == list(range(9))
    (worker, other), before = thread_pool._idle, set(thread_pool._unfinished)
    assert worker.tasks.empty()
    assert other.tasks.empty()
    assert not before
    thread_pool._idle.clear()  # threads that never run can't be dismissed


def test_a_thread_keeps_nothing_of_its_work():
    class Large:
        def work(self):
            pass

    large = Large()
    gone = weakref.ref(large)
    jobs = thread_pool.start(large.work, 2, busy=True)
    for job in jobs:
        job.done.acquire()
    del large
    assert gone() is None


def test_threads_beyond_those_kept_end(monkeypatch):
    monkeypatch.setattr(thread_pool, "KEPT", 1)
    meet = threading.Barrier(3, timeout=600)
    jobs = thread_pool.start(meet.wait, 3, busy=False)
    thread_pool.join(jobs)
    assert len(thread_pool._idle) == 1
    for job in jobs:
        if job.worker not in thread_pool._idle:
            job.worker.thread.join(timeout=600)
            assert not job.worker.thread.is_alive()


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="cores can't be chosen")
def test_threads_use_the_cores_of_their_caller():
    cores, seen = os.sched_getaffinity(0), []
    if len(cores) == 1:
        pytest.skip("there is one core")
    try:
        for allowed in (cores, {min(cores)}, cores):
            os.sched_setaffinity(0, allowed)
            (job,) = thread_pool.start(lambda: seen.append(os.sched_getaffinity(0)), 1, busy=False)
            job.done.acquire()
            assert seen[-1] == allowed
    finally:
        os.sched_setaffinity(0, cores)


@pytest.mark.parametrize(
    ("allowed", "count", "busy", "shares"),
    [
        ({0, 1}, 2, False, [{0}, {1}]),
        ({0, 1}, 1, True, [{1}]),
        ({0, 1}, 1, False, [{0, 1}]),
        ({0, 2, 3, 5, 7}, 2, False, [{0, 3, 7}, {2, 5}]),
        ({0, 2, 3, 5, 7}, 2, True, [{2, 5}, {3, 7}]),
        ({0, 1}, 3, False, [{0}, {1}, {0}]),
        ({0}, 2, True, [{0}, {0}]),
        (set(), 2, True, [set(), set()]),  # where the system does not say
    ],
)
def test_threads_share_out_the_cores_and_leave_a_busy_caller_its_own(allowed, count, busy, shares, monkeypatch):
    placed = []
    monkeypatch.setattr(thread_pool, "_core", lambda: {0})
    monkeypatch.setattr(thread_pool, "_affinity", lambda: allowed)
    monkeypatch.setattr(thread_pool.Worker, "place", lambda worker, cores: placed.append(cores))
    thread_pool.join(thread_pool.start(lambda: None, count, busy))
    assert placed == shares


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says on which core a thread runs")
def test_the_core_of_the_caller_is_one_that_it_may_use():
    assert len(thread_pool._core()) == 1
    assert thread_pool._core() <= os.sched_getaffinity(0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_process_has_threads_of_its_own():
    printed = output_of("""
        import os, sys, threading
        from raytrace.parallel import run
        meet = threading.Barrier(2, timeout=600)
        run(lambda _: meet.wait(), range(2), 2)
        child = os.fork()
        alone = threading.active_count() == 1
        run(lambda _: meet.wait(), range(2), 2)
        if child:
            assert os.waitpid(child, 0)[1] == 0
        print(alone, flush=True)
    """)
    assert printed == "True\nTrue\n"


@pytest.mark.parametrize("daemon", [False, True])
def test_the_process_ends_after_its_work(daemon):
    printed = output_of(f"""
        import threading, time
        from raytrace import thread_pool
        begun = threading.Event()
        def work():
            begun.set()
            time.sleep(600 if {daemon} else 0.05)
            print("done", flush=True)
        caller = threading.Thread(target=thread_pool.start, args=(work, 1, True), daemon={daemon})
        caller.start()
        begun.wait()
    """)
    assert printed == ("" if daemon else "done\n")
