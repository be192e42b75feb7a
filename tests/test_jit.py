"""Kernels as Python sees them: what chooses their machine code, and that threads, forks and odd arrays do no harm."""

import gc
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from raytrace import jit
from raytrace.passes.light import background

ROOT = Path(__file__).parent.parent
nojit = pytest.mark.nojit
compiled = pytest.mark.skipif(jit.PLAIN, reason="kernels are plain functions")


class Rows(NamedTuple):
    """An array and a number."""

    a: np.ndarray
    first: int


@jit.subroutine
def twice(x):
    return x + x


@jit.inlined
def fourfold(x):
    return twice(twice(x))


def fresh():
    """A kernel that nothing was called with yet."""

    @jit.kernel
    def add(rows, weights, factor, out):
        """Sum of fourfold elements, or of products."""
        total = 0
        for i in range(rows.first, len(rows.a)):
            x = fourfold(rows.a[i])
            if weights is not None:
                x *= weights[i]
            out[i] = x * factor
            total += int(out[i])
        return total, len(rows.a)

    return add


def python(program, **environment):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=600, cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


# What it is called with -----------------------------------------------------------------------------------------------


@nojit
def test_a_kernel_does_what_its_function_says():
    add, a = fresh(), np.arange(4.0)
    out, expected = np.zeros(4), np.zeros(4)
    result = add(Rows(a, 0), None, 2, out)
    assert result == jit.interpreted(add)(Rows(a, 0), None, 2, expected) == (48, 4)
    assert out.tolist() == expected.tolist() == [0, 8, 16, 24]
    assert add(Rows(a, 0), a, 1, out) == (56, 4)
    assert add.__name__ == "add"
    assert add.__doc__.startswith("Sum of fourfold")


@compiled
def test_each_kind_of_arguments_has_machine_code_of_its_own():
    add = fresh()
    for dtype in ("f4", "f8", "i4"):
        for _ in range(2):
            assert add(Rows(np.ones(3, dtype), 0), None, 1, np.zeros(3, dtype)) == (12, 3)
    assert len(add.code) == 3
    assert add(Rows(np.ones(3), 0), np.full(3, 2.0), 1, np.zeros(3)) == (24, 3)
    assert add(Rows(np.ones(3), 0), None, np.uint32(3), np.zeros(3)) == (36, 3)
    assert len(add.code) == 5
    assert add(Rows(np.ones(3), 0), None, np.int64(3), np.zeros(3)) == (36, 3)  # as a Python integer
    assert len(add.code) == 5


@compiled
def test_arrays_of_any_layout_and_class_mean_the_same(tmp_path):
    add, a = fresh(), np.arange(12.0)
    expected = add(Rows(a, 0), None, 1, np.zeros(12))
    (tmp_path / "numbers").write_bytes(a.tobytes())
    pickled = pickle.loads(pickle.dumps(a))
    readonly = a.copy()
    readonly.flags.writeable = False
    for other in (
        np.repeat(a, 2)[::2],
        a[::-1].copy()[::-1],
        np.memmap(tmp_path / "numbers", "f8", "r"),
        a.view(type("Mine", (np.ndarray,), {})),
        pickled,
        readonly,
    ):
        assert add(Rows(other, 0), None, 1, np.zeros(12)) == expected
    variants = len(add.code)
    for _ in range(3):  # an unpickled array has a dtype object of its own
        add(Rows(pickle.loads(pickle.dumps(a)), 0), None, 1, np.zeros(12))
    assert len(add.code) == variants
    assert len(add._entries) <= variants + 2  # a class, and a memory map


@compiled
@pytest.mark.parametrize(("one", "other"), [("l", "q"), ("L", "Q"), ("i", "l")])
def test_c_types_of_one_size_are_one_kind(one, other):
    """intc and long are both int32 on Windows, long and longlong both int64 elsewhere; NumPy numbers them apart."""
    if np.dtype(one).name != np.dtype(other).name:
        pytest.skip("they differ on this machine")
    add = fresh()
    for letter in (one, other, one):
        assert add(Rows(np.ones(3, letter), 0), None, np.dtype(letter).type(1), np.zeros(3, letter)) == (12, 3)
    assert len(add.code) == 1


@compiled
def test_a_result_that_no_entry_can_give_back_is_refused():
    @jit.kernel
    def half(a):
        return 0.5 * a[0]

    with pytest.raises(NotImplementedError, match="a kernel may return integers"):
        half(np.ones(1))


@compiled
def test_arrays_of_several_axes_keep_their_strides():
    @jit.kernel
    def corner(table):
        return int(table[2, 1]), int(table[-1, 0]), table.shape[0], table.shape[1]

    table = np.arange(12.0).reshape(4, 3)
    for other in (table, np.asfortranarray(table), np.repeat(table, 2, axis=1)[:, ::2], table[::-1].copy()[::-1]):
        assert corner(other) == (7, 9, 4, 3)


@compiled
def test_what_no_kernel_takes_is_refused_by_name():
    add, a = fresh(), np.arange(4.0)
    unaligned = np.zeros(33, np.uint8)[1:].view(np.float64)
    for wrong, words in ((1.5, "float"), ("a", "str"), ([1.0], "list"), (True, "bool")):
        with pytest.raises(TypeError, match=f"can't take {words}"):
            add(Rows(a, 0), None, wrong, a)
    for wrong in (unaligned, a.astype(a.dtype.newbyteorder()), np.array(["a"]), np.array([None])):
        with pytest.raises(TypeError, match="aligned arrays of this machine's numbers"):
            add(Rows(wrong, 0), None, 1, a.copy())
    with pytest.raises(TypeError):
        add(Rows(a, 0), None, 1)
    with pytest.raises(OverflowError):
        add(Rows(a, 0), None, 2**63, a)
    assert add(Rows(a, 0), None, 1, np.zeros(4)) == (24, 4)


@compiled
def test_what_may_not_be_written_to_is_not():
    add, out = fresh(), np.zeros(4)
    out.flags.writeable = False
    with pytest.raises(Exception, match="readonly"):
        add(Rows(np.ones(4), 0), None, 1, out)
    assert not out.any()


@compiled
def test_a_kernel_that_needs_numbas_runtime_is_refused_with_the_reason():
    @jit.kernel
    def shout(a):
        print(a[0])  # noqa: T201

    with pytest.raises(NotImplementedError, match=r"shout calls .*numba_gil_ensure"):
        shout(np.zeros(1))


@compiled
def test_calls_leak_no_references():
    add, a, out = fresh(), np.arange(4.0), np.zeros(4)
    rows, factor = Rows(a, 0), 12345

    @jit.kernel
    def nothing(a):
        a[0] = 1.0

    add(rows, None, factor, out)
    nothing(out)
    with pytest.raises(TypeError):
        add(rows, None, "x", out)
    gc.collect()
    before = [sys.getrefcount(thing) for thing in (a, rows, factor, out, None, NotImplemented)]
    for _ in range(1000):
        assert add(rows, None, factor, out)
        assert nothing(out) is None
    after = [sys.getrefcount(thing) for thing in (a, rows, factor, out, None, NotImplemented)]
    assert max(now - then for then, now in zip(before, after, strict=True)) < 100


# Threads and processes ------------------------------------------------------------------------------------------------


@compiled
def test_threads_that_call_it_first_at_once_compile_it_once():
    add, results, go = fresh(), [], threading.Barrier(4)

    def call():
        go.wait()
        results.append(add(Rows(np.ones(5), 0), None, 1, np.zeros(5)))

    threads = [threading.Thread(target=call) for _ in range(4)]
    with jit.on_compile() as compiling:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert results == [(20, 5)] * 4
    assert compiling.count == len(add.code) == len(add._entries) == 1


@compiled
def test_kernels_let_go_of_the_interpreter():
    @jit.kernel
    def spin(n):
        x = 1
        for _ in range(n):
            x = (x * 6364136223846793005 + 1442695040888963407) ^ (x >> 13)
        return x

    spin(1)
    turns, thread = 0, threading.Thread(target=spin, args=(10**9,))
    thread.start()
    while thread.is_alive():
        turns += 1
        time.sleep(0.001)
    assert turns > 3


@compiled
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_child_that_was_forked_in_the_midst_of_compiling_can_call_kernels():
    program = """
import os, threading, numpy as np
from raytrace import jit

@jit.kernel
def first(a):
    return len(a)

@jit.kernel
def second(a):
    return len(a) + 1

first(np.zeros(3))
begun = threading.Event()
def compile():
    with jit.on_compile(begun.set):
        second(np.zeros(3))
thread = threading.Thread(target=compile)
thread.start()
begun.wait()
child = os.fork()
if child == 0:
    os._exit(10 * first(np.zeros(4)) + second(np.zeros(4)) + second(np.zeros(4, np.float32)))
thread.join()
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), second(np.zeros(5)))
"""
    assert python(program) == ["50", "6"]


@compiled
def test_a_kernel_is_pickled_by_its_name():
    assert pickle.loads(pickle.dumps(background)) is background


# Modes ----------------------------------------------------------------------------------------------------------------


@nojit
def test_without_the_jit_kernels_are_plain_functions_that_divide_as_kernels_do():
    program = """
import sys, numpy as np
from raytrace import jit
@jit.kernel
def inverse(a):
    return 1 / a[0]
print(inverse(np.zeros(1)), jit.interpreted(inverse) is inverse, "numba" in sys.modules)
"""
    assert python(program, NUMBA_DISABLE_JIT="1") == ["inf", "True", "False"]


CHECKED = """
import sys, numpy as np
from raytrace.passes.film import accumulate
try:
    accumulate(np.zeros(12), 7, 8, np.zeros((2, 4)), 0, 4)
except IndexError as error:
    print(error)
print("numba" in sys.modules)
"""


@compiled
def test_an_index_out_of_bounds_is_an_error_where_they_are_checked(tmp_path):
    for numba in ("True", "False"):  # the second time from the store
        found = python(CHECKED, NUMBA_BOUNDSCHECK="1", RAYTRACE_CACHE=str(tmp_path))
        assert " ".join(found) == f"index is out of bounds {numba}"
    assert len(list(tmp_path.iterdir())) == 1
    python(CHECKED.replace("(2, 4)", "(12, 4)"), RAYTRACE_CACHE=str(tmp_path))
    assert len(list(tmp_path.iterdir())) == 2  # code that does not check is another


@compiled
def test_compiling_is_counted_and_announced_once():
    announced, add = [], fresh()
    with jit.on_compile(lambda: announced.append(True)) as compiling:
        add(Rows(np.ones(2), 0), None, 1, np.zeros(2))
        assert compiling.count == 1
        seconds = compiling.seconds
        assert seconds > 0
        add(Rows(np.ones(2), 0), None, 1, np.zeros(2))
        assert compiling.count == 1
        add(Rows(np.ones(2, "f4"), 0), None, 1, np.zeros(2))
        assert compiling.count == 2
        assert compiling.seconds > seconds
    assert announced == [True]
    add(Rows(np.ones(2, "i4"), 0), None, 1, np.zeros(2))  # after the end nothing is counted
    assert compiling.count == 2
