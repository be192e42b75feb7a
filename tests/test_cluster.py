"""Workers of a Dask cluster: the same bits, whoever dies, joins late, has other registers or another version."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.accel.lanes import BITS
from raytrace.errors import OptionError
from same_pictures import assert_same
from small_scenes import studio

pytest.importorskip("distributed", reason="needs Dask: pip install '.[cluster]'")

import dask
from distributed import Client

from raytrace.rendering import cluster, run
from raytrace.rendering.cluster import connect

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"
SIZE = (96, 70)
WAYS = {
    "uniform": {"spp": 16},
    "time limit": {"spp": 9, "time_limit": 1e6},
    "target error": {"target_error": 2e-3, "spp": 64},
    "crop": {"spp": 16, "crop": (7, 9, 60, 40)},
    "path": {"spp": 8, "integrator": "path", "precision": "float32"},
}
SCHEDULER = """
import asyncio
from distributed import Scheduler
async def main():
    async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
        print(scheduler.address, flush=True)
        await scheduler.finished()
asyncio.run(main())
"""
WORKER = """
import asyncio, os, sys
address, name, log, bits, version, threads = sys.argv[1:]
import raytrace.accel.lanes as lanes
lanes.BITS = int(bits) or lanes.BITS  # as on a machine with other registers
import raytrace
raytrace.__version__ = version
from raytrace.rendering import cluster_worker
from distributed import Worker
log = os.open(log, os.O_CREAT | os.O_APPEND | os.O_WRONLY)
def logged(function, what):
    def wrapper(*args):
        os.write(log, (what(*args) + "\\n").encode())
        return function(*args)
    return wrapper
cluster_worker.loads = logged(cluster_worker.loads, lambda content: f"{name} scene")
cluster_worker.RenderThreads.__init__ = logged(cluster_worker.RenderThreads.__init__, lambda *args: f"{name} crew")
words = lambda scene, order, x, y, samples, sums: f"{name} part {x[0]} {y[0]} {samples}"
cluster_worker._draw = logged(cluster_worker._draw, words)
async def main():
    async with Worker(address, nthreads=int(threads), name=name, dashboard=False) as one:
        await one.finished()
asyncio.run(main())
"""


class Machines:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder):
        self.folder, self.log, self.processes = folder, folder / "log", {}
        scheduler = self._start("scheduler", SCHEDULER, stdout=subprocess.PIPE, text=True)
        self.address = scheduler.stdout.readline().strip()
        self.client = Client(self.address, set_as_default=False)

    def _start(self, name, program, *words, **options):
        env = {**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})}
        words = [sys.executable, "-c", program, *map(str, words)]
        self.processes[name] = subprocess.Popen(words, env=env, stderr=subprocess.DEVNULL, cwd=self.folder, **options)
        return self.processes[name]

    def add(self, name, bits=0, version=rt.__version__, threads=1):
        """Start a worker; kernels for other registers lie in a cache of their own."""
        env = {"RAYTRACE_CACHE": str(self.folder / f"kernels-{bits}")} if bits else {}
        self._start(name, WORKER, self.address, name, self.log, bits, version, threads, env=env)

    def wait(self, count):
        """Wait until there are so many workers."""
        end = time.monotonic() + 600
        while len(self.client.nthreads()) != count:
            assert time.monotonic() < end
            time.sleep(0.05)

    def remove(self, name):
        process = self.processes.pop(name)
        process.kill()
        process.communicate()

    def lines(self, name=""):
        """What workers noted, without their names' first letters."""
        known = self.log.read_text().splitlines() if self.log.exists() else []
        return [line for line in known if line.startswith(name)]

    def close(self):
        with contextlib.suppress(Exception):
            self.client.close(timeout=2)
        for name in list(self.processes)[::-1]:
            self.remove(name)


@pytest.fixture(scope="module")
def scene():
    return studio()


@pytest.fixture
def machines(tmp_path):
    made = Machines(tmp_path)
    yield made
    made.close()


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two workers that nothing happens to."""
    made = Machines(tmp_path_factory.mktemp("pair"))
    made.add("a")
    made.add("b")
    made.wait(2)
    yield made
    made.close()


@pytest.fixture(autouse=True)
def many_parts(monkeypatch):
    monkeypatch.setattr(cluster, "RATE", 1.0)


def once(count, act):
    """Progress that acts when so many parts are done."""
    acted = False

    def progress(event):
        nonlocal acted
        if event.stage == "rendering" and event.done >= count and not acted:
            acted = True
            act()

    return progress


def interrupt_in_the_last_pass(event):
    """Of passes that have as many parts each."""
    if event.stage == "rendering" and 0.8 * event.total < event.done < event.total:
        raise KeyboardInterrupt


def interrupt():
    raise KeyboardInterrupt


# The same bits --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
def test_a_cluster_draws_the_same_bits(scene, pair, way):
    ask = {"size": SIZE, **WAYS[way]}
    here, events = rt.render(scene, **ask), []
    there = rt.render(scene, client=pair.client, progress=events.append, **ask)
    assert_same(here, there)
    assert there.stats["seconds_by_pass"].keys() == here.stats["seconds_by_pass"].keys()
    assert {event.stage for event in events} <= {"rendering", "compiling"}
    drawn = [event for event in events if event.stage == "rendering"]
    assert drawn[-1].done == drawn[-1].total > 1
    assert drawn[-1].rays == sum(there.stats["rays"].values())


def test_layers_are_traced_here(scene, pair):
    there = rt.render(scene, size=SIZE, spp=1, aov=["depth"], client=pair.client)
    assert np.array_equal(there.aov["depth"], rt.render(scene, size=SIZE, spp=1).aov["depth"])


def test_parts_of_the_light_come_from_the_workers(pair):
    ask = {"size": SIZE, "spp": 4, "aov": ["emission", "direct", "indirect"]}
    box = rt.load(ROOT / "scenes" / "cornell-box-area.json")
    here, there = rt.render(box, **ask), rt.render(box, client=pair.client, **ask)
    assert_same(here, there)
    for name in ask["aov"]:
        assert there.aov[name].any()
        assert np.array_equal(here.aov[name], there.aov[name])


def test_machines_with_other_registers_draw_the_same_bits(machines):
    ask = {"size": SIZE, "spp": 64}
    for bits in (128, 256, 512):
        machines.add(f"w{bits}", 0 if bits == BITS else bits)  # its own: its kernels are there
    machines.wait(3)
    box = rt.load(BOX)
    here = rt.render(box, **ask)
    for _ in range(5):  # the first picture may be done before all have compiled
        assert_same(here, rt.render(box, client=machines.client, **ask))
        if all(machines.lines(f"w{bits} part") for bits in (128, 256, 512)):
            break
        time.sleep(5)
    assert all(machines.lines(f"w{bits} part") for bits in (128, 256, 512))


def test_a_scene_travels_once_and_its_tree_is_built_once(scene, pair):
    pair.log.write_text("")
    for seed in (11, 12):
        rt.render(scene, size=SIZE, spp=4, seed=seed, client=pair.client)
    for name in "ab":
        assert len(pair.lines(f"{name} scene")) <= 1  # it may be known from another test
        assert len(pair.lines(f"{name} crew")) <= 2  # a picture's
    assert pair.lines("a part") or pair.lines("b part")


# Machines that come and go --------------------------------------------------------------------------------------------


def test_a_killed_worker_costs_no_more_than_its_own_unfinished_parts(scene, machines):
    ask = {"size": (256, 256), "spp": 48}
    machines.add("a")
    machines.add("b")
    machines.wait(2)
    here = rt.render(scene, **ask)
    rt.render(scene, size=SIZE, spp=1, client=machines.client)  # both are ready
    machines.log.write_text("")
    there = rt.render(scene, client=machines.client, progress=once(8, lambda: machines.remove("b")), **ask)
    assert_same(here, there)
    drawn = [line.split(" ", 1)[1] for line in machines.lines() if " part " in line]
    lost = {line.split(" ", 1)[1] for line in machines.lines("b part")}
    again = [line for line in set(drawn) if drawn.count(line) > 1]
    assert lost
    assert set(again) <= lost
    assert len(drawn) - len(set(drawn)) <= 1 + cluster.AHEAD  # under way, or drawn and not yet fetched


def test_a_worker_that_joins_late_helps(scene, machines):
    ask = {"size": (256, 256), "spp": 96}
    machines.add("a")
    machines.wait(1)

    def join():
        machines.add("b")
        machines.wait(2)

    there = rt.render(scene, client=machines.client, progress=once(2, join), **ask)
    assert_same(rt.render(scene, **ask), there)
    assert machines.lines("b part")


def test_a_render_waits_for_its_first_worker(scene, machines):
    machines.add("a")  # is there some seconds later
    assert_same(rt.render(scene, size=SIZE, spp=4), rt.render(scene, size=SIZE, spp=4, client=machines.client))


def test_a_worker_of_another_version_is_refused_by_name(scene, machines, caplog):
    machines.add("a")
    machines.add("old", version="0.0.9")
    machines.wait(2)
    there = rt.render(scene, size=SIZE, spp=16, client=machines.client)
    assert_same(rt.render(scene, size=SIZE, spp=16), there)
    assert not machines.lines("old part")
    (told,) = [record.getMessage() for record in caplog.records if "is not used" in record.getMessage()]
    machines.remove("a")
    machines.wait(1)
    (address,) = machines.client.nthreads()
    assert told.startswith(f"cluster: worker {address} is not used: it has raytrace 0.0.9 (")
    assert f"not {rt.__version__} (" in told
    with pytest.raises(OptionError, match="no worker has raytrace"):
        rt.render(scene, size=SIZE, spp=16, client=machines.client)


def test_a_scheduler_that_goes_is_told_and_the_checkpoint_stays(scene, machines, tmp_path):
    machines.add("a")
    machines.wait(1)
    file, ask = tmp_path / "a.checkpoint", {"size": (256, 128), "spp": 16}
    ask_there = {
        "client": machines.client,
        "checkpoint": file,
        "progress": once(8, lambda: machines.remove("scheduler")),
    }
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(OptionError, match="the connection to the scheduler is lost"),
    ):
        rt.render(scene, **ask_there, **ask)
    rest = rt.render(scene, checkpoint=file, **ask)
    whole = rt.render(scene, **ask)
    assert_same(whole, rest)
    assert rest.stats["rays"]["camera"] < whole.stats["rays"]["camera"]


class PausedFuture:
    """What never comes."""

    def __init__(self, status):
        self.status = status

    def add_done_callback(self, _call):
        pass


class Paused:
    """A client whose only worker has paused, before the scene has come or after."""

    def __init__(self, status):
        self.status, self.cancelled = status, []

    def nthreads(self):
        return {"tcp://a": 1}

    def scheduler_info(self):
        return {"workers": {"tcp://a": {"status": "paused"}}}

    def submit(self, *_words, **_options):
        return PausedFuture(self.status)

    def replicate(self, _futures):
        raise ValueError("Can not use replicate to delete data")

    def gather(self, futures):
        return []

    def cancel(self, futures):
        self.cancelled += futures


@pytest.mark.parametrize("status", ["pending", "finished"])
def test_workers_that_have_paused_for_lack_of_memory_are_not_waited_for(scene, status, monkeypatch):
    monkeypatch.setattr(cluster, "PAUSED", 0.3)
    with pytest.raises(OptionError, match="cluster: every worker has paused, as it ran out of memory; give workers"):
        rt.render(scene, size=SIZE, spp=4, client=Paused(status))


def test_a_scheduler_that_goes_before_the_scene_has_come_is_told(scene, monkeypatch):
    monkeypatch.setattr(cluster, "PAUSED", 0.1)
    monkeypatch.setattr(Paused, "scheduler_info", lambda _client: {"type": "Scheduler"})
    for status in ("pending", "cancelled"):
        with pytest.raises(OptionError, match="cluster: the connection to the scheduler is lost"):
            rt.render(scene, size=SIZE, spp=4, client=Paused(status))


def test_a_worker_without_memory_is_told(scene, monkeypatch):
    client = Paused("finished")
    monkeypatch.setattr(cluster.Cluster, "_gather", lambda *_: (_ for _ in ()).throw(MemoryError()))
    with pytest.raises(OptionError, match="cluster: a worker ran out of memory; give workers"):
        rt.render(scene, size=SIZE, spp=4, client=client)


# Stopping and going on ------------------------------------------------------------------------------------------------


def test_ctrl_c_cancels_what_is_under_way(scene, pair, monkeypatch):
    ask = {"size": (256, 256), "spp": 16}
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 2)
    part = rt.render(scene, client=pair.client, progress=interrupt_in_the_last_pass, **ask)
    assert (part.complete, part.interrupted) == (False, True)
    assert (part.aov["samples"] == part.provenance["samples"]).all()
    assert part.provenance["samples"] == 8
    assert np.array_equal(part.rgb, rt.render(scene, size=(256, 256), spp=8).rgb)
    end = time.monotonic() + 600
    while any(pair.client.processing().values()):
        assert time.monotonic() < end
        time.sleep(0.05)
    assert_same(rt.render(scene, **ask), rt.render(scene, client=pair.client, **ask))


def test_a_time_limit_ends_it(scene, pair):
    part = rt.render(scene, client=pair.client, size=(256, 256), spp=65536, time_limit=5.0)
    assert (part.complete, part.interrupted) == (False, False)
    assert part.aov["samples"].any()


@pytest.mark.parametrize("way", ["uniform", "target error"])
def test_a_picture_goes_on_here_or_there(scene, pair, tmp_path, way):
    file, ask = tmp_path / "a.checkpoint", {"size": (128, 128), **WAYS[way]}
    rt.render(scene, client=pair.client, checkpoint=file, progress=once(3, interrupt), **ask)
    rt.render(scene, checkpoint=file, progress=once(3, interrupt), threads=1, **ask)
    assert_same(rt.render(scene, **ask), rt.render(scene, client=pair.client, checkpoint=file, **ask))


# Mistakes and the command line ----------------------------------------------------------------------------------------


def test_threads_are_the_workers_own(scene, pair):
    with pytest.raises(OptionError, match="threads: cannot be combined with a cluster"):
        rt.render(scene, client=pair.client, threads=2)


def test_nobody_there_is_told():
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "300ms"}),
        pytest.raises(OptionError, match=r"cluster: tcp://127\.0\.0\.1:9: no scheduler answers"),
    ):
        connect("tcp://127.0.0.1:9")
    for address in ("nonsense://host", "tcp://no-such-host.invalid:8786"):
        with pytest.raises(OptionError, match=f"{address}: no scheduler answers: "):
            connect(address)


@pytest.mark.parametrize("threads", [1, 2, 100, 1000])
@pytest.mark.parametrize("samples", [1, 64, 65536])
def test_parts_are_as_many_as_keep_all_busy_and_large_enough_for_the_scheduler(threads, samples, monkeypatch):
    monkeypatch.setattr(cluster, "RATE", 2e7)
    pixels = cluster.item_pixels(2**24, samples, threads)
    assert 2**24 / pixels <= 1.01 * cluster.ITEMS * threads
    assert pixels * samples / cluster.RATE >= 0.9 * cluster.TASK * threads  # seconds, as many as the scheduler takes


def test_the_command_line_draws_the_same_picture(pair, tmp_path):
    def run(*words):
        return subprocess.run(
            [sys.executable, "-m", "raytrace", str(BOX), "--size", "64x64", "--spp", "16", *words],
            capture_output=True, text=True, timeout=600, cwd=ROOT,
        )  # fmt: skip

    here, there = tmp_path / "here.npz", tmp_path / "there.npz"
    assert run("-o", str(here)).returncode == 0
    done = run("-o", str(there), "--cluster", pair.address)
    assert (done.returncode, done.stdout) == (0, f"{there}\n"), done.stderr
    assert np.load(here)["rgb"].tobytes() == np.load(there)["rgb"].tobytes()
    done = run("-o", str(there), "--cluster", "nonsense://host")
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("cluster: nonsense://host: no scheduler answers: ")


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_at_the_command_line_saves_what_came_back(pair, tmp_path):
    path = tmp_path / "a.npz"
    command = [sys.executable, "-m", "raytrace", str(BOX), "--size", "512x512", "--spp", "4096"]
    command += ["-o", str(path), "--resume", "--cluster", pair.address]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    file, end = tmp_path / "a.npz.checkpoint", time.monotonic() + 600
    while not file.exists() or file.stat().st_size < 10_000:
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, said = process.communicate(timeout=600)
    assert (process.returncode, out) == (130, f"{path}\n"), said
    assert f"--resume continues from {file}" in said
