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
from raytrace.cli.comparing import compare_options, compared
from raytrace.cli.conformance import conformance, conformance_options
from raytrace.cli.failures import DIFFERENT, DONE, USAGE, failed
from raytrace.cli.parser import Parser, suggestion
from raytrace.cli.terminal import Reporter, at_terminal, counting
from raytrace.errors import printable, without_scene_warnings

QUICK = {  # environment variables that skip slow steps of packages at import
    "OPENBLAS_NUM_THREADS": "1",  # NumPy would start threads for linear algebra: 0.07 s of CPU time
}
EXAMPLES = """\
examples:
  raytrace demo                                                writes demo.png
  raytrace scenes/cornell-box.json                             writes cornell-box.png
  raytrace vase.glb                                            a mesh without a scene: .obj, .ply, .stl, ...
  raytrace scene.json -o a.exr --spp 256 --aov depth,normal    more samples; linear radiance with layers
  raytrace render scenes/*.json -o images/                     several scenes; one image each
  raytrace explain scene.json                                  what the scene needs, and what is left out
"""
FIRST = """\
a first image:
  raytrace demo                 writes demo.png
  raytrace scene.json           writes scene.png; also .obj, .ply, .stl, .glb, ...
"""
MORE = "raytrace --help lists all options; raytrace COMMAND --help those of a command"
KNOWN = "; raytrace --help lists the commands"

# render ---------------------------------------------------------------------------------------------------------------


def _render(args: Namespace) -> int:
    from raytrace.cli.rendering import render_scenes

    return render_scenes(args, load_scene)


def _demo(args: Namespace) -> int:
    from raytrace.cli.rendering import render_scenes

    args.scenes = [Path("demo")]  # the image file is named after it
    return render_scenes(args, load_demo)


# The other commands ---------------------------------------------------------------------------------------------------


def _explain(args: Namespace) -> int:
    from raytrace.cli.explaining import explain_scenes

    return explain_scenes(args, load_scene)


def _check(args: Namespace) -> int:
    from raytrace.cli.checking import check_scenes

    return check_scenes(args, load_scene)


def _view(args: Namespace) -> int:
    from raytrace.cli.viewing import view

    return view(args, load_scene)


def _compare(args: Namespace) -> int:
    return DONE if compared(args) else DIFFERENT


def _hard_cases(folder: Path) -> int:
    from raytrace.hardcases import suite, table
    from raytrace.output_folder import check_folder

    check_folder(folder)
    with counting("hard cases") as progress:
        outcome = suite.run(progress=progress)
    streams.out(table.text(outcome), end="\n\n")
    for path in table.write(outcome, folder):
        streams.out(printable(path))
    return DIFFERENT if outcome.our_failures else DONE


def _report(args: Namespace) -> int:
    if args.hard_cases:
        if args.scenes:
            raise ArgumentError(None, "report: expected a scene or --hard-cases, not both")
        return _hard_cases(args.output)
    if not args.scenes:
        raise ArgumentError(None, "report: expected a scene: raytrace report scene.json -o DIR (or --hard-cases)")
    from raytrace.cli.reports import report_scenes

    return report_scenes(args, load_scene)


def _conformance(args: Namespace) -> int:
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


def _completion(args: Namespace) -> int:
    from raytrace.cli.completion import script

    streams.out(script(args.shell, {name: parser_of(name) for name in COMMANDS}).rstrip())
    return DONE


def _warmup(args: Namespace) -> int:
    from raytrace.rendering.warmup import warmup

    began = time.perf_counter()
    scenes = [raytrace.load(path, args.root, args.max_memory) for path in args.scenes]
    with Reporter(streams.say, bar=at_terminal(), lines=not at_terminal()) as reporter:
        warmup(reporter, integrator=args.integrator, scenes=scenes)
    streams.out(f"kernels ready after {time.perf_counter() - began:.1f} s")
    return DONE


def _doctor(_args: Namespace) -> int:
    from raytrace.doctor import findings

    for name, value in findings():
        streams.out(f"{name:<14} {value}")
    return DONE


# The entry point ------------------------------------------------------------------------------------------------------


class Command(NamedTuple):
    """A command of the command line, such as ``report``."""

    about: str
    run: Callable[[Namespace], int]
    options: Callable[[ArgumentParser], None] = lambda _parser: None


COMMANDS = {
    "render": Command("render scenes; this word may be omitted", _render, arguments.render_options),
    "demo": Command("render a small scene that comes with the package", _demo, arguments.demo_options),
    "explain": Command(
        "show which features a scene needs, which are left out, and why", _explain, arguments.explain_options
    ),
    "check": Command("check scenes and their meshes without rendering", _check, arguments.check_options),
    "view": Command("turn a scene or a mesh in a web browser", _view, arguments.view_options),
    "compare": Command("measure the error of an image against a reference", _compare, compare_options),
    "report": Command("measure speed and error, or test hard rays; write a page", _report, arguments.report_options),
    "conformance": Command(
        "write scenes whose light is known, or judge a renderer's images of them",
        _conformance,
        conformance_options,
    ),
    "export": Command("write a scene for Mitsuba 3 or pbrt-v4", _export, arguments.export_options),
    "schema": Command("print the JSON Schema of scene files", _schema),
    "warmup": Command("compile kernels now instead of at the first render", _warmup, arguments.warmup_options),
    "completion": Command(
        "print a script that completes commands and options in a shell", _completion, arguments.completion_options
    ),
    "doctor": Command("show versions, processor, cache and optional packages", _doctor),
}


def parser_of(name: str) -> ArgumentParser:
    """Return the parser of a command."""
    command = COMMANDS[name]
    parser = Parser("raytrace" if name == "render" else f"raytrace {name}", command.about)
    if name == "render":
        parser.description = f"Render scenes.\n\n{EXAMPLES}\ncommands (raytrace COMMAND --help):\n{_words()}"
        parser.add_argument("--version", action="version", version=f"raytrace {raytrace.__version__}")
    command.options(parser)
    return parser


def _words() -> str:
    return "".join(f"  {word:<13}{each.about}\n" for word, each in COMMANDS.items())


def _help(words: list[str]) -> int:
    """Print the help of a command, or of all."""
    name = words[0] if words else "render"
    if name not in COMMANDS:
        raise ArgumentError(None, f"'{name}' is no command{suggestion(name, COMMANDS) or KNOWN}")
    streams.out(parser_of(name).format_help().rstrip())
    return DONE


def _run(words: list[str]) -> int:
    if not words:
        streams.say(f"usage: raytrace [COMMAND] SCENE [options]\n\n{FIRST}\ncommands:\n{_words()}\n{MORE}")
        return USAGE
    first = words[0] if not words[0].startswith("-") else ""
    if first == "help":
        return _help(words[1:])
    if first in COMMANDS:
        return COMMANDS[first].run(parser_of(first).parse_args(words[1:]))
    if first and first == Path(first).stem and not os.path.lexists(first):  # no file has been meant
        meant = suggestion(first, COMMANDS)
        raise ArgumentError(None, f"'{first}' is neither a command nor a file{meant or KNOWN}")
    return COMMANDS["render"].run(parser_of("render").parse_args(words))


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
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001, it becomes a line and an exit code
        return failed(error)
