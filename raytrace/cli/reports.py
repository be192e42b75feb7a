"""The command ``report`` on one scene or several."""

from argparse import ArgumentError, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

from raytrace.cli import streams
from raytrace.cli.terminal import INTERRUPTED, Reporter, at_terminal, signals_interrupt
from raytrace.errors import printable, without_scene_warnings
from raytrace.records import Scene
from raytrace.reporting import sweep
from raytrace.reporting.overview import exit_code, report_all
from raytrace.reporting.sweep import Report


def report_scenes(args: Namespace, load: Callable[[Namespace], Scene]) -> int:
    """Report on the scenes of a command line; return its exit code."""
    if len(args.scenes) > 1 and args.reference:
        raise ArgumentError(None, "--reference: it belongs to one scene; report on each scene alone")
    with signals_interrupt(), without_scene_warnings():  # they are printed here, with their position in the file
        if len(args.scenes) > 1:
            return _several(args, load)
        found = _one(args, load, args.scenes[0], args.output)
    streams.out(str(found))
    for path in found.files:
        streams.out(printable(path))
    return INTERRUPTED if found.interrupted else 0


def _one(args: Namespace, load: Callable[[Namespace], Scene], path: Path, folder: Path) -> Report:
    scene = load(Namespace(**vars(args) | {"scene": path}))
    with Reporter(streams.say, bar=at_terminal(), lines=not at_terminal()) as reporter:
        options: dict[str, Any] = {name: getattr(args, name) for name in ("reference", "budget", "size", "peers")}
        return sweep.report(scene, folder, progress=reporter, **options)


def _several(args: Namespace, load: Callable[[Namespace], Scene]) -> int:
    entries, page = report_all(
        args.scenes,
        args.output,
        lambda path, folder: _one(args, load, path, folder),
        lambda line: streams.say(printable(line)),
    )
    streams.out(printable(page))
    return exit_code(entries)
