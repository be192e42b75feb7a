import os
import signal
import subprocess
import sys
import threading
from typing import NamedTuple

import pytest

from raytrace.cli import terminal
from raytrace.cli.terminal import Reporter, signals_interrupt, speed


class Event(NamedTuple):
    stage: str
    done: int = 0
    total: int = 10
    rays: int = 0
    seconds: float = 0.0


def test_compiling_is_said_once():
    said = []
    reporter = Reporter(said.append, bar=False)
    for stage in ("building", "compiling", "compiling", "rendering"):
        reporter(Event(stage))
    assert said == ["compiling kernels (first run only)"]


def test_the_newest_rendering_event_is_kept():
    reporter = Reporter(print, bar=False)
    reporter(Event("rendering", done=3))
    reporter(Event("building"))
    assert reporter.last == Event("rendering", done=3)


def test_speed_is_rays_a_second_and_survives_the_first_instant():
    assert speed(Event("rendering", rays=3_000_000, seconds=2.0)) == "1.5 M rays/s"
    assert speed(Event("rendering")) == "0.0 M rays/s"


def test_a_quick_render_shows_no_bar(capsys):
    with Reporter(print, bar=True) as reporter:
        reporter(Event("rendering", done=10, seconds=terminal.BAR_AFTER / 2))
    assert capsys.readouterr().err == ""


def test_a_long_render_shows_a_bar_with_its_speed_on_stderr_only(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes stderr for a terminal
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")
    with Reporter(print, bar=True) as reporter:
        reporter(Event("rendering", done=1, rays=10**7, seconds=1.0))
        reporter(Event("rendering", done=10, rays=10**8, seconds=4.0))
    out, err = capsys.readouterr()
    assert out == ""
    assert "100%" in err
    assert "25.0 M rays/s" in err


def test_compiling_has_a_bar_that_gives_way_to_that_of_rendering(capsys, monkeypatch):
    for name, value in {"FORCE_COLOR": "1", "COLUMNS": "100", "TERM": "xterm"}.items():
        monkeypatch.setenv(name, value)
    with Reporter(print, bar=True) as reporter:
        reporter(Event("compiling", done=0, total=1))
        reporter(Event("compiling", done=2, total=5, seconds=1.0))
        assert [task.description for task in reporter._bar.tasks] == ["compiling"]
        assert reporter._bar.tasks[0].fields["speed"] == ""
        reporter(Event("rendering", done=1, rays=10**6, seconds=0.1))
        assert [task.description for task in reporter._bar.tasks] == ["rendering"]
    out, err = capsys.readouterr()
    assert out == "compiling kernels (first run only)\n"
    assert "compiling" in err
    assert "rendering" in err


def test_no_color_is_respected(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with Reporter(print, bar=True) as reporter:
        reporter(Event("rendering", done=10, seconds=1.0))
    shown = capsys.readouterr().err
    assert "rendering" in shown
    assert "\x1b[3" not in shown  # SGR 30..39: no foreground colour


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT that a process can send itself")
def test_the_signals_interrupt_at_once_even_where_exceptions_are_caught():
    program = """
import signal
from raytrace.cli.terminal import signals_interrupt
with signals_interrupt():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        print("first", flush=True)
    try:
        signal.raise_signal(signal.SIGINT)
    except BaseException:
        print("caught", flush=True)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (130, "first\n", "")


def test_the_handler_of_before_comes_back():
    before = signal.getsignal(signal.SIGINT)
    with signals_interrupt():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_another_thread_leaves_signals_alone():
    before, inside = signal.getsignal(signal.SIGINT), []

    def enter():
        with signals_interrupt():
            inside.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert inside == [before]
