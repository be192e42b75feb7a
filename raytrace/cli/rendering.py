"""The commands ``render`` and ``demo``: one image per scene."""

import os
import time
from argparse import ArgumentError, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import raytrace
from raytrace.cli import arguments, streams
from raytrace.cli.failures import DONE, FILE, USAGE
from raytrace.cli.scenes import each_scene
from raytrace.cli.terminal import ECHO, INTERRUPTED, Reporter, Signals, at_terminal, signals_interrupt
from raytrace.errors import printable, without_scene_warnings

if TYPE_CHECKING:
    from raytrace.records import Scene

Load = Callable[[Namespace], "Scene"]


def render_scenes(args: Namespace, load: Load) -> int:
    """Render every scene; return the exit code.

    Raises
    ------
    ArgumentError, RaytraceError
        Two images would have the same name, or an image can't be written.
    """
    paths = _outputs(args)
    with signals_interrupt(ECHO) as signals, without_scene_warnings():  # printed here, with their position in the file

        def render(one: Namespace) -> int:
            return _render(one, paths[one.scene], load, signals)

        return each_scene(args, render, lambda: signals.came, title=not args.quiet)


def _outputs(args: Namespace) -> dict[Path, Path]:
    """Return the path of the image of each scene; checked before time is spent on rendering."""
    from raytrace.image.paths import check_path

    given, scenes = args.output, list(dict.fromkeys(args.scenes))
    args.scenes = scenes
    if given and len(scenes) == 1 and not _is_folder(given):
        paths = {scenes[0]: Path(given)}
        if args.format and Path(given).suffix.lower() != f".{args.format}":
            raise ArgumentError(None, f"--format {args.format}: -o {given} has another extension; leave one out")
    else:
        folder = _folder_of(given, len(scenes))
        paths = {scene: folder / f"{scene.stem}.{args.format or 'png'}" for scene in scenes}
    for path in paths.values():
        same = [str(scene) for scene in scenes if paths[scene] == path]
        if len(same) > 1:
            raise ArgumentError(None, f"{' and '.join(same)}: would both be written to {path}; render one at a time")
        check_path(path)
        if args.aov and path.suffix.lower() == ".png":
            instead = f"-o {path.stem}.exr or {path.stem}.npz" if len(scenes) == 1 else "--format exr or --format npz"
            raise ArgumentError(None, f"--aov: a PNG file cannot contain layers; use {instead}")
    return paths


def _is_folder(given: str) -> bool:
    """Whether an output names a folder: it ends with a slash, or is one, and has no extension of an image."""
    from raytrace.image.paths import SUFFIXES

    ends = given.endswith(("/", os.sep))
    return ends or (os.path.isdir(given) and Path(given).suffix.lower() not in SUFFIXES)


def _folder_of(given: str | None, count: int) -> Path:
    """Return the folder for images; made if necessary."""
    from raytrace.image.paths import SUFFIXES
    from raytrace.output_folder import check_folder

    if given is None:
        return Path()
    if Path(given).suffix.lower() in SUFFIXES and not given.endswith(("/", os.sep)):
        raise ArgumentError(None, f"-o {given}: expected a folder for {count} images, such as -o images/")
    check_folder(Path(given))
    return Path(given)


def _render(args: Namespace, path: Path, load: Load, signals: Signals) -> int:
    """Render one scene, and write its image; return the exit code."""
    began = time.perf_counter()
    say = (lambda _line: None) if args.quiet else streams.say
    scene = load(args)
    from raytrace.cli.delivery import checkpoint_of, connected, deliver, nothing, path_of, remarks
    from raytrace.cli.exposure import shown
    from raytrace.scene.checks import warnings_of

    for warning in warnings_of(scene, args.precision):
        say(f"warning: {warning}")
    bar = at_terminal() and not args.quiet
    with Reporter(say, bar=bar, lines=not bar) as reporter:
        options = {key: getattr(args, key) for key in arguments.RENDER_OPTIONS}
        options["checkpoint"] = checkpoint_of(path, args.resume, say)
        with connected(args.cluster) as options["client"]:
            image = raytrace.render(scene, progress=reporter, **options)
    if not image.provenance["samples"]:
        streams.say(nothing(image))
        return INTERRUPTED if image.interrupted or signals.came else USAGE
    with signals.held():  # write the image
        target = path_of(image, path)
        stops = shown(scene, image, target, args.exposure, say)
        written, failure = deliver(image, target, stops)
        seconds = time.perf_counter() - began
        for line in remarks(image, reporter.last, seconds, args.target_error):
            say(line)
        if failure or target != path:
            text = f"{path} exists and is not replaced; the incomplete image is in {written}"
            streams.say(failure or printable(text))
        if args.json:
            outcome = {"scene": str(args.scene), "path": str(written), "seconds": seconds, "complete": image.complete}
            outcome |= {"exposure": stops} if args.exposure == "auto" else {}
            streams.out(streams.json_text(outcome | {"stats": image.stats, "provenance": image.provenance}))
        else:
            streams.out(printable(written))
    return FILE if failure else INTERRUPTED if image.interrupted or signals.came else DONE
