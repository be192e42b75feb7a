"""Work on threads: all of it done, in the caller's hands."""

import threading
import time

import pytest

from raytrace.parallel import run, thread_count

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
    together = threading.Barrier(3, timeout=20)
    assert run(lambda _: together.wait(), range(9), 3)  # would time out with fewer
    workers = set()
    run(lambda _: workers.add(threading.get_ident()), range(50), 1)
    assert len(workers) == 1
    assert threading.get_ident() not in workers


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
        run(task, range(10_000), 2)
    assert set(range(5)) <= set(done)
    assert len(done) < 100


def test_stop_ends_early_and_says_so():
    done = []
    assert not run(done.append, range(10_000), 2, stop=lambda: len(done) >= 10)
    assert 10 <= len(done) < 1000
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
        run(task, range(100), 2, report=interrupt)
    count = len(finished)
    assert 1 <= count < 10
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


@pytest.mark.parametrize("threads", [0, -1])
def test_fewer_threads_than_one_are_refused(threads):
    with pytest.raises(ValueError, match=f"threads: .*at least 1.*{threads}"):
        thread_count(threads)
    with pytest.raises(ValueError, match="threads"):
        run(print, [1], threads)


def test_without_a_wish_all_cores_of_the_process_work():
    assert thread_count(None) >= 1
    assert thread_count(3) == 3
