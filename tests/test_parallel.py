"""Work on threads: all of it done, in the caller's hands."""

import subprocess
import sys
import textwrap
import threading
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from raytrace import parallel, thread_pool
from raytrace.jit import PLAIN
from raytrace.parallel import run, share_out, thread_count

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize("threads", [1, 2, 7, None])
@pytest.mark.parametrize("count", [0, 1, 100])
def test_every_item_is_done_once(count, threads):
    done, reported = [], []
    assert run(done.append, range(count), threads, report=reported.append)
    assert sorted(done) == list(range(count))
    assert reported == sorted(reported)
    assert reported[-1:] == ([count] if count else [])


def test_as_many_threads_work_as_asked_for():
    together = threading.Barrier(3, timeout=600)
    assert run(lambda _: together.wait(), range(9), 3)  # would time out with fewer
    workers = set()
    run(lambda _: workers.add(threading.get_ident()), range(50), 1)
    assert len(workers) == 1
    assert (threading.get_ident() in workers) == PLAIN  # where a debugger looks


def test_reports_come_in_the_callers_thread():
    heard = set()
    run(lambda _: None, range(5), 2, report=lambda _: heard.add(threading.get_ident()))
    assert heard == {threading.get_ident()}


def test_an_error_is_raised_here_and_ends_the_rest():
    done = []

    def task(item):
        if item == 5:
            raise ZeroDivisionError("item 5")
        time.sleep(0.001)
        done.append(item)

    with pytest.raises(ZeroDivisionError, match="item 5"):
        run(task, range(10**9), 2)  # all of them would take days
    assert set(range(5)) <= set(done)


def test_stop_ends_early_and_says_so():
    done = []
    assert not run(done.append, range(10**8), 2, stop=lambda: len(done) >= 10)
    assert 10 <= len(done) < 10**8
    assert sorted(done) == list(range(len(done)))  # what was begun is finished
    assert not run(done.append, range(3), 1, stop=lambda: True)
    assert run(done.append, [], 1, stop=lambda: True)


def test_an_interrupt_waits_for_what_is_under_way():
    finished = []

    def task(item):
        time.sleep(0.05)
        finished.append(item)

    def interrupt(_done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(task, range(10**6), 2, report=interrupt)  # all of them would take hours
    count = len(finished)
    assert count >= 1
    time.sleep(0.12)
    assert len(finished) == count


def test_items_are_taken_as_they_are_needed():
    taken = []

    def items():
        for i in range(1000):
            taken.append(i)
            yield i

    run(lambda _: None, items(), 2, stop=lambda: len(taken) > 20)
    assert len(taken) < 100


@pytest.mark.parametrize("given", [0, 1])  # threads, before the system has no more
def test_where_there_are_no_more_threads_the_others_do_the_work(given, monkeypatch):
    start, started = threading.Thread.start, []

    def grudging(thread):
        if len(started) == given:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", grudging)
    monkeypatch.setattr(thread_pool, "_idle", [])  # of threads that were started before
    done, reported = [], []
    assert run(done.append, range(100), 3, report=reported.append)
    assert sorted(done) == list(range(100))
    assert reported == list(range(1, 101))


def test_work_is_done_while_the_interpreter_ends():
    program = """
        from raytrace.parallel import run
        class Last:
            def __del__(self, run=run):
                done = []
                print(run(done.append, range(9), 2), sorted(done) == list(range(9)))
        last = Last()
    """
    words = [sys.executable, "-c", textwrap.dedent(program)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, cwd=Path(__file__).parents[1])
    assert (done.returncode, done.stdout, done.stderr) == (0, "True True\n", "")


# --- rows ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def ranges(monkeypatch):
    """``ranges(n, threads, pace)``: ranges in order, and threads woken, if a row takes ``pace`` seconds."""
    clock, start = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now), thread_pool.start
    monkeypatch.setattr(parallel, "time", clock)
    woken = []
    monkeypatch.setattr(thread_pool, "start", lambda work, count: [woken.append(count), start(work, count)][1])

    def trial(n, threads, pace):
        got = []
        woken.clear()

        def task(begin, end):
            got.append((begin, end))
            clock.now += (end - begin) * pace

        share_out(task, n, threads)
        return sorted(got), sum(woken)

    return trial


@pytest.mark.parametrize("threads", [1, 3, None])
@pytest.mark.parametrize("n", [0, 1, 1023, 1024, 1025, 50_000])
def test_ranges_make_up_all_rows(ranges, n, threads):
    got, _ = ranges(n, threads, 1e-6)
    assert [begin for begin, _ in got[:1]] == [0][: n > 0]
    assert [end for _, end in got[-1:]] == [n][: n > 0]
    assert all(left[1] == right[0] for left, right in pairwise(got))
    assert all(begin < end for begin, end in got)
    assert all(begin % 1024 == 0 for begin, _ in got)  # so that packets are the same, however rows are shared out


def test_little_work_stays_in_the_callers_thread(ranges):
    assert ranges(1024, 4, 1e-5)[1] == 0
    assert ranges(5000, 4, 1e-8)[1] == 0
    assert ranges(20_000, 1, 1e-6)[1] == 0
    assert ranges(1024 + 25_000, 4, 1e-8)[1] == 1  # 0.25 ms after the first range
    assert ranges(200_000, 4, 1e-6)[1] == 3  # the first range is done here, the others by threads


def test_ranges_are_as_long_as_an_interrupt_may_wait(ranges):
    most = {pace: max(end - begin for begin, end in ranges(9_000_000, 1, pace)[0]) for pace in (1e-5, 1e-6, 1e-9, 0)}
    assert most == {1e-5: 9216, 1e-6: 99328, 1e-9: parallel.MAX_RANGE, 0: parallel.MAX_RANGE}
    assert len(ranges(10_000, 2, 1e-3)[0]) == 10  # 1024 rows take 1 s: there is nothing shorter


def test_ranges_get_shorter_towards_the_end(ranges):
    for threads in (1, 3):
        sizes = [end - begin for begin, end in ranges(2_000_000, threads, 1e-8)[0][1:]]
        assert sizes == sorted(sizes, reverse=True)
        assert sizes[0] == parallel.MAX_RANGE
        assert all(size <= max(parallel.MIN_RANGE, sum(sizes[k:]) / threads) for k, size in enumerate(sizes))


@pytest.mark.parametrize(("n", "threads"), [(100, 1), (100_000, 1), (100_000, 2)])
def test_an_error_in_a_range_is_raised_here(n, threads):
    def task(begin, end):
        time.sleep(1e-6 * (end - begin))
        return 1 // (n - end)

    with pytest.raises(ZeroDivisionError):
        share_out(task, n, threads)


# --- how many --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [0, -1])
def test_fewer_threads_than_one_are_refused(threads):
    with pytest.raises(ValueError, match=f"threads: .*at least 1.*{threads}"):
        thread_count(threads)
    for call in (lambda: run(print, [1], threads), lambda: share_out(print, 0, threads)):
        with pytest.raises(ValueError, match="threads"):
            call()


@pytest.mark.parametrize("threads", [1.0, "2", np.float32(2)])
def test_a_number_of_threads_is_whole(threads):
    with pytest.raises(ValueError, match="threads: expected a whole number"):
        thread_count(threads)
    assert thread_count(np.int8(2)) == 2


def test_without_a_wish_all_cores_of_the_process_work():
    assert thread_count(None) >= 1
    assert thread_count(3) == 3
