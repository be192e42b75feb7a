"""The command line: commands, messages and exit codes.

Large packages are imported only when a command needs them, so ``--help`` and error messages appear at once.
"""

import os
import sys
import time
from argparse import ArgumentError, ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import raytrace
from raytrace.cli import arguments, streams
from raytrace.cli.changes import load_demo, load_scene
from raytrace.cli.terminal import ECHO, INTERRUPTED, Reporter, at_terminal, signals_interrupt
from raytrace.errors import RaytraceError, printable, without_scene_warnings

DONE, INTERNAL, USAGE, FILE, DIFFERENT = 0, 1, 2, 4, 5  # 3, an invalid scene, is SceneError.exit_code
QUICK = {  # environment variables that skip slow steps of packages at import
    "OPENBLAS_NUM_THREADS": "1",  # NumPy would start threads for linear algebra: 0.07 s of CPU time
}
EXAMPLES = """\
examples:
  raytrace demo                                                writes demo.png
  raytrace scenes/cornell-box.json                             writes cornell-box.png
  raytrace vase.glb                                            a mesh without a scene: .obj, .ply, .stl, ...
  raytrace scene.json -o a.exr --spp 256 --aov depth,normal    more samples; linear radiance with layers
  raytrace explain scene.json                                  what the scene needs, and what is left out
"""

# render ---------------------------------------------------------------------------------------------------------------


def _demo(args: Namespace) -> int:
    args.scene = Path("demo")  # the image file is named after it
    return _render(args, load_demo)


def _render(args: Namespace, load: Callable[[Namespace], "raytrace.Scene"] = load_scene) -> int:
    from raytrace.image.paths import check_path

    began = time.perf_counter()
    path = check_path(args.output or f"{args.scene.stem}.png")  # before time is spent on rendering
    if args.aov and path.suffix.lower() == ".png":
        raise ArgumentError(None, f"--aov: a PNG file cannot contain layers; use -o {path.stem}.exr or {path.stem}.npz")
    say = (lambda _line: None) if args.quiet else streams.say
    with signals_interrupt(ECHO) as signals, without_scene_warnings():  # printed here, with their position in the file
        scene = load(args)
        from raytrace.cli.delivery import checkpoint_of, connected, deliver, nothing, path_of, remarks
        from raytrace.cli.exposure import shown
        from raytrace.scene.checks import warnings_of

        for warning in warnings_of(scene, args.precision):
            say(f"warning: {warning}")
        with Reporter(say, bar=at_terminal() and not args.quiet) as reporter:
            options = {key: getattr(args, key) for key in arguments.RENDER_OPTIONS}
            options["checkpoint"] = checkpoint_of(path, args.resume, say)
            with connected(args.cluster) as options["client"]:
                image = raytrace.render(scene, progress=reporter, **options)
        if not image.provenance["samples"]:
            streams.say(nothing(image))
            return INTERRUPTED
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
                outcome = {"path": str(written), "seconds": seconds, "complete": image.complete}
                outcome |= {"exposure": stops} if args.exposure == "auto" else {}
                streams.out(streams.json_text(outcome | {"stats": image.stats, "provenance": image.provenance}))
            else:
                streams.out(printable(written))
    return FILE if failure else INTERRUPTED if image.interrupted or signals.came else DONE


# The other commands ---------------------------------------------------------------------------------------------------


def _explain(args: Namespace) -> int:
    chosen = {"integrator": args.integrator} if args.integrator else {}
    streams.out(str(raytrace.explain(load_scene(args), **chosen)))
    return DONE


def _check(args: Namespace) -> int:
    from raytrace.scene.seen_backs import back_warnings

    scene = load_scene(args)
    for warning in scene.warnings:
        streams.out(f"warning: {warning}")
    for warning in back_warnings(scene):
        streams.out(f"warning: {warning}")
    raytrace.explain(scene)  # an error if no precision can represent the scene
    streams.out(f"{printable(args.scene)}: ok")
    return DONE


def _compare(args: Namespace) -> int:
    from raytrace.cli.comparing import compared

    return DONE if compared(args) else DIFFERENT


def _hard_cases(folder: Path) -> int:
    from raytrace.hardcases import suite, table
    from raytrace.output_folder import check_folder

    check_folder(folder)
    progress = (lambda name, k, n: streams.say(f"{k + 1}/{n} {name}")) if at_terminal() else None
    outcome = suite.run(progress=progress)
    streams.out(table.text(outcome), end="\n\n")
    for path in table.write(outcome, folder):
        streams.out(printable(path))
    return DIFFERENT if outcome.our_failures else DONE


def _report(args: Namespace) -> int:
    from raytrace.reporting.sweep import report

    if args.hard_cases:
        if args.scene:
            raise ArgumentError(None, "report: expected a scene or --hard-cases, not both")
        return _hard_cases(args.output)
    if not args.scene:
        raise ArgumentError(None, "report: expected a scene: raytrace report scene.json -o DIR (or --hard-cases)")
    with signals_interrupt(), without_scene_warnings():  # they are printed here, with their position in the file
        scene = load_scene(args)
        with Reporter(streams.say, bar=at_terminal()) as reporter:
            options = {name: getattr(args, name) for name in ("reference", "budget", "size")}
            found = report(scene, args.output, progress=reporter, **options)
    streams.out(str(found))
    for path in found.files:
        streams.out(printable(path))
    return INTERRUPTED if found.interrupted else DONE


def _conformance(args: Namespace) -> int:
    from raytrace.cli.conformance import conformance

    return DONE if conformance(args) else DIFFERENT


def _export(args: Namespace) -> int:
    from raytrace.exporting.export import export_scene

    with without_scene_warnings():  # they are about our own image
        path, warnings = export_scene(load_scene(args), args.to, args.output, args.approximate)
    for warning in warnings:
        streams.say(f"warning: {warning}")
    streams.out(printable(path))
    return DONE


def _schema(_args: Namespace) -> int:
    from raytrace.scene import schema_text

    streams.out(schema_text().rstrip())
    return DONE


def _warmup(args: Namespace) -> int:
    from raytrace.rendering.warmup import warmup

    began = time.perf_counter()
    scenes = [raytrace.load(path, args.root, args.max_memory) for path in args.scenes]
    with Reporter(streams.say, bar=at_terminal()) as reporter:
        warmup(reporter, integrator=args.integrator, scenes=scenes)
    streams.out(f"kernels ready after {time.perf_counter() - began:.1f} s")
    return DONE


def _doctor(_args: Namespace) -> int:
    from raytrace.doctor import findings

    for name, value in findings():
        streams.out(f"{name:<14}{value}")
    return DONE


# The entry point ------------------------------------------------------------------------------------------------------


class Command(NamedTuple):
    """A command of the command line, such as ``report``."""

    about: str
    run: Callable[[Namespace], int]
    options: Callable[[ArgumentParser], None] = lambda _parser: None


COMMANDS = {
    "render": Command("render a scene; this word may be omitted", _render, arguments.render_options),
    "demo": Command("render a small scene that comes with the package", _demo, arguments.demo_options),
    "explain": Command(
        "show which features a scene needs, which are left out, and why", _explain, arguments.explain_options
    ),
    "check": Command("check a scene and its meshes without rendering", _check, arguments.scene_options),
    "compare": Command("measure the error of an image against a reference", _compare, arguments.compare_options),
    "report": Command("measure speed and error, or test hard rays; write a page", _report, arguments.report_options),
    "conformance": Command(
        "write scenes whose light is known, or judge a renderer's images of them",
        _conformance,
        arguments.conformance_options,
    ),
    "export": Command("write a scene for Mitsuba 3 or pbrt-v4", _export, arguments.export_options),
    "schema": Command("print the JSON Schema of scene files", _schema),
    "warmup": Command("compile kernels now instead of at the first render", _warmup, arguments.warmup_options),
    "doctor": Command("show versions, processor, cache and optional packages", _doctor),
}


def _parser(name: str, command: Command) -> ArgumentParser:
    parser = arguments.Parser("raytrace" if name == "render" else f"raytrace {name}", command.about)
    if name == "render":
        words = "".join(f"  {word:<13}{each.about}\n" for word, each in COMMANDS.items())
        parser.description = f"Render a scene.\n\n{EXAMPLES}\ncommands (raytrace COMMAND --help):\n{words}"
        parser.add_argument("--version", action="version", version=f"raytrace {raytrace.__version__}")
    command.options(parser)
    return parser


def _run(words: list[str]) -> int:
    first = words[0] if words and not words[0].startswith("-") else ""
    if first in COMMANDS:
        return COMMANDS[first].run(_parser(first, COMMANDS[first]).parse_args(words[1:]))
    meant = arguments.suggestion(first, COMMANDS)
    if meant and not Path(first).suffix and not Path(first).exists():
        raise ArgumentError(None, f"'{first}' is neither a command nor a file{meant}")
    return COMMANDS["render"].run(_parser("render", COMMANDS["render"]).parse_args(words))


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv : list of str, optional
        The words after the program's name. Default: those of this process.

    Returns
    -------
    int
        Exit code: 0 done, 1 internal failure, 2 command line (also argparse itself), 3 invalid scene,
        4 unreadable or unwritable file, 5 comparison, hard cases or conformance failed, 130 interrupted.

    Examples
    --------
    >>> main(["no-such-scene.json", "--output", "image.png"])
    4
    """
    for name, value in QUICK.items():
        os.environ.setdefault(name, value)
    streams.prepare()
    try:
        code = _run(sys.argv[1:] if argv is None else argv)
        streams.flush()  # an error of a full disk appears here, not at exit
        return code
    except RaytraceError as error:
        streams.say(str(error))
        return error.exit_code
    except MemoryError:  # the estimate of free memory was too high
        streams.say("memory: not enough; use a smaller image (--size), smaller meshes, or fewer --threads")
        return USAGE
    except ArgumentError as error:
        streams.say(f"raytrace: error: {printable(error)}")
        return USAGE
    except KeyboardInterrupt:
        streams.say("interrupted; nothing was saved")
        return INTERRUPTED
    except OSError as error:
        streams.discard(sys.stdout)
        streams.say(printable(f"{error.filename or 'output'}: {error.strerror or error}"))
        return FILE
    except Exception as error:
        if os.environ.get("RAYTRACE_DEBUG"):
            raise
        what = printable(f"{type(error).__name__}: {error}")
        streams.say(f"internal failure: {what}; please report it (RAYTRACE_DEBUG=1 shows where)")
        return INTERNAL
