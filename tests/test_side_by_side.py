"""Many renders at once and one after the other: in threads, in processes, after a fork, interrupted and gone on."""

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import raytrace as rt
from raytrace import thread_pool
from raytrace.jit import PLAIN
from signals import default_signals

ROOT = Path(__file__).parents[1]
SCENES = [ROOT / f"scenes/{name}.json" for name in ("cornell-box-glass", "glass-sphere", "room")]
ASK = {"spp": 4, "size": (64, 48)}
compiled = pytest.mark.skipif(PLAIN, reason="kernels are plain functions")
forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
HEAD = """
import hashlib, json, multiprocessing, os, signal, sys, threading, time
import raytrace as rt

def draw(name, threads=None):
    image = rt.render(f"scenes/{name}.json", spp=4, size=(64, 48), threads=threads)
    assert image.complete
    return hashlib.sha256(image.rgb.tobytes()).hexdigest()

NAMES = ["cornell-box-glass", "glass-sphere", "room"]
"""


def digest(image: rt.Render) -> str:
    return hashlib.sha256(image.rgb.tobytes()).hexdigest()


@pytest.fixture(scope="module")
def alone() -> dict[str, str]:
    """What each scene looks like when it is drawn by itself."""
    return {path.stem: digest(rt.render(path, **ASK)) for path in SCENES}


def start(tmp_path: Path, program: str, **environment: str) -> "subprocess.Popen[str]":
    """A program in a file, as spawned processes want it."""
    path = tmp_path / f"program{len(list(tmp_path.iterdir()))}.py"
    path.write_text(HEAD + program, "utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    pipe = subprocess.PIPE
    words = [sys.executable, "-W", "error", "-W", "ignore:This process:DeprecationWarning", str(path)]
    ready = None if os.name == "nt" else default_signals
    return subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, cwd=ROOT, env=environment, preexec_fn=ready)


def finish(process: "subprocess.Popen[str]") -> list[str]:
    out, err = process.communicate(timeout=240)
    assert process.returncode == 0, err
    return out.split()


# at once --------------------------------------------------------------------------------------------------------------


def test_threads_of_one_process_draw_at_once(alone):
    with ThreadPoolExecutor(6) as pool:
        drawn = list(pool.map(lambda path: (path.stem, digest(rt.render(path, **ASK))), SCENES * 4))
    assert drawn == [(path.stem, alone[path.stem]) for path in SCENES * 4]


def test_threads_draw_one_scene_at_once_with_what_each_asks_for(alone):
    scene = rt.load(SCENES[0])
    asked = [
        ASK | {"precision": precision, "threads": threads} for precision in ("float32", "float64") for threads in (1, 3)
    ]
    expected = [digest(rt.render(SCENES[0], **ask)) for ask in asked]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda ask: digest(rt.render(scene, **ask)), asked * 3)) == expected * 3


@pytest.mark.parametrize(
    "method", [pytest.param("fork", marks=forks), pytest.param("forkserver", marks=forks), "spawn"]
)
def test_processes_draw_at_once(tmp_path, alone, method):
    program = f"""
if __name__ == "__main__":
    if {method!r} == "fork":
        draw("room")  # the parent has drawn before
    with multiprocessing.get_context({method!r}).Pool(2) as pool:
        print(*pool.map(draw, NAMES * 2))
"""
    assert finish(start(tmp_path, program)) == list(alone.values()) * 2


@forks
@compiled
def test_a_child_forked_while_others_draw_draws_too(tmp_path, alone):
    program = """
draw("room")
busy = threading.Thread(target=lambda: [draw("room") for _ in range(6)])
busy.start()
for name in NAMES:
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(writer, draw(name).encode())
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    print(os.read(reader, 100).decode())
busy.join()
"""
    assert finish(start(tmp_path, program)) == list(alone.values())


# interrupted ----------------------------------------------------------------------------------------------------------


class Stop:
    """Interrupt the render when it has begun."""

    def __call__(self, event):
        if event.stage == "rendering":
            raise KeyboardInterrupt


def test_what_was_interrupted_goes_on_in_the_same_process(alone):
    """As a cell of a notebook that is stopped and run again."""
    scene = rt.load(SCENES[0])
    for _ in range(5):
        stopped = rt.render(scene, spp=256, size=(256, 256), progress=Stop())
        assert stopped.interrupted
        assert not stopped.complete
        assert not thread_pool._unfinished  # all threads wait for the next call
        assert digest(rt.render(scene, **ASK)) == alone[SCENES[0].stem]


@compiled
@pytest.mark.skipif(sys.platform == "win32", reason="signals are sent otherwise there")
def test_signals_at_any_time_leave_a_process_that_draws(tmp_path, alone):
    program = """
scene, seen = rt.load("scenes/room.json"), 0
rt.render(scene, spp=1, size=(64, 48))
for k in range(25):
    timer = threading.Timer(0.002 + 0.004 * k, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        image = rt.render(scene, spp=64, size=(256, 192))
        seen += image.interrupted
        timer.join()
        time.sleep(0.01)  # the signal may come after all
    except KeyboardInterrupt:
        seen += 1
    while timer.is_alive():
        timer.join()
print(seen, *map(draw, NAMES))
"""
    seen, *drawn = finish(start(tmp_path, program))
    assert int(seen) >= 20
    assert drawn == list(alone.values())


# one after the other --------------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
def test_renders_leave_nothing_behind(tmp_path):
    """In a process of its own; a thousand by ``tests/bench/thousand.py``."""
    program = f"""
import ctypes, gc

def taken():
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # what is free and only kept for later does not count
    memory = int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return memory, threading.active_count(), len(os.listdir("/proc/self/fd"))

scene = rt.load("scenes/room.json")
for k in range(120):
    if k == 30:
        before = taken()
    image = rt.render(scene if k % 2 else f"scenes/{{NAMES[k // 2 % 3]}}.json", spp=1, size=(32, 24), seed=k)
    image.save({str(tmp_path / "a.png")!r})
print(*(now - then for now, then in zip(taken(), before)))
"""
    grown, threads, files = map(int, finish(start(tmp_path, program)))
    assert (threads, files) == (0, 0)
    assert grown < 1e7  # a film kept by each would be 1.3e7


# one kernel store -----------------------------------------------------------------------------------------------------

LITTLE = """
import numpy as np
from raytrace.native import store
from raytrace.passes.light import background
from raytrace.records import Hits
def ask():
    hits = Hits(np.zeros(16), np.full(16, -1, np.int32), np.zeros(16), np.zeros(16))
    radiance = np.zeros(48)
    background(hits, radiance, np.ones(3))
    return radiance.sum()
"""


@compiled
def test_processes_share_a_store_that_is_deleted_under_them(tmp_path):
    cache = tmp_path / "cache"
    program = LITTLE + "print(ask())"
    vandal = """
import pathlib, shutil
end = time.time() + 4
while time.time() < end:
    shutil.rmtree(os.environ["RAYTRACE_CACHE"], ignore_errors=True)
    time.sleep(0.02)
"""
    deleting = start(tmp_path, vandal, RAYTRACE_CACHE=str(cache))
    processes = [start(tmp_path, program, RAYTRACE_CACHE=str(cache)) for _ in range(2)]
    assert [finish(process) for process in processes] == [["48.0"]] * 2
    finish(deleting)
    assert finish(start(tmp_path, program, RAYTRACE_CACHE=str(cache))) == ["48.0"]
    assert len([path for path in cache.rglob("*") if path.is_file()]) == 1


@compiled
@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL there")
def test_a_process_killed_while_it_writes_leaves_a_store_of_use(tmp_path):
    environment = {"RAYTRACE_CACHE": str(tmp_path / "cache")}
    dying = """
real = os.replace
os.replace = lambda *names: os.kill(os.getpid(), signal.SIGKILL)
"""
    process = start(tmp_path, dying + LITTLE + "ask()", **environment)
    process.communicate(timeout=240)
    assert process.returncode == -9
    assert [path.suffix for path in (tmp_path / "cache").rglob("*.*")] == [".tmp"]
    assert finish(start(tmp_path, LITTLE + "print(ask())", **environment)) == ["48.0"]
    kept = sorted(path.suffix for path in (tmp_path / "cache").rglob("*.*"))
    assert kept == [".kernel", ".tmp"]
    assert finish(start(tmp_path, LITTLE + "print(ask(), 'numba' in sys.modules)", **environment)) == ["48.0", "False"]
