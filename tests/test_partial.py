"""What the command line leaves and says of a render that was ended early; signals while the image is written."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import raytrace as rt
from raytrace.cli import main, terminal
from raytrace.cli.delivery import deliver, remarks
from raytrace.cli.terminal import Reporter
from raytrace.rendering import run
from raytrace.rendering.run import Run
from raytrace.rendering.threads import RenderThreads
from signals import default_signals
from small_scenes import studio

ROOT = Path(__file__).parents[1]
BOX = ROOT / "scenes" / "cornell-box.json"
ASK = [str(BOX), "--size", "256x256", "--spp", "64"]
FIRST = 4  # parts of the first pass


@pytest.fixture(autouse=True)
def handlers():
    """Those of the tests come back: after a signal, the command line leaves its own."""
    numbers = [getattr(signal, name) for name in terminal.ENDING if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def passes(monkeypatch):
    """The film is drawn in passes, however quick the machine is."""
    monkeypatch.setattr(run, "first_round", lambda spp, seconds: 1)


@pytest.fixture
def interrupted(passes, monkeypatch):
    """Ctrl-C comes after the first pass, and before the fourth."""
    draw = RenderThreads.draw

    def draw_or_wait(workers, tile, first, last, over=lambda: True):  # without: to see how long it takes
        workers.parts = getattr(workers, "parts", 0) + 1
        while workers.parts > 4 * FIRST and not over():
            time.sleep(0.01)
        return draw(workers, tile, first, last, over)

    monkeypatch.setattr(RenderThreads, "draw", draw_or_wait)

    def interrupt(_reporter, event):
        if event.stage == "rendering" and event.done > FIRST:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Reporter, "__call__", interrupt)


def samples(path):
    with np.load(path) as file:
        return json.loads(str(file["provenance"]))["samples"]


# Where it goes --------------------------------------------------------------------------------------------------------


def test_a_partial_image_takes_the_name_that_is_free(tmp_path, interrupted, capsys):
    path = tmp_path / "box.npz"
    assert main.main([*ASK, "-o", str(path)]) == 130
    out, err = capsys.readouterr()
    assert out == f"{path}\n"
    assert f"interrupted at {samples(path)} of 64 samples per pixel\n" in err
    assert samples(path) in (1, 2, 4)
    assert np.array_equal(np.load(path)["rgb"], rt.render(BOX, size=(256, 256), spp=samples(path)).rgb)


@pytest.mark.parametrize("name", ["box.npz", "box.v2.npz"])
def test_a_partial_image_goes_beside_a_file_that_is_there(tmp_path, interrupted, capsys, name):
    path = tmp_path / name
    partial = tmp_path / name.replace(".npz", ".partial.npz")
    path.write_bytes(b"a finished image")
    for _ in range(2):  # the second partial image takes the place of the first
        assert main.main([*ASK, "-o", str(path)]) == 130
        out, err = capsys.readouterr()
        assert out == f"{partial}\n"
        last = err.splitlines()[-1]
        assert last == f"{path} exists and is not replaced; the incomplete image is in {partial}"
        assert path.read_bytes() == b"a finished image"
        assert samples(partial) >= 1
    assert {each.name for each in tmp_path.iterdir()} == {path.name, partial.name}


def test_a_time_limit_leaves_a_file_that_is_there_too(tmp_path, passes, monkeypatch, capsys):
    path = tmp_path / "box.npz"
    path.write_bytes(b"a finished image")
    looks = iter(range(1000))
    monkeypatch.setattr(Run, "_over", lambda _run: next(looks) > 3 * FIRST + 3)
    assert main.main([*ASK, "--threads", "1", "--time-limit", "1e6", "--quiet", "-o", str(path)]) == 0
    out, err = capsys.readouterr()
    assert out == f"{tmp_path / 'box.partial.npz'}\n"
    assert err == f"{path} exists and is not replaced; the incomplete image is in {tmp_path / 'box.partial.npz'}\n"
    assert path.read_bytes() == b"a finished image"


def test_a_whole_image_replaces_a_file_that_is_there(tmp_path, capsys):
    path = tmp_path / "box.npz"
    path.write_bytes(b"an older image")
    assert main.main([str(BOX), "--size", "8x8", "--spp", "2", "-o", str(path), "--json"]) == 0
    assert samples(path) == 2
    told = json.loads(capsys.readouterr().out)
    assert told["complete"] is told["provenance"]["complete"] is True


def test_json_says_alike_in_both_places_that_it_is_incomplete(tmp_path, interrupted, capsys):
    path = tmp_path / "box.npz"
    path.touch()
    assert main.main([*ASK, "-o", str(path), "--json"]) == 130
    told = json.loads(capsys.readouterr().out)
    assert told["complete"] is told["provenance"]["complete"] is False
    assert told["path"] == str(tmp_path / "box.partial.npz")
    assert told["provenance"]["samples"] == samples(told["path"])


@pytest.mark.parametrize("words", [[], ["--resume"]])
def test_before_the_first_pass_is_complete_nothing_is_written(tmp_path, monkeypatch, capsys, words):
    def interrupt(_reporter, event):
        if event.stage == "building":
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Reporter, "__call__", interrupt)
    path = tmp_path / "box.npz"
    assert main.main([*ASK, "-o", str(path), *words]) == 130
    out, err = capsys.readouterr()
    kept = f"; --resume continues from {path}.checkpoint" if words else ""
    assert out == ""
    assert err == f"interrupted before the first round of samples was complete; nothing was saved{kept}\n"
    assert not path.exists()


def test_time_that_ends_before_the_first_pass_writes_nothing_either(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Run, "_over", lambda _run: True)
    path = tmp_path / "box.npz"
    assert main.main([*ASK, "-o", str(path), "--time-limit", "1e6"]) == 2
    out, err = capsys.readouterr()
    assert (out, list(tmp_path.iterdir())) == ("", [])
    why = "time limit reached before the first round of samples was complete"
    assert err == f"{why}; nothing was saved; use a longer --time-limit\n"


def test_a_partial_image_that_cannot_be_written_goes_elsewhere(tmp_path, passes, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path, failure = deliver(rt.render(studio(), size=(8, 8), spp=2), tmp_path / "gone" / "a.partial.npz", 0.0)
    assert path.name == "a.partial.npz"
    assert failure.endswith(f"; the image is in {path}")


# What is said ---------------------------------------------------------------------------------------------------------


def test_the_summary_tells_compiling_from_rendering():
    image = rt.render(studio(), size=(8, 8), spp=4)
    last = run.Progress("rendering", 1, 1, 54_200_000, 2.0)
    image.stats["compile_seconds"] = 37.61
    (line,) = remarks(image, last, 40.05, None)
    assert line.startswith("40.05 s (37.61 s compiling, 2.00 s rendering), 27.1 M rays/s, estimated error ")
    image.stats["compile_seconds"] = 0.0
    (line,) = remarks(image, last, 2.45, None)
    assert line.startswith("2.45 s (2.00 s rendering), 27.1 M rays/s, estimated error ")
    (line,) = remarks(image, last, 2.05, None)
    assert line.startswith("2.05 s, 27.1 M rays/s, estimated error ")


# Signals --------------------------------------------------------------------------------------------------------------

WRITING = """
import os, signal, sys, time
from raytrace import files
from raytrace.rendering import run
from raytrace.cli.main import main
from raytrace.cli.terminal import ECHO, Reporter
run.first_round = lambda spp, seconds: 1
replace = os.replace
def slowly(*names):  # the image is being written
    if {during}:
        signal.raise_signal(signal.SIGINT)
    if {again}:
        time.sleep(2 * ECHO)
        signal.raise_signal(signal.SIGINT)
    replace(*names)
os.replace = slowly
def call(self, event):
    if {before} and event.stage == "rendering" and event.done > 4:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
Reporter.__call__ = call
code = main()
if {after}:
    signal.raise_signal(signal.SIGINT)
sys.exit(code)
"""


def signalled(path, **when):
    when = {name: name in when for name in ("before", "during", "again", "after")}
    words = [sys.executable, "-c", WRITING.format(**when), *ASK, "-o", str(path)]
    ready = None if os.name == "nt" else default_signals
    return subprocess.run(words, capture_output=True, text=True, timeout=120, cwd=ROOT, preexec_fn=ready)


def test_a_signal_while_the_image_is_written_loses_nothing(tmp_path):
    done = signalled(tmp_path / "a.npz", during=True)
    assert (done.returncode, done.stdout) == (130, f"{tmp_path / 'a.npz'}\n"), done.stderr
    assert samples(tmp_path / "a.npz") == 64
    assert [each.name for each in tmp_path.iterdir()] == ["a.npz"]


@pytest.mark.parametrize("when", [{"before"}, {"during"}])
def test_the_next_signal_while_the_image_is_written_ends_the_process_at_once(tmp_path, when):
    done = signalled(tmp_path / "a.npz", **dict.fromkeys(when | {"again"}))
    assert (done.returncode, done.stdout) == (130, ""), done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []  # nor a temporary file


def test_the_same_signal_twice_at_once_is_one(tmp_path):
    """As ``timeout`` sends it: to its child, and to the group that it is in."""
    done = signalled(tmp_path / "a.npz", before=True)
    assert (done.returncode, done.stdout) == (130, f"{tmp_path / 'a.npz'}\n"), done.stderr


def test_a_signal_after_an_interrupted_render_does_not_find_the_handlers_of_before(tmp_path):
    done = signalled(tmp_path / "a.npz", before=True, after=True)
    assert done.returncode == 130
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="Windows has the real one")
def test_ctrl_break_interrupts_too(monkeypatch):
    monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)
    before = signal.getsignal(signal.SIGUSR1)
    with terminal.signals_interrupt(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGUSR1)
    signal.signal(signal.SIGUSR1, before)
